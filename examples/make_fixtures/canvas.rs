//! A linear-light picture that is drawn at twice its final size.

use enliven::base::par;
use enliven::raster::image::Rgb8;

use super::numeric::{exp, mix, pow, step};

/// Red, green, blue in linear light.
pub type Light = [f32; 3];

/// Subsamples per pixel side.
pub const SS: usize = 2;

/// `a` at 0, `b` at 1.
pub fn blend(a: Light, b: Light, t: f32) -> Light {
    [mix(a[0], b[0], t), mix(a[1], b[1], t), mix(a[2], b[2], t)]
}

/// Every channel times `k`.
pub fn dim(a: Light, k: f32) -> Light {
    [a[0] * k, a[1] * k, a[2] * k]
}

/// Sum.
pub fn add(a: Light, b: Light) -> Light {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Product.
pub fn tint(a: Light, b: Light) -> Light {
    [a[0] * b[0], a[1] * b[1], a[2] * b[2]]
}

/// A picture in linear light; sizes in samples, positions in final pixels.
#[derive(Clone)]
pub struct Canvas {
    /// Samples in a row.
    pub width: usize,
    /// Rows of samples.
    pub height: usize,
    /// Samples, row by row.
    pub data: Vec<Light>,
}

impl Canvas {
    /// Black, for a final picture of `width` × `height` pixels.
    pub fn black(width: usize, height: usize) -> Self {
        let (width, height) = (width * SS, height * SS);
        Self { width, height, data: vec![[0.0; 3]; width * height] }
    }

    /// Replaces every sample by `f(x, y, old)`; x and y are sample centres in final pixels.
    pub fn paint(&mut self, f: impl Fn(f32, f32, Light) -> Light + Sync + Send) {
        let width = self.width;
        par::for_each_chunk(&mut self.data, width, |row, samples| {
            let y = (row as f32 + 0.5) / SS as f32;
            for (column, sample) in samples.iter_mut().enumerate() {
                *sample = f((column as f32 + 0.5) / SS as f32, y, *sample);
            }
        });
    }

    /// Draws a soft ellipse: centre and half axes in pixels, turned by the unit vector `along`; `colour` sees the
    /// position within it (±1, ±1).
    pub fn ellipse(
        &mut self,
        centre: (f32, f32),
        half: (f32, f32),
        along: (f32, f32),
        opacity: f32,
        colour: impl Fn(f32, f32) -> Light,
    ) {
        let scale = SS as f32;
        let reach = half.0.max(half.1) + 1.0;
        let low = |c: f32| ((c - reach) * scale).max(0.0) as usize;
        let high = |c: f32, end: usize| (((c + reach) * scale).max(0.0) as usize).min(end);
        let edge = 0.7 / half.0.min(half.1).max(0.35);
        for row in low(centre.1)..high(centre.1, self.height) {
            for column in low(centre.0)..high(centre.0, self.width) {
                let dx = (column as f32 + 0.5) / scale - centre.0;
                let dy = (row as f32 + 0.5) / scale - centre.1;
                let u = (dx * along.0 + dy * along.1) / half.0;
                let v = (dy * along.0 - dx * along.1) / half.1;
                let cover = step(1.0 + 0.5 * edge, 1.0 - 0.5 * edge, (u * u + v * v).sqrt()) * opacity;
                if cover > 0.0 {
                    let sample = &mut self.data[row * self.width + column];
                    *sample = blend(*sample, colour(u.clamp(-1.0, 1.0), v.clamp(-1.0, 1.0)), cover);
                }
            }
        }
    }

    /// Adds (towards white) a streak of `width` pixels from `tail` to `head`, strongest at the head.
    pub fn streak(&mut self, tail: (f32, f32), head: (f32, f32), width: f32, opacity: f32, colour: Light) {
        let scale = SS as f32;
        let (ax, ay) = (head.0 - tail.0, head.1 - tail.1);
        let length2 = (ax * ax + ay * ay).max(1e-3);
        let x0 = ((tail.0.min(head.0) - width) * scale).max(0.0) as usize;
        let x1 = (((tail.0.max(head.0) + width) * scale + 1.0).max(0.0) as usize).min(self.width);
        let y0 = ((tail.1.min(head.1) - width) * scale).max(0.0) as usize;
        let y1 = (((tail.1.max(head.1) + width) * scale + 1.0).max(0.0) as usize).min(self.height);
        for row in y0..y1 {
            for column in x0..x1 {
                let px = (column as f32 + 0.5) / scale - tail.0;
                let py = (row as f32 + 0.5) / scale - tail.1;
                let along = ((px * ax + py * ay) / length2).clamp(0.0, 1.0);
                let (dx, dy) = (px - along * ax, py - along * ay);
                let off = (dx * dx + dy * dy) / (width * width);
                if off < 1.0 {
                    let cover = opacity * (1.0 - off) * (1.0 - off) * (0.15 + 0.85 * along);
                    let sample = &mut self.data[row * self.width + column];
                    *sample = blend(*sample, colour, cover);
                }
            }
        }
    }

    /// Averages the samples of each pixel, rolls off the highlights and encodes as sRGB.
    pub fn develop(&self, exposure: f32) -> Rgb8 {
        let (width, height) = (self.width / SS, self.height / SS);
        let mut out = Rgb8::black(width, height);
        let table = SrgbTable::new();
        par::for_each_chunk(&mut out.data, width * 3, |row, bytes| {
            for (column, pixel) in bytes.chunks_exact_mut(3).enumerate() {
                let mut sum = [0.0; 3];
                for sample in (0..SS * SS).map(|i| (row * SS + i / SS) * self.width + column * SS + i % SS) {
                    sum = add(sum, self.data[sample]);
                }
                for (byte, value) in pixel.iter_mut().zip(sum) {
                    *byte = table.encode(shoulder(value * exposure / (SS * SS) as f32));
                }
            }
        });
        out
    }
}

/// Straight up to ½, then towards 1 without clipping.
fn shoulder(value: f32) -> f32 {
    if value < 0.5 { value } else { 1.0 - 0.5 * exp(-(value - 0.5) / 0.5) }
}

/// The sRGB curve.
pub fn encode(value: f32) -> f32 {
    let v = value.clamp(0.0, 1.0);
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * pow(v, 1.0 / 2.4) - 0.055 }
}

struct SrgbTable(Vec<u8>);

impl SrgbTable {
    fn new() -> Self {
        Self((0..=8192).map(|i| (encode(i as f32 / 8192.0) * 255.0 + 0.5) as u8).collect())
    }

    fn encode(&self, value: f32) -> u8 {
        self.0[(value.clamp(0.0, 1.0) * 8192.0 + 0.5) as usize]
    }
}
