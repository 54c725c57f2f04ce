//! Words for people.

/// A number of things: "1 clip", "2 clips".
pub fn counted(count: impl Into<u64>, what: &str) -> String {
    let count = count.into();
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// Seconds as "1 h 02 min", "3 min 05 s" or "4.2 s".
pub fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        0..60 => format!("{seconds:.1} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole / 60 % 60),
    }
}

/// Bytes as "12.3 MB" (powers of ten).
pub fn bytes(count: u64) -> String {
    let units = ["B", "kB", "MB", "GB", "TB"];
    let mut value = count as f64;
    let mut unit = 0;
    while value >= 1000.0 && unit + 1 < units.len() {
        value /= 1000.0;
        unit += 1;
    }
    if unit == 0 { format!("{count} B") } else { format!("{value:.1} {}", units[unit]) }
}

/// About how long, as people say it: "20 s", "3 min" or "2.8 h".
pub fn rough_duration(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// About how many bytes: "12 MB" or "1.5 GB" (powers of ten).
pub fn rough_bytes(count: f64) -> String {
    if count < 1e9 { format!("{:.0} MB", (count / 1e6).ceil()) } else { format!("{:.1} GB", count / 1e9) }
}

/// Bytes as "12 MB", which is enough for them.
pub fn megabytes(count: u64) -> String {
    format!("{} MB", count.div_ceil(1_000_000))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_not_many() {
        assert_eq!((counted(1u64, "clip"), counted(2u64, "clip")), ("1 clip".to_owned(), "2 clips".to_owned()));
        assert_eq!(counted(0u32, "frame"), "0 frames");
    }

    #[test]
    fn sizes_and_times_read_well() {
        assert_eq!(duration(4.21), "4.2 s");
        assert_eq!(duration(185.0), "3 min 05 s");
        assert_eq!(duration(3725.0), "1 h 02 min");
        assert_eq!(bytes(999), "999 B");
        assert_eq!(bytes(12_340_000), "12.3 MB");
        assert_eq!([20.0, 170.0, 10_000.0].map(rough_duration), ["20 s", "3 min", "2.8 h"]);
        assert_eq!(
            (rough_bytes(11_200_000.0), rough_bytes(1.54e9), megabytes(1)),
            ("12 MB".into(), "1.5 GB".into(), "1 MB".into())
        );
    }
}
