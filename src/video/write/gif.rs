//! Animated GIF: 255 colours for the whole video, a dither that stays put, and only what changed from frame to frame.
//!
//! The palette needs all frames, so they wait, compressed, in a temporary file beside the output; memory is bounded.
//! GIF counts time in 1/100 s: frame times are rounded, not delays, so that a second stays a second. Browsers slow down
//! frames shorter than 2/100 s: above 50 frames per second some are left out.
//!
//! A pixel is seen or not: with opacity, those of half and more are. What is not seen shows nothing of earlier frames, so
//! each frame is then stored whole.

use std::borrow::Cow;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::options::{SinkOptions, check_alpha, check_frame};
use super::palette::{Histogram, Palette};
use super::patch::changed;
use crate::base::atomic_file::AtomicFile;
use crate::base::error::{Error, Kind, Result};
use crate::raster::image::Rgb8;
use crate::video::clip::Sink;

/// Palette index that means "as before", or "nothing here".
const UNCHANGED: u8 = 255;
/// Least opacity of a pixel that is seen.
const SEEN: u8 = 128;
/// Shortest delay that browsers honour, in 1/100 s.
const SHORTEST: u64 = 2;

/// Collects frames and writes an animated GIF.
pub struct GifWriter {
    out: AtomicFile,
    /// A second temporary file, which never gets a name.
    waiting: zstd::Encoder<'static, AtomicFile>,
    histogram: Histogram,
    /// The last frame: colours, then, where there is opacity, whether each pixel is seen.
    last: Vec<u8>,
    options: SinkOptions,
    frames: usize,
}

impl GifWriter {
    /// Starts a file under a temporary name.
    ///
    /// # Errors
    /// When the place cannot be written to.
    pub fn create(path: &Path, options: SinkOptions) -> Result<Self> {
        let out = AtomicFile::create(path)?;
        let waiting = AtomicFile::create(path)?;
        let waiting = zstd::Encoder::new(waiting, 1).map_err(|e| Error::io(path, "write", e))?;
        let last = vec![0; options.width * options.height * if options.alpha { 4 } else { 3 }];
        Ok(Self { out, waiting, histogram: Histogram::new(), last, options, frames: 0 })
    }

    /// Time of frame `i` in 1/100 s.
    fn time(&self, i: usize) -> u64 {
        let rate = self.options.rate;
        let (n, d) = (u64::from(rate.numerator()), u64::from(rate.denominator()));
        (i as u64 * 100 * d + n / 2) / n
    }

    /// Puts a frame with the others that wait for the palette.
    fn keep(&mut self, frame: Vec<u8>) -> Result<()> {
        let change: Vec<u8> = frame.iter().zip(&self.last).map(|(a, b)| a.wrapping_sub(*b)).collect();
        self.waiting.write_all(&change).map_err(|e| Error::io(self.out.path(), "write", e))?;
        self.last = frame;
        self.frames += 1;
        Ok(())
    }
}

impl Sink for GifWriter {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        check_frame(self.out.path(), frame, self.options)?;
        self.histogram.add(&frame.data);
        let seen = vec![1; self.last.len() - frame.data.len()];
        self.keep([&frame.data[..], &seen].concat())
    }

    fn push_with_alpha(&mut self, frame: &Rgb8, alpha: &[u8]) -> Result<()> {
        check_frame(self.out.path(), frame, self.options)?;
        check_alpha(self.out.path(), frame, alpha, self.options)?;
        let seen: Vec<u8> = alpha.iter().map(|&a| u8::from(a >= SEEN)).collect();
        let mut colours = frame.data.clone();
        colours.chunks_exact_mut(3).zip(&seen).filter(|(_, seen)| **seen == 0).for_each(|(p, _)| p.fill(0));
        let of_seen = |(p, _): (&[u8], &u8)| [p[0], p[1], p[2]];
        let shown = colours.chunks_exact(3).zip(&seen).filter(|(_, seen)| **seen == 1);
        self.histogram.add(&shown.flat_map(of_seen).collect::<Vec<u8>>());
        self.keep([colours, seen].concat())
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        let path: PathBuf = self.out.path().to_path_buf();
        if self.frames == 0 {
            return Err(Error::file(Kind::Unusable, &path, "no frame was written"));
        }
        let refused = |e: std::io::Error| Error::io(&path, "write", e);
        let times: Vec<u64> = (0..=self.frames).map(|i| self.time(i)).collect();
        let kept = kept_frames(&times);
        let palette = Palette::new(&self.histogram, usize::from(UNCHANGED));
        let mut waiting = self.waiting.finish().map_err(refused)?;
        waiting.seek(SeekFrom::Start(0)).map_err(refused)?;
        let mut frames = zstd::Decoder::new(BufReader::new(waiting)).map_err(refused)?;
        let (width, height) = (self.options.width, self.options.height);
        let mut gif = Encoder::new(BufWriter::new(self.out), &palette.rgb, (width, height), self.options.loops)?;
        let mut change = vec![0; self.last.len()];
        self.last.fill(0);
        let mut next = kept.iter().peekable();
        for i in 0..self.frames {
            frames.read_exact(&mut change).map_err(refused)?;
            self.last.iter_mut().zip(&change).for_each(|(v, c)| *v = v.wrapping_add(*c));
            if next.next_if_eq(&&i).is_some() {
                let end = next.peek().map_or(times[self.frames], |&&following| times[following]);
                let (colours, seen) = self.last.split_at(width * height * 3);
                gif.write(palette.dither(colours, width), seen, (end - times[i]).max(SHORTEST))?;
            }
        }
        gif.finish()?.commit()
    }
}

