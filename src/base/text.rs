//! Words for people.

/// A number of things: "1 clip", "2 clips".
pub fn counted(count: impl Into<u64>, what: &str) -> String {
    let count = count.into();
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_not_many() {
        assert_eq!((counted(1u64, "clip"), counted(2u64, "clip")), ("1 clip".to_owned(), "2 clips".to_owned()));
        assert_eq!(counted(0u32, "frame"), "0 frames");
    }
}
