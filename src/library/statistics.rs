//! Per-pixel sums over a clip at one scale, from which the cells are made.

use crate::base::par;
use crate::descriptor::motion_spectrum::{self, HOP, MotionSpectrum, WINDOW};
use crate::descriptor::textureness::{self, Textureness, mirror_sum};
use crate::flow::field::Field;
use crate::raster::image::Plane;

use super::grid;

const _: () = assert!(grid::BANDS == motion_spectrum::BANDS && grid::TEXTURE_LEVELS == textureness::LEVELS);

/// Partial sums of the textureness, so that frames can be added in parallel: frame `t` goes to sum `t % 4`, and the
/// sums are added in order at the end, on any number of threads.
pub const PARTS: usize = 4;

/// Sums over the motion fields and frames of a clip at one scale.
#[derive(Debug, Clone)]
pub struct Statistics {
    width: usize,
    height: usize,
    fields: usize,
    /// Row by row: sums of u, of v, of the length, each `width` values.
    motion: Vec<f32>,
    /// Fields not yet in a window of the spectrum, or needed by the next.
    waiting: Vec<Field>,
    /// Motion spectrum of the windows so far.
    pub spectrum: MotionSpectrum,
    /// Textureness of the frames so far, in [`PARTS`] partial sums; one after [`Statistics::finish`].
    pub textureness: Vec<Textureness>,
}

impl Statistics {
    /// Nothing seen yet, for frames of `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            fields: 0,
            motion: vec![0.0; 3 * width * height],
            waiting: Vec::new(),
            spectrum: MotionSpectrum::new(width, height),
            textureness: vec![Textureness::new(width, height); PARTS],
        }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Adds consecutive motion fields; rows in parallel.
    pub fn add_fields(&mut self, fields: Vec<Field>) {
        let width = self.width;
        par::for_each_chunk(&mut self.motion, 3 * width, |y, sums| {
            let (u, rest) = sums.split_at_mut(width);
            let (v, length) = rest.split_at_mut(width);
            for field in &fields {
                let (fu, fv) = (field.u.row(y), field.v.row(y));
                for x in 0..width {
                    u[x] += fu[x];
                    v[x] += fv[x];
                    length[x] += (fu[x] * fu[x] + fv[x] * fv[x]).sqrt();
                }
            }
        });
        self.fields += fields.len();
        self.waiting.extend(fields);
        while self.waiting.len() >= WINDOW {
            let window: Vec<_> = self.waiting[..WINDOW].iter().map(|f| [&f.u, &f.v]).collect();
            self.spectrum.add_window(&window);
            self.waiting.drain(..HOP);
        }
    }

    /// Joins the partial sums once all frames were added, and forgets the waiting fields.
    pub fn finish(&mut self) {
        let mut parts = std::mem::take(&mut self.textureness).into_iter();
        if let Some(mut all) = parts.next() {
            parts.for_each(|part| all.merge(&part));
            self.textureness.push(all);
        }
        self.waiting = Vec::new();
    }

    /// Mean motion (u, v) and mean length of the motion over the square of `side` pixels at `(x, y)`, pixels of this
    /// scale per frame.
    pub fn motion(&self, x: usize, y: usize, side: usize) -> [f32; 3] {
        let scale = 1.0 / (self.fields.max(1) * side * side) as f32;
        std::array::from_fn(|c| {
            let row = |y: usize| mirror_sum(&self.motion[(3 * y + c) * self.width + x..][..side]);
            (y..y + side).map(row).sum::<f32>() * scale
        })
    }

    /// Mean length of the motion per pixel, pixels of this scale per frame.
    pub fn activity(&self) -> Plane {
        Plane::from_fn(self.width, self.height, |x, y| self.motion(x, y, 1)[2])
    }
}

/// Temporal standard deviation of the luma, summed relative to the first frame so that nothing cancels.
#[derive(Debug, Clone, Default)]
pub struct Deviation {
    first: Plane,
    /// Row by row: sums of the difference from the first frame and of its square.
    sums: Vec<f32>,
    frames: usize,
}

impl Deviation {
    /// Adds consecutive frames' luma; rows in parallel.
    pub fn add(&mut self, lumas: &[&Plane]) {
        let Some(first) = lumas.first() else { return };
        if self.frames == 0 {
            self.first = (*first).clone();
            self.sums = vec![0.0; 2 * first.data.len()];
        }
        let (width, first) = (self.first.width, &self.first);
        par::for_each_chunk(&mut self.sums, 2 * width, |y, row| {
            let (sum, square) = row.split_at_mut(width);
            for luma in lumas {
                for (x, (value, first)) in luma.row(y).iter().zip(first.row(y)).enumerate() {
                    let d = value - first;
                    sum[x] += d;
                    square[x] += d * d;
                }
            }
        });
        self.frames += lumas.len();
    }

    /// Standard deviation per pixel, of luma in [0, 1].
    pub fn plane(&self) -> Plane {
        let scale = 1.0 / self.frames.max(1) as f32;
        let width = self.first.width;
        Plane::from_fn(width, self.first.height, |x, y| {
            let mean = self.sums[2 * y * width + x] * scale;
            (self.sums[(2 * y + 1) * width + x] * scale - mean * mean).max(0.0).sqrt()
        })
    }
}
