//! A folder of PNG frames, `00000.png` on.

use std::path::Path;

use super::options::{SinkOptions, check_alpha, check_frame};
use crate::base::atomic_file::AtomicFolder;
use crate::base::error::{Error, Kind, Result};
use crate::base::par::Tasks;
use crate::raster::image::Rgb8;
use crate::raster::picture_io::{encode_png, encode_rgba_png};
use crate::video::clip::Sink;

/// Frames that five digits can number.
const MAX_FRAMES: usize = 100_000;
/// Most bytes of the frames that wait for the encoder or are in it, before and after.
const WAITING_BYTES: usize = 384 << 20;

/// Whether a file name is that of a numbered frame: five digits and `.png`.
pub fn is_frame_name(name: &str) -> bool {
    name.strip_suffix(".png").is_some_and(|number| number.len() == 5 && number.bytes().all(|b| b.is_ascii_digit()))
}

/// A frame as the bytes of a file.
type Encoded = Result<Vec<u8>, png::EncodingError>;

/// Writes frames into a new folder, which replaces an older one only when that holds nothing but numbered frames. A part
/// of the frames joins those that are there. Frames are encoded in the background, on all threads, and written in order.
pub struct PngFolder {
    folder: AtomicFolder,
    options: SinkOptions,
    /// Number of the first frame when the frames are a part of the video.
    part: Option<usize>,
    /// Number of the next frame to come, and of the next to be written.
    next: usize,
    unwritten: usize,
    encoding: Tasks<Encoded>,
}

impl PngFolder {
    /// Makes the folder under a temporary name; `part` is the number of the first frame where the frames are
    /// a part of the video.
    ///
    /// # Errors
    /// When the folder holds other files or its parent cannot be written to.
    pub fn create(path: &Path, part: Option<usize>, options: SinkOptions) -> Result<Self> {
        let folder = AtomicFolder::create(path, is_frame_name)?;
        let first = part.unwrap_or(0);
        Ok(Self { folder, options, part, next: first, unwritten: first, encoding: Tasks::new(WAITING_BYTES) })
    }

    /// Encodes a frame of `bytes` bytes in the background, after making room for it.
    fn encode(&mut self, bytes: usize, encode: impl FnOnce() -> Encoded + Send + 'static) -> Result<()> {
        if self.next == MAX_FRAMES {
            let error = Error::file(Kind::Limit, self.folder.path(), "too many frames");
            return Err(error.allowed(format!("up to {MAX_FRAMES}")));
        }
        // A frame that cannot be made smaller is as large encoded.
        let bytes = 2 * bytes;
        while !self.encoding.has_room(bytes) {
            let encoded = self.encoding.wait();
            self.write(encoded)?;
        }
        self.encoding.start(bytes, encode);
        self.next += 1;
        while let Some(encoded) = self.encoding.ready() {
            self.write(Some(encoded))?;
        }
        Ok(())
    }

    fn write(&mut self, encoded: Option<Encoded>) -> Result<()> {
        let Some(encoded) = encoded else { return Ok(()) };
        let path = self.folder.path();
        let bytes = encoded.map_err(|e| Error::file(Kind::Io, path, format!("cannot encode PNG: {e}")).source(e))?;
        self.folder.write(&format!("{:05}.png", self.unwritten), &bytes)?;
        self.unwritten += 1;
        Ok(())
    }
}

impl Sink for PngFolder {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        check_frame(self.folder.path(), frame, self.options)?;
        let frame = frame.clone();
        self.encode(frame.data.len(), move || encode_png(&frame, png::Compression::Fast))
    }

    fn push_with_alpha(&mut self, frame: &Rgb8, alpha: &[u8]) -> Result<()> {
        check_frame(self.folder.path(), frame, self.options)?;
        check_alpha(self.folder.path(), frame, alpha, self.options)?;
        let pixels = frame.data.chunks_exact(3).zip(alpha);
        let packed: Vec<u8> = pixels.flat_map(|(p, &a)| [p[0], p[1], p[2], a]).collect();
        let size = (frame.width, frame.height);
        self.encode(packed.len(), move || encode_rgba_png(size, &packed, png::Compression::Fast))
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        while let Some(encoded) = self.encoding.wait() {
            self.write(Some(encoded))?;
        }
        if self.next == self.part.unwrap_or(0) {
            return Err(Error::file(Kind::Unusable, self.folder.path(), "no frame was written"));
        }
        if self.part.is_some() { self.folder.commit_beside() } else { self.folder.commit() }
    }
}
