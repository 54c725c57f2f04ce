//! What animated PNG and WebP share: frames as changed rectangles, compressed side by side on all threads, written in
//! order, each with its time.
//!
//! Memory is bounded in bytes, whatever the number of threads. Browsers show frames of up to 10 ms for 100 ms: above 90 frames per second
//! some are left out, so that the animation keeps its speed.

use std::collections::VecDeque;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use super::options::{FrameRate, SinkOptions, check_alpha, check_frame};
use super::patch::{Differ, Patch};
use crate::base::atomic_file::AtomicFile;
use crate::base::error::{Error, Kind, Result};
use crate::base::par::Tasks;
use crate::raster::image::Rgb8;
use crate::video::clip::Sink;

/// Shortest time that browsers show a frame for, in milliseconds.
pub(super) const SHORTEST: u64 = 11;
/// Most bytes of the patches that wait to be compressed or are about to be.
const WAITING_BYTES: usize = 256 << 20;

/// A file format of patches.
pub(super) trait Format: Send + Sync + 'static {
    /// Left and top edges of patches are multiples of this.
    const ALIGN: usize;
    /// Most bytes of a file.
    const MAX_BYTES: u64;

    /// What stands before the frames, for `frames` of them in a file of `bytes` bytes; always of the same length.
    fn head(options: &SinkOptions, frames: usize, bytes: u64) -> Vec<u8>;
    /// Compresses the pixels of a patch.
    fn compress(patch: &Patch) -> image::ImageResult<Vec<u8>>;
    /// The patch as the file holds it, shown from one frame number to another.
    fn frame(&mut self, patch: &Patch, pixels: &[u8], shown: std::ops::Range<usize>, rate: FrameRate) -> Vec<u8>;
    /// What stands behind the frames.
    fn tail() -> &'static [u8];
}

/// Time of frame `i` in milliseconds: times are rounded, not delays, so that a second stays a second.
pub(super) fn milliseconds(i: usize, rate: FrameRate) -> u64 {
    let (n, d) = (u64::from(rate.numerator()), u64::from(rate.denominator()));
    (i as u64 * 1000 * d + n / 2) / n
}

/// A patch with its pixels as the file holds them.
type Compressed = (Patch, image::ImageResult<Vec<u8>>);

/// Writes an animation.
pub(super) struct AnimationWriter<F: Format> {
    out: BufWriter<AtomicFile>,
    format: F,
    options: SinkOptions,
    differ: Differ,
    compressing: Tasks<Compressed>,
    /// Numbers of the frames that are being compressed.
    numbers: VecDeque<usize>,
    /// Frames that came.
    frames: usize,
    /// Frames in the file.
    written: usize,
    bytes: u64,
}

impl<F: Format> AnimationWriter<F> {
    /// Starts a file under a temporary name.
    ///
    /// # Errors
    /// When the place cannot be written to.
    pub fn create(path: &Path, options: SinkOptions, format: F) -> Result<Self> {
        let out = BufWriter::new(AtomicFile::create(path)?);
        let differ = Differ::new(options.width, F::ALIGN);
        let (compressing, numbers) = (Tasks::new(WAITING_BYTES), VecDeque::new());
        let mut writer = Self { out, format, options, differ, compressing, numbers, frames: 0, written: 0, bytes: 0 };
        writer.write(&F::head(&options, 0, 0))?;
        Ok(writer)
    }

    fn path(&self) -> &Path {
        self.out.get_ref().path()
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.bytes += bytes.len() as u64;
        if self.bytes > F::MAX_BYTES {
            let problem = format!("the video is larger than a file of this format can be ({} GiB)", F::MAX_BYTES >> 30);
            return Err(Error::file(Kind::Limit, self.path(), problem)
                .remedy("ask for fewer frames or a smaller size, or write .mp4 or a folder of PNG frames"));
        }
        self.out.write_all(bytes).map_err(|e| Error::io(self.out.get_ref().path(), "write", e))
    }

    fn add(&mut self, frame: &Rgb8, alpha: Option<&[u8]>) -> Result<()> {
        check_frame(self.path(), frame, self.options)?;
        let number = self.frames;
        self.frames += 1;
        let time = |i| milliseconds(i, self.options.rate);
        if self.numbers.back().is_some_and(|&last| time(number) < time(last) + SHORTEST) {
            return Ok(());
        }
        let patch = self.differ.next(frame, alpha);
        let bytes = patch.pixels.len();
        while !self.compressing.has_room(bytes) {
            let compressed = self.compressing.wait();
            self.write_patch(compressed, number)?;
        }
        self.numbers.push_back(number);
        self.compressing.start(bytes, move || {
            let pixels = F::compress(&patch);
            (patch, pixels)
        });
        // How long the last one is shown is not known yet.
        while self.numbers.len() > 1
            && let Some(compressed) = self.compressing.ready()
        {
            self.write_patch(Some(compressed), number)?;
        }
        Ok(())
    }

    /// Writes the oldest patch, shown until the next one, or else until `end`.
    fn write_patch(&mut self, compressed: Option<Compressed>, end: usize) -> Result<()> {
        let (Some((patch, pixels)), Some(start)) = (compressed, self.numbers.pop_front()) else { return Ok(()) };
        let refused = |e| Error::file(Kind::Io, self.path(), format!("cannot encode a frame: {e}")).source(e);
        let pixels = pixels.map_err(refused)?;
        let shown = start..self.numbers.front().copied().unwrap_or(end);
        let bytes = self.format.frame(&patch, &pixels, shown, self.options.rate);
        self.written += 1;
        self.write(&bytes)
    }
}

impl<F: Format> Sink for AnimationWriter<F> {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        self.add(frame, None)
    }

    fn push_with_alpha(&mut self, frame: &Rgb8, alpha: &[u8]) -> Result<()> {
        check_alpha(self.path(), frame, alpha, self.options)?;
        self.add(frame, Some(alpha))
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        if self.frames == 0 {
            return Err(Error::file(Kind::Unusable, self.path(), "no frame was written"));
        }
        while let Some(compressed) = self.compressing.wait() {
            self.write_patch(Some(compressed), self.frames)?;
        }
        self.write(F::tail())?;
        let head = F::head(&self.options, self.written, self.bytes);
        let path = self.path().to_path_buf();
        let refused = |e| Error::io(&path, "write", e);
        self.out.seek(SeekFrom::Start(0)).and_then(|_| self.out.write_all(&head)).map_err(refused)?;
        self.out.into_inner().map_err(|e| refused(e.into_error()))?.commit()
    }
}
