//! Detail finer than a working pixel, carried along by the flow: the pieces have none to give at a large output, and
//! detail that stood still over moving water would look like a dirty window.

use std::ops::Range;

use macro_rules_attribute::apply;

use crate::base::instructions::kernel;
use crate::flow::field::Field;
use crate::raster::image::Plane;
use crate::raster::resample::Resizer;

/// Frames, at 25 a second, for which detail travels before it starts again.
const LIFE: f32 = 16.0;
/// Farthest that detail strays from its place, pixels of the working image.
const STRAY: f32 = 24.0;
/// Width of the slant by which places start at different times, pixels of the working image.
const SLANT: f32 = 256.0;

/// Fine detail in luma at output size, and the flow it travels along.
///
/// Two copies travel half a life apart from half a life's way before their place to as far behind it, and fade in and
/// out (Max & Becker 1995, "Flow visualization using moving textures"). Their weights keep the variance.
pub struct Drift {
    width: usize,
    height: usize,
    /// Per pixel the detail of itself, its right, lower and lower right neighbour, a byte each from the lowest up: 255ths
    /// of luma, times the matte. One read serves an interpolation.
    detail: Vec<u32>,
    /// Way of one life on cells, pixels of the output.
    way: Field,
    resizer: Resizer,
    /// Pixels of the output per pixel of the working image.
    scale: f32,
    /// Lives in the loop, and the loop's frames.
    lives: usize,
    frames: usize,
}

/// How detail travels in a loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Travel<'a> {
    /// Mean motion on cells, working pixels per frame of the library.
    pub motion: &'a Field,
    /// Frames of the library per frame of the output.
    pub pace: f32,
    /// Frames of the loop.
    pub frames: usize,
    /// Frames per second.
    pub fps: f32,
}

impl Drift {
    /// `detail` has `size` bytes, 255ths of luma; `working` is the size of the working image.
    ///
    /// # Panics
    /// When it has not.
    pub fn new(detail: Vec<i8>, size: (usize, usize), working: (usize, usize), travel: &Travel) -> Self {
        assert_eq!(detail.len(), size.0 * size.1);
        let Travel { motion, pace, frames, fps } = *travel;
        let lives = ((frames as f32 / (LIFE * fps / 25.0)).round() as usize).max(1);
        let life = frames as f32 / lives as f32;
        let scale = size.0 as f32 / working.0 as f32;
        let speed = motion.magnitude();
        let way = |plane: &Plane| {
            let bounded = |(p, s): (&f32, &f32)| p * scale * (pace * life).min(2.0 * STRAY / s.max(1e-6));
            Plane::from_vec(plane.width, plane.height, plane.data.iter().zip(&speed.data).map(bounded).collect())
        };
        let way = Field { u: way(&motion.u), v: way(&motion.v) };
        let resizer = Resizer::new((way.width(), way.height()), size);
        Self { width: size.0, height: size.1, detail: squares(&detail, size), way, resizer, scale, lives, frames }
    }

    /// The detail of frame `t` in a window of the output, in luma, row by row.
    pub fn window(&self, t: usize, x: Range<usize>, y: Range<usize>) -> Vec<f32> {
        let (u, v) = (self.way_in(&self.way.u, &x, &y), self.way_in(&self.way.v, &x, &y));
        let time = (t % self.frames) as f32 * self.lives as f32 / self.frames as f32;
        let mut out = vec![0.0; u.data.len()];
        let width = x.len().max(1);
        for (j, (y, out)) in y.zip(out.chunks_exact_mut(width)).enumerate() {
            row(self, time, (x.start, y), u.row(j), v.row(j), out);
        }
        out
    }

    fn way_in(&self, plane: &Plane, x: &Range<usize>, y: &Range<usize>) -> Plane {
        self.resizer.window(plane, x.clone(), y.clone())
    }

