//! What animated PNG and WebP share: frames as changed rectangles, compressed side by side on all threads, written in
//! order, each with its time.
//!
//! Memory holds a frame or two per thread. Browsers show frames of up to 10 ms for 100 ms: above 90 frames per second
//! some are left out, so that the animation keeps its speed.

use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

use super::clip::Sink;
use super::patch::{Differ, Patch};
use super::sink::{FrameRate, SinkOptions, check_alpha, check_frame};
use crate::base::atomic_file::AtomicFile;
use crate::base::error::{Error, Kind, Result};
use crate::base::par;
use crate::raster::image::Rgb8;

/// Shortest time that browsers show a frame for, in milliseconds.
pub(super) const SHORTEST: u64 = 11;
/// Most frames compressed at the same time.
const MAX_BATCH: usize = 16;

/// A file format of patches.
pub(super) trait Format: Send + Sync {
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

/// Writes an animation.
pub(super) struct AnimationWriter<F: Format> {
    out: BufWriter<AtomicFile>,
    format: F,
    options: SinkOptions,
    differ: Differ,
    /// Patches to compress, with the number of the frame they show.
    waiting: Vec<(usize, Patch)>,
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
        let mut writer = Self { out, format, options, differ, waiting: Vec::new(), frames: 0, written: 0, bytes: 0 };
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
        if self.waiting.last().is_some_and(|(last, _)| time(number) < time(*last) + SHORTEST) {
            return Ok(());
        }
        self.waiting.push((number, self.differ.next(frame, alpha)));
        let batch = par::threads().min(MAX_BATCH);
        if self.waiting.len() > batch { self.flush(batch, number) } else { Ok(()) }
    }

    /// Writes the first `count` waiting patches; the last is shown until the next waiting one, or else until `end`.
    fn flush(&mut self, count: usize, end: usize) -> Result<()> {
        let waiting = std::mem::take(&mut self.waiting);
        let compress = |i: usize| {
            F::compress(&waiting[i].1)
                .map_err(|e| Error::file(Kind::Io, self.path(), format!("cannot encode a frame: {e}")).source(e))
        };
        let pixels = par::try_map(count, compress)?;
        for (i, pixels) in pixels.iter().enumerate() {
            let (start, patch) = &waiting[i];
            let shown = *start..waiting.get(i + 1).map_or(end, |(next, _)| *next);
            let bytes = self.format.frame(patch, pixels, shown, self.options.rate);
            self.write(&bytes)?;
        }
        self.written += count;
        self.waiting = waiting.into_iter().skip(count).collect();
        Ok(())
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
        self.flush(self.waiting.len(), self.frames)?;
        self.write(F::tail())?;
        let head = F::head(&self.options, self.written, self.bytes);
        let path = self.path().to_path_buf();
        let refused = |e| Error::io(&path, "write", e);
        self.out.seek(SeekFrom::Start(0)).and_then(|_| self.out.write_all(&head)).map_err(refused)?;
        self.out.into_inner().map_err(|e| refused(e.into_error()))?.commit()
    }
}
