//! A folder of numbered PNG or JPEG pictures, read as a clip of 25 pictures per second.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use image::ImageReader;

use super::mjpeg::limited;
use crate::base::error::{Error, Kind, Result};
use crate::video::clip::{ClipInfo, Pixels, RawFrame, Source, Turn};

/// Nanoseconds each picture lasts.
pub const PERIOD_NS: u64 = 40_000_000;

/// The folder's pictures in natural order (`2.png` before `10.png`); other files and hidden ones are left out.
///
/// # Errors
/// When the folder cannot be read.
pub fn pictures(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, "read", e))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| Error::io(folder, "read", e))?.path();
        let hidden = path.file_name().is_none_or(|n| n.to_string_lossy().starts_with('.'));
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        if !hidden && matches!(extension.as_deref(), Some("png" | "jpg" | "jpeg")) && path.is_file() {
            files.push(path);
        }
    }
    files.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()).then_with(|| a.cmp(b)));
    Ok(files)
}

/// Compares runs of digits by their value and all else by character.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    loop {
        let digits = |s: &str| s.bytes().take_while(u8::is_ascii_digit).count();
        let (na, nb) = (digits(a), digits(b));
        if na > 0 && nb > 0 {
            let (x, y) = (a[..na].trim_start_matches('0'), b[..nb].trim_start_matches('0'));
            let order = x.len().cmp(&y.len()).then_with(|| x.cmp(y));
            if order != Ordering::Equal {
                return order;
            }
            (a, b) = (&a[na..], &b[nb..]);
            continue;
        }
        let (mut ca, mut cb) = (a.chars(), b.chars());
        match (ca.next(), cb.next()) {
            (Some(x), Some(y)) if x == y => (a, b) = (ca.as_str(), cb.as_str()),
            (x, y) => return x.cmp(&y),
        }
    }
}

/// A folder being read.
pub struct Folder {
    info: ClipInfo,
    files: Vec<PathBuf>,
    next: usize,
}

/// Opens a folder.
///
/// # Errors
/// When it cannot be read, has no pictures, or the first one cannot be decoded.
pub fn open(path: &Path) -> Result<Folder> {
    let files = pictures(path)?;
    let Some(first) = files.first() else {
        return Err(Error::file(Kind::Data, path, "no PNG or JPEG pictures in this folder")
            .remedy("give a folder of frames like 00000.png, 00001.png, …"));
    };
    let (width, height, _) = read(first)?;
    let info = ClipInfo {
        width,
        height,
        turn: Turn::None,
        frames: Some(files.len()),
        duration_ns: Some(files.len() as u64 * PERIOD_NS),
        codec: "folder of pictures".into(),
        decoder: "embedded pictures",
    };
    Ok(Folder { info, files, next: 0 })
}

fn read(path: &Path) -> Result<(usize, usize, Pixels)> {
    let reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format);
    let reader = limited(reader.map_err(|e| Error::io(path, "open", e))?);
    let image = reader.decode().map_err(|e| {
        Error::file(Kind::Data, path, format!("cannot be decoded: {e}")).remedy("save this picture again")
    })?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let pixels = match image.color().has_alpha() {
        true => Pixels::Rgba(image.into_rgba8().into_raw()),
        false => Pixels::Rgb(image.into_rgb8().into_raw()),
    };
    Ok((width, height, pixels))
}

impl Source for Folder {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<RawFrame>> {
        let Some(path) = self.files.get(self.next) else { return Ok(None) };
        let (width, height, pixels) = read(path)?;
        if (width, height) != (self.info.width, self.info.height) {
            self.next = self.files.len();
            let problem = format!("{width} × {height} pixels, but the first picture of its folder has another size");
            return Err(Error::file(Kind::Data, path, problem)
                .allowed(format!("{} × {}", self.info.width, self.info.height))
                .remedy("bring all pictures of the folder to one size"));
        }
        let time_ns = self.next as u64 * PERIOD_NS;
        self.next += 1;
        Ok(Some(RawFrame { width, height, time_ns, pixels }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_sort_by_value() {
        let mut names = ["a10.png", "a2.png", "a02b.png", "b1.png", "a002.png", "a2"];
        names.sort_by(|a, b| natural(a, b));
        assert_eq!(names, ["a2", "a2.png", "a002.png", "a02b.png", "a10.png", "b1.png"]);
    }
}