/// Frames to write, so that none is shown shorter than [`SHORTEST`]; the last of `times` is the end.
fn kept_frames(times: &[u64]) -> Vec<usize> {
    let mut kept: Vec<usize> = vec![0];
    for i in 1..times.len() - 1 {
        if times[i] >= times[kept[kept.len() - 1]] + SHORTEST && times[times.len() - 1] >= times[i] + SHORTEST {
            kept.push(i);
        }
    }
    kept
}

/// Writes frames of palette indices, each as the rectangle that changed.
struct Encoder {
    gif: gif::Encoder<BufWriter<AtomicFile>>,
    path: PathBuf,
    width: usize,
    shown: Vec<u8>,
}

impl Encoder {
    fn new(out: BufWriter<AtomicFile>, palette: &[u8], size: (usize, usize), loops: bool) -> Result<Self> {
        let path = out.get_ref().path().to_path_buf();
        let gif = gif::Encoder::new(out, size.0 as u16, size.1 as u16, palette).map_err(|e| failed(&path, e))?;
        let mut encoder = Self { gif, path, width: size.0, shown: Vec::new() };
        if loops {
            encoder.gif.set_repeat(gif::Repeat::Infinite).map_err(|e| failed(&encoder.path, e))?;
        }
        Ok(encoder)
    }

    /// Writes a frame; where there is opacity, `seen` has a 1 for every pixel that is seen, else it is empty.
    fn write(&mut self, mut indices: Vec<u8>, seen: &[u8], delay: u64) -> Result<()> {
        indices.iter_mut().zip(seen).filter(|(_, seen)| **seen == 0).for_each(|(index, _)| *index = UNCHANGED);
        if seen.is_empty() { self.write_change(indices, delay) } else { self.write_whole(&indices, delay) }
    }

    fn write_change(&mut self, indices: Vec<u8>, delay: u64) -> Result<()> {
        let width = self.width;
        let whole = (0..width, 0..indices.len() / width);
        let first = self.shown.is_empty();
        let (columns, rows) = if first { whole } else { changed(&self.shown, &indices, width, 1) };
        let mut buffer = Vec::with_capacity(columns.len() * rows.len());
        for y in rows.clone() {
            let row = y * width + columns.start..y * width + columns.end;
            if first {
                buffer.extend_from_slice(&indices[row]);
            } else {
                let pairs = indices[row.clone()].iter().zip(&self.shown[row]);
                buffer.extend(pairs.map(|(&new, &old)| if new == old { UNCHANGED } else { new }));
            }
        }
        self.shown = indices;
        let frame = gif::Frame {
            dispose: gif::DisposalMethod::Keep,
            transparent: (!first).then_some(UNCHANGED),
            buffer: Cow::Owned(buffer),
            ..gif::Frame::default()
        };
        self.write_frame((columns, rows), delay, frame)
    }

    /// Writes a frame that shows nothing of those before and leaves nothing to those after.
    fn write_whole(&mut self, indices: &[u8], delay: u64) -> Result<()> {
        let (columns, rows) = changed(&vec![UNCHANGED; indices.len()], indices, self.width, 1);
        let row = |y: usize| &indices[y * self.width + columns.start..y * self.width + columns.end];
        let frame = gif::Frame {
            dispose: gif::DisposalMethod::Background,
            transparent: Some(UNCHANGED),
            buffer: Cow::Owned(rows.clone().flat_map(row).copied().collect()),
            ..gif::Frame::default()
        };
        self.write_frame((columns, rows), delay, frame)
    }

    fn write_frame(&mut self, place: (Range<usize>, Range<usize>), delay: u64, mut frame: gif::Frame) -> Result<()> {
        let (columns, rows) = place;
        frame.delay = delay.min(u64::from(u16::MAX)) as u16;
        (frame.left, frame.top) = (columns.start as u16, rows.start as u16);
        (frame.width, frame.height) = (columns.len() as u16, rows.len() as u16);
        self.gif.write_frame(&frame).map_err(|e| failed(&self.path, e))
    }

    fn finish(self) -> Result<AtomicFile> {
        let out = self.gif.into_inner().map_err(|e| failed(&self.path, e))?;
        out.into_inner().map_err(|e| Error::io(&self.path, "write", e.into_error()))
    }
}

fn failed(path: &Path, error: gif::EncodingError) -> Error {
    match error {
        gif::EncodingError::Io(e) => Error::io(path, "write", e),
        other => Error::file(Kind::Io, path, format!("cannot encode GIF: {other}")).source(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_frame_is_shorter_than_browsers_show() {
        let times: Vec<u64> = (0..=60).map(|i| (i * 100 + 30) / 60).collect();
        let kept = kept_frames(&times);
        assert!(kept.windows(2).all(|w| times[w[1]] - times[w[0]] >= 2));
        assert_eq!((kept[0], times[60]), (0, 100));
        assert!(kept.len() >= 40);
        assert_eq!(kept_frames(&(0..=25).map(|i| i * 4).collect::<Vec<_>>()).len(), 25);
    }
}
