//! Turns a picture into a painting: the generalised Kuwahara filter (Papari, Petkov & Campisi 2007) takes each pixel
//! from the smoothest of eight sectors around it, which leaves flat dabs of colour with sharp edges.

use enliven::base::par;
use enliven::raster::image::Rgb8;

use super::noise::fbm2;
use super::numeric::{cos, exp, pow, sin};

const SECTORS: usize = 8;

/// Neighbours with their weight in each sector.
struct Brush(Vec<(isize, isize, [f32; SECTORS])>);

impl Brush {
    fn round(radius: isize) -> Self {
        let mut cells = Vec::new();
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                let (x, y) = (dx as f32, dy as f32);
                let r2 = x * x + y * y;
                if r2 > (radius * radius) as f32 + 0.5 {
                    continue;
                }
                let fall = exp(-r2 / (0.5 * (radius * radius) as f32));
                let weights = std::array::from_fn(|s| {
                    let angle = std::f32::consts::TAU * s as f32 / SECTORS as f32;
                    let facing = if r2 == 0.0 { 0.6 } else { (x * cos(angle) + y * sin(angle)) / r2.sqrt() };
                    fall * ((facing - 0.55) / 0.45).clamp(0.0, 1.0)
                });
                cells.push((dx, dy, weights));
            }
        }
        Self(cells)
    }

    fn dab(&self, picture: &Rgb8, x: usize, y: usize) -> [f32; 3] {
        let mut sums = [[0.0f32; 5]; SECTORS];
        for (dx, dy, weights) in &self.0 {
            let px = (x as isize + dx).clamp(0, picture.width as isize - 1) as usize;
            let py = (y as isize + dy).clamp(0, picture.height as isize - 1) as usize;
            let p = picture.pixel(px, py).map(f32::from);
            let square = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
            for (sum, &weight) in sums.iter_mut().zip(weights) {
                for (part, value) in sum.iter_mut().zip([p[0], p[1], p[2], square, 1.0]) {
                    *part += weight * value;
                }
            }
        }
        let (mut out, mut norm) = ([0.0; 3], 0.0);
        for [r, g, b, square, weight] in sums {
            let mean = [r / weight, g / weight, b / weight];
            let variance = (square / weight - mean.iter().map(|m| m * m).sum::<f32>()).max(0.0);
            let trust = 1.0 / (1.0 + pow(variance / 120.0, 2.5));
            let trust = trust.max(1e-12);
            (0..3).for_each(|c| out[c] += trust * mean[c]);
            norm += trust;
        }
        out.map(|v| v / norm)
    }
}

/// The painting of `picture`, with dabs of `radius` pixels, richer colours and the weave of a canvas.
pub fn oil(picture: &Rgb8, radius: usize, seed: u32) -> Rgb8 {
    let brush = Brush::round(radius as isize);
    let mut out = Rgb8::black(picture.width, picture.height);
    par::for_each_chunk(&mut out.data, picture.width * 3, |y, row| {
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            let dab = brush.dab(picture, x, y);
            let grey = 0.2126 * dab[0] + 0.7152 * dab[1] + 0.0722 * dab[2];
            let (fx, fy) = (x as f32, y as f32);
            let bristle = 5.0 * fbm2(seed, (fx + 0.6 * fy) / 2.2, (fy - 0.6 * fx) / 9.0, 2);
            for (byte, value) in pixel.iter_mut().zip(dab) {
                *byte = (grey + 1.18 * (value - grey) + bristle).clamp(0.0, 255.0).round() as u8;
            }
        }
    });
    out
}