    /// Bilinear value at whole-numbered pixel places, borders clamped.
    #[inline(always)]
    fn at(&self, (x, y): (f32, f32)) -> f32 {
        let (x, y) = (x.clamp(0.0, self.width as f32 - 1.0), y.clamp(0.0, self.height as f32 - 1.0));
        let (x0, y0) = (x as u32, y as u32);
        let (ax, ay) = (x - x0 as f32, y - y0 as f32);
        // The place is always inside; written so that the compiler may read many at once.
        let square = self.detail.get((y0 * self.width as u32 + x0) as usize).copied().unwrap_or(0);
        let value = |shift: u32| ((square << (24 - shift)) as i32 >> 24) as f32;
        let top = value(0) + ax * (value(8) - value(0));
        let bottom = value(16) + ax * (value(24) - value(16));
        top + ay * (bottom - top)
    }
}

/// Every pixel with its right, lower and lower right neighbour, borders clamped.
fn squares(detail: &[i8], (width, height): (usize, usize)) -> Vec<u32> {
    let at = |x: usize, y: usize| u32::from(detail[y.min(height - 1) * width + x.min(width - 1)] as u8);
    let square = |x, y| at(x, y) | at(x + 1, y) << 8 | at(x, y + 1) << 16 | at(x + 1, y + 1) << 24;
    (0..height).flat_map(|y| (0..width).map(move |x| square(x, y))).collect()
}

/// Detail of the pixels `from` one to the right, of ways `u`, `v`.
#[apply(kernel)]
fn row(drift: &Drift, time: f32, from: (usize, usize), u: &[f32], v: &[f32], out: &mut [f32]) {
    let (left, y) = from;
    for (i, ((out, &u), &v)) in out.iter_mut().zip(u).zip(v).enumerate() {
        let x = left + i;
        let phase = time + (x + y) as f32 / (SLANT * drift.scale);
        let age = phase - phase as u32 as f32;
        let ages = [age - 0.5, if age < 0.5 { age } else { age - 1.0 }];
        let [a, b] = ages.map(|a| 1.0 - 2.0 * a.abs());
        // The two copies are as alike as places half a life's way apart are.
        let apart = (u * u + v * v) * 0.25 / (drift.scale * drift.scale);
        let alike = 1.0 / (1.0 + apart + 0.5 * apart * apart);
        let norm = (a * a + b * b + 2.0 * alike * a * b).sqrt().max(1e-3);
        let place = |age: f32| (x as f32 - age * u, y as f32 - age * v);
        let sum = a * drift.at(place(ages[0])) + b * drift.at(place(ages[1]));
        *out = sum / norm * (1.0 / 255.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    const SIZE: (usize, usize) = (192, 160);

    fn drift(u: f32) -> Drift {
        let noise = |i: usize| rng::below(rng::hash(2, &[i as u64]), 101) as i8 - 50;
        let motion = Field { u: Plane::filled(12, 10, u), v: Plane::zeros(12, 10) };
        let travel = Travel { motion: &motion, pace: 1.0, frames: 32, fps: 25.0 };
        Drift::new((0..SIZE.0 * SIZE.1).map(noise).collect(), SIZE, (48, 40), &travel)
    }

    fn variance(values: &[f32]) -> f32 {
        values.iter().map(|v| v * v).sum::<f32>() / values.len() as f32
    }

    #[test]
    fn without_motion_detail_stays_in_its_place() {
        let still = drift(0.0);
        for t in [0, 5, 31] {
            let out = still.window(t, 10..50, 20..40);
            for (i, v) in out.iter().enumerate() {
                let (x, y) = (10 + i % 40, 20 + i / 40);
                assert!((v * 255.0 - f32::from(still.detail[y * SIZE.0 + x] as u8 as i8)).abs() < 0.01);
            }
        }
    }

    #[test]
    fn with_motion_it_travels_repeats_and_keeps_its_contrast() {
        let moving = drift(1.0);
        let frame = |t| moving.window(t, 40..150, 40..120);
        assert_eq!(frame(0), frame(32));
        let mean = (0..32).map(|t| variance(&frame(t))).sum::<f32>() / 32.0;
        for t in 0..32 {
            assert!((variance(&frame(t)) / mean - 1.0).abs() < 0.25, "{t}");
        }
        // A working pixel a frame is four of the output.
        let (now, next) = (moving.window(3, 60..140, 40..120), moving.window(4, 64..144, 40..120));
        let same = now.iter().zip(&next).map(|(a, b)| (a - b) * (a - b)).sum::<f32>() / now.len() as f32;
        assert!(same < 0.5 * variance(&now), "{same} {}", variance(&now));
    }
}
