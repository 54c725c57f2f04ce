//! A folder of PNG frames, `00000.png` on.

use std::path::Path;

use super::clip::Sink;
use super::sink::{SinkOptions, check_alpha, check_frame};
use crate::base::atomic_file::AtomicFolder;
use crate::base::error::{Error, Kind, Result};
use crate::raster::image::Rgb8;
use crate::raster::picture_io::{encode_png, encode_rgba_png};

/// Frames that five digits can number.
const MAX_FRAMES: usize = 100_000;

/// Whether a file name is that of a numbered frame: five digits and `.png`.
pub fn is_frame_name(name: &str) -> bool {
    name.strip_suffix(".png").is_some_and(|number| number.len() == 5 && number.bytes().all(|b| b.is_ascii_digit()))
}

/// Writes frames into a new folder, which replaces an older one only when that holds nothing but numbered frames.
#[derive(Debug)]
pub struct PngFolder {
    folder: AtomicFolder,
    options: SinkOptions,
    frames: usize,
}

impl PngFolder {
    /// Makes the folder under a temporary name.
    ///
    /// # Errors
    /// When the folder holds other files or its parent cannot be written to.
    pub fn create(path: &Path, options: SinkOptions) -> Result<Self> {
        Ok(Self { folder: AtomicFolder::create(path, is_frame_name)?, options, frames: 0 })
    }

    fn write(&mut self, encoded: Result<Vec<u8>, png::EncodingError>) -> Result<()> {
        let path = self.folder.path();
        if self.frames == MAX_FRAMES {
            return Err(Error::file(Kind::Limit, path, "too many frames").allowed(format!("up to {MAX_FRAMES}")));
        }
        let bytes = encoded.map_err(|e| Error::file(Kind::Io, path, format!("cannot encode PNG: {e}")).source(e))?;
        self.folder.write(&format!("{:05}.png", self.frames), &bytes)?;
        self.frames += 1;
        Ok(())
    }
}

impl Sink for PngFolder {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        check_frame(self.folder.path(), frame, self.options)?;
        self.write(encode_png(frame, png::Compression::Fast))
    }

    fn push_with_alpha(&mut self, frame: &Rgb8, alpha: &[u8]) -> Result<()> {
        check_frame(self.folder.path(), frame, self.options)?;
        check_alpha(self.folder.path(), frame, alpha, self.options)?;
        let pixels = frame.data.chunks_exact(3).zip(alpha);
        let packed: Vec<u8> = pixels.flat_map(|(p, &a)| [p[0], p[1], p[2], a]).collect();
        self.write(encode_rgba_png((frame.width, frame.height), &packed, png::Compression::Fast))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        if self.frames == 0 {
            return Err(Error::file(Kind::Unusable, self.folder.path(), "no frame was written"));
        }
        self.folder.commit()
    }
}
