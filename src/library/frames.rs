//! Lossless frames: planes decorrelated in colour, differences over time, zstd.
//!
//! A frame becomes the planes G, R − G, B − G (mod 256). Every 16th frame is a keyframe, whose planes are coded as
//! differences to the pixel above; the others are differences to the previous frame. Both are undone exactly.

use macro_rules_attribute::apply;

use crate::base::error::Result;
use crate::base::instructions::kernel;
use crate::raster::image::{Plane, Rgb8, luma};

use super::format::damaged;

/// Distance between keyframes, frames.
pub const KEYFRAME_EVERY: usize = 16;
/// zstd level: decoding speed matters more than the last per cent.
const LEVEL: i32 = 1;

/// Planes G, R − G, B − G of a frame, one after the other.
type Planes = Vec<u8>;

fn to_planes(frame: &Rgb8, planes: &mut Planes) {
    let n = frame.width * frame.height;
    planes.resize(3 * n, 0);
    let (g, rest) = planes.split_at_mut(n);
    let (r, b) = rest.split_at_mut(n);
    for (((pixel, g), r), b) in frame.data.chunks_exact(3).zip(g).zip(r).zip(b) {
        *g = pixel[1];
        *r = pixel[0].wrapping_sub(pixel[1]);
        *b = pixel[2].wrapping_sub(pixel[1]);
    }
}

fn from_planes(planes: &[u8], width: usize, height: usize) -> Rgb8 {
    let n = width * height;
    let mut frame = Rgb8::black(width, height);
    let (g, rest) = planes.split_at(n);
    let (r, b) = rest.split_at(n);
    for (((pixel, &g), &r), &b) in frame.data.chunks_exact_mut(3).zip(g).zip(r).zip(b) {
        pixel[0] = r.wrapping_add(g);
        pixel[1] = g;
        pixel[2] = b.wrapping_add(g);
    }
    frame
}

/// Luma from the planes G, R − G, B − G.
#[apply(kernel)]
fn luma_of(green: &[u8], red: &[u8], blue: &[u8], out: &mut [f32]) {
    for (((out, &g), &r), &b) in out.iter_mut().zip(green).zip(red).zip(blue) {
        *out = luma([r.wrapping_add(g), g, b.wrapping_add(g)].map(f32::from)) / 255.0;
    }
}

/// Turns the frames of one clip into blobs, in order.
pub struct Encoder {
    width: usize,
    planes: Planes,
    previous: Planes,
    difference: Planes,
    count: usize,
    compressor: zstd::bulk::Compressor<'static>,
}

impl Encoder {
    /// For a clip whose frames are `width` pixels wide.
    ///
    /// # Errors
    /// When the compressor cannot be made (memory).
    pub fn new(width: usize) -> Result<Self> {
        let compressor = zstd::bulk::Compressor::new(LEVEL)
            .map_err(|e| crate::base::error::Error::new(crate::base::error::Kind::Limit, "frames", e.to_string()))?;
        Ok(Self { width, planes: Vec::new(), previous: Vec::new(), difference: Vec::new(), count: 0, compressor })
    }

    /// The next frame as a blob; all frames have the same size.
    ///
    /// # Errors
    /// When the compressor fails (memory).
    pub fn push(&mut self, frame: &Rgb8) -> Result<Vec<u8>> {
        to_planes(frame, &mut self.planes);
        self.difference.resize(self.planes.len(), 0);
        if self.count.is_multiple_of(KEYFRAME_EVERY) {
            let (first, rest) = self.planes.split_at(self.width);
            self.difference[..self.width].copy_from_slice(first);
            let above = self.planes.iter();
            self.difference[self.width..]
                .iter_mut()
                .zip(rest)
                .zip(above)
                .for_each(|((d, p), a)| *d = p.wrapping_sub(*a));
        } else {
            let pairs = self.planes.iter().zip(&self.previous);
            self.difference.iter_mut().zip(pairs).for_each(|(d, (p, q))| *d = p.wrapping_sub(*q));
        }
        std::mem::swap(&mut self.planes, &mut self.previous);
        self.count += 1;
        self.compressor
            .compress(&self.difference)
            .map_err(|e| crate::base::error::Error::new(crate::base::error::Kind::Limit, "frames", e.to_string()))
    }
}

/// Turns the blobs of one clip back into frames.
pub struct Decoder {
    width: usize,
    height: usize,
    planes: Planes,
    difference: Planes,
    /// Number of the frame `planes` holds.
    at: Option<usize>,
    decompressor: zstd::bulk::Decompressor<'static>,
}

impl Decoder {
    /// For a clip of `width` × `height` pixels.
    ///
    /// # Errors
    /// When the decompressor cannot be made (memory).
    pub fn new(width: usize, height: usize) -> Result<Self> {
        let decompressor = zstd::bulk::Decompressor::new()
            .map_err(|e| crate::base::error::Error::new(crate::base::error::Kind::Limit, "frames", e.to_string()))?;
        let n = 3 * width * height;
        Ok(Self { width, height, planes: vec![0; n], difference: vec![0; n], at: None, decompressor })
    }

    /// Brings the decoder to frame `t`; `blob(i)` gives the blob of frame `i`. Only the frames since the last
    /// keyframe, or since where the decoder stands, are decoded.
    ///
    /// # Errors
    /// Those of `blob`, or a named one when a blob is damaged.
    pub fn seek<'a>(&mut self, subject: &str, t: usize, mut blob: impl FnMut(usize) -> Result<&'a [u8]>) -> Result<()> {
        let key = t - t % KEYFRAME_EVERY;
        let start = match self.at {
            Some(at) if at == t => return Ok(()),
            Some(at) if at < t && at >= key => at + 1,
            _ => key,
        };
        for i in start..=t {
            self.at = None;
            self.step(subject, i, blob(i)?)?;
            self.at = Some(i);
        }
        Ok(())
    }

    fn step(&mut self, subject: &str, t: usize, blob: &[u8]) -> Result<()> {
        let written = self.decompressor.decompress_to_buffer(blob, &mut self.difference[..]);
        if !matches!(written, Ok(n) if n == self.planes.len()) {
            return Err(damaged(subject, format!("frame {t} cannot be decompressed")));
        }
        if t.is_multiple_of(KEYFRAME_EVERY) {
            self.planes[..self.width].copy_from_slice(&self.difference[..self.width]);
            for start in (self.width..self.planes.len()).step_by(self.width) {
                let (done, rest) = self.planes.split_at_mut(start);
                let above = &done[start - self.width..];
                let row = rest[..self.width].iter_mut().zip(&self.difference[start..]).zip(above);
                row.for_each(|((p, d), a)| *p = d.wrapping_add(*a));
            }
        } else {
            self.planes.iter_mut().zip(&self.difference).for_each(|(p, d)| *p = p.wrapping_add(*d));
        }
        Ok(())
    }

    /// The frame the decoder stands at.
    pub fn frame(&self) -> Rgb8 {
        from_planes(&self.planes, self.width, self.height)
    }

    /// Luma of that frame, as [`Rgb8::luma`] gives it.
    pub fn luma(&self) -> Plane {
        let mut luma = Plane::zeros(self.width, self.height);
        let (green, rest) = self.planes.split_at(luma.data.len());
        let (red, blue) = rest.split_at(luma.data.len());
        luma_of(green, red, blue, &mut luma.data);
        luma
    }
}
