//! Middlebury `.flo` files (Baker et al. 2011): "PIEH", width, height, then (u, v) pairs, little-endian.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use crate::base::error::{Error, Kind, Result};
use crate::flow::field::Field;

/// First four bytes of a `.flo` file.
const MAGIC: &[u8; 4] = b"PIEH";
/// Longest side of a field that is read.
pub const MAX_SIDE: usize = 1 << 15;
/// Most pixels of a field that is read (1.6 GB of file).
pub const MAX_PIXELS: usize = 200_000_000;
/// Components beyond this length mean "unknown" in the format.
pub const UNKNOWN: f32 = 1e9;

/// Whether a vector of a `.flo` file is known (the format marks unknown motion by components beyond 10⁹).
pub fn is_known(u: f32, v: f32) -> bool {
    u.abs() <= UNKNOWN && v.abs() <= UNKNOWN
}

/// Reads a `.flo` file; unknown vectors stay as they are in the file (see [`is_known`]).
///
/// # Errors
/// An unreadable file; a foreign, truncated or overlong one; a size of 0 or beyond [`MAX_SIDE`] × [`MAX_SIDE`] or
/// [`MAX_PIXELS`]; a component that is not a number.
pub fn read(path: &Path) -> Result<Field> {
    let length = std::fs::metadata(path).map_err(|e| Error::io(path, "read", e))?.len();
    if length > 12 + 8 * MAX_PIXELS as u64 {
        return Err(Error::file(Kind::Limit, path, format!("{length} bytes are too many for a .flo file"))
            .allowed(format!("up to {MAX_PIXELS} pixels")));
    }
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, "read", e))?;
    parse(&bytes, path)
}

/// Width and height of a field, from its file's first bytes.
///
/// # Errors
/// An unreadable or foreign file; a size that [`read`] refuses.
pub fn size(path: &Path) -> Result<(usize, usize)> {
    let mut header = Vec::new();
    let read = File::open(path).and_then(|file| file.take(12).read_to_end(&mut header));
    read.map_err(|e| Error::io(path, "read", e))?;
    parse_size(&header, path)
}

/// [`read`] from memory; `path` names the file in errors.
///
/// # Errors
/// As for [`read`].
pub fn parse(bytes: &[u8], path: &Path) -> Result<Field> {
    let data = |problem: String| Error::file(Kind::Data, path, problem);
    let (width, height) = parse_size(bytes, path)?;
    let body = &bytes[12..];
    let expected = width * height * 8;
    if body.len() != expected {
        let fault = if body.len() < expected { "truncated" } else { "longer than its size says" };
        return Err(data(format!("{fault}: {width} x {height} pixels need {expected} bytes, it has {}", body.len())));
    }
    let mut field = Field::zeros(width, height);
    for (i, pair) in body.chunks_exact(8).enumerate() {
        let value = |at: usize| f32::from_le_bytes([pair[at], pair[at + 1], pair[at + 2], pair[at + 3]]);
        (field.u.data[i], field.v.data[i]) = (value(0), value(4));
        if value(0).is_nan() || value(4).is_nan() {
            return Err(data(format!("the motion at pixel ({}, {}) is not a number", i % width, i / width))
                .remedy("write a number everywhere, 0 where nothing moves"));
        }
    }
    Ok(field)
}

/// The size that the first 12 bytes of a file give.
fn parse_size(bytes: &[u8], path: &Path) -> Result<(usize, usize)> {
    let data = |problem: String| Error::file(Kind::Data, path, problem);
    let header = bytes.first_chunk::<12>().filter(|h| h.starts_with(MAGIC)).ok_or_else(|| {
        data("not a .flo file: it does not begin with PIEH and a size".into()).remedy("give a Middlebury .flo file")
    })?;
    let side = |at: usize| i32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    match (usize::try_from(side(4)), usize::try_from(side(8))) {
        (Ok(w), Ok(h)) if (1..=MAX_SIDE).contains(&w) && (1..=MAX_SIDE).contains(&h) && w * h <= MAX_PIXELS => {
            Ok((w, h))
        }
        _ => Err(data(format!("a field of {} x {} pixels", side(4), side(8)))
            .allowed(format!("sides of 1 to {MAX_SIDE}, up to {MAX_PIXELS} pixels"))),
    }
}

/// The bytes of a `.flo` file; `path` is for the messages.
///
/// # Errors
/// A field without pixels or with a side beyond [`MAX_SIDE`].
pub fn encode(path: &Path, field: &Field) -> Result<Vec<u8>> {
    let (width, height) = (field.width(), field.height());
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
        return Err(Error::file(Kind::Limit, path, format!("a field of {width} x {height} pixels"))
            .allowed(format!("sides of 1 to {MAX_SIDE}")));
    }
    let mut bytes = Vec::with_capacity(12 + 8 * width * height);
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&(width as i32).to_le_bytes());
    bytes.extend_from_slice(&(height as i32).to_le_bytes());
    for (u, v) in field.u.data.iter().zip(&field.v.data) {
        bytes.extend_from_slice(&u.to_le_bytes());
        bytes.extend_from_slice(&v.to_le_bytes());
    }
    Ok(bytes)
}

/// Writes a `.flo` file: complete under `path` or not at all.
///
/// # Errors
/// Those of [`encode`]; what the system refuses.
pub fn write(path: &Path, field: &Field) -> Result<()> {
    let bytes = encode(path, field)?;
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}.partial", std::process::id()));
    let partial = path.with_file_name(name);
    let written = File::create(&partial)
        .and_then(|mut file| file.write_all(&bytes).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&partial, path));
    written.map_err(|e| {
        let _ = std::fs::remove_file(&partial);
        Error::io(path, "write", e)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some_field() -> Field {
        let mut field = Field::zeros(3, 2);
        field.u.data = vec![0.5, -1.25, 2e9, 3.0, 1e-30, 7.0];
        field.v.data = vec![-0.5, 0.0, 2e9, -3.0, 4.0, 1e9];
        field
    }

    #[test]
    fn round_trip_is_exact_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.flo");
        write(&path, &some_field()).unwrap();
        assert_eq!(read(&path).unwrap(), some_field());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        assert!(!is_known(2e9, 2e9) && is_known(3.0, 1e9));
    }

    #[test]
    fn bad_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.flo");
        write(&path, &some_field()).unwrap();
        let good = std::fs::read(&path).unwrap();
        let problem = |bytes: &[u8]| parse(bytes, &path).unwrap_err().to_string();
        (0..12).for_each(|n| assert!(problem(&good[..n]).contains("not a .flo")));
        (12..good.len()).for_each(|n| assert!(problem(&good[..n]).contains("truncated")));
        assert!(problem(&[&good[..], &[0]].concat()).contains("longer"));
        for (at, side) in [(4, 0i32), (4, -3), (8, i32::MAX), (4, 1 << 20)] {
            let mut bytes = good.clone();
            bytes[at..at + 4].copy_from_slice(&side.to_le_bytes());
            assert!(problem(&bytes).contains("allowed"), "{}", problem(&bytes));
        }
        let mut bytes = good.clone();
        bytes[12 + 4 * 8..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        assert!(problem(&bytes).contains("pixel (1, 1) is not a number"), "{}", problem(&bytes));
        assert!(read(&folder.path().join("none.flo")).is_err());
        assert!(write(&folder.path().join("no/such/a.flo"), &some_field()).is_err());
        assert!(write(&path, &Field::default()).is_err());
    }
}
