//! Antialiased resizing.

use std::ops::Range;

use macro_rules_attribute::apply;

use super::catmull_rom::kernel_f32;
use super::image::{Color, Plane, Rgb8, Space};
use crate::base::instructions::kernel;
use crate::base::par;

/// Weights of one output sample: first input index and taps.
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

/// Catmull–Rom taps for every output sample, widened when shrinking; weights outside the input go to the border.
fn taps(input: usize, output: usize) -> Vec<Taps> {
    let ratio = input as f32 / output as f32;
    let widen = ratio.max(1.0);
    let at = |o: usize| {
        let centre = (o as f32 + 0.5) * ratio;
        let low = (centre - 2.0 * widen).floor() as isize;
        let high = (centre + 2.0 * widen).ceil() as isize;
        let last = input as isize - 1;
        let first = low.clamp(0, last);
        let mut weights = vec![0.0; (high.clamp(0, last) - first + 1) as usize];
        for i in low..=high {
            weights[(i.clamp(0, last) - first) as usize] += kernel_f32((i as f32 + 0.5 - centre) / widen);
        }
        let sum: f32 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        Taps { first: first as usize, weights }
    };
    (0..output).map(at).collect()
}

/// A size shrunk to a long side of at most `long` pixels, and never enlarged.
pub fn shrunk((width, height): (usize, usize), long: usize) -> (usize, usize) {
    let ratio = (long as f64 / width.max(height).max(1) as f64).min(1.0);
    let of = |side: usize| ((side as f64 * ratio).round() as usize).max(1);
    (of(width), of(height))
}

/// Resizes a plane to `width` × `height` with a Catmull–Rom kernel, widened when shrinking (antialiased). Values may
/// overshoot slightly at edges.
pub fn resize(plane: &Plane, width: usize, height: usize) -> Plane {
    if (plane.width, plane.height) == (width, height) {
        return plane.clone();
    }
    resize_rows((plane.width, plane.height), (width, height), |y, row| row.copy_from_slice(plane.row(y)))
}

/// [`resize`] between two sizes, window by window.
pub struct Resizer {
    horizontal: Vec<Taps>,
    vertical: Vec<Taps>,
    same: bool,
}

impl Resizer {
    /// From planes of one width and height to another.
    pub fn new(from: (usize, usize), to: (usize, usize)) -> Self {
        Self { horizontal: taps(from.0, to.0), vertical: taps(from.1, to.1), same: from == to }
    }

    /// The pixels `x`, `y` of the resized plane, as [`resize`] would give them.
    ///
    /// # Panics
    /// When the plane is smaller than it was said to be or the window reaches beyond the resized one.
    pub fn window(&self, plane: &Plane, x: Range<usize>, y: Range<usize>) -> Plane {
        if self.same {
            let data = y.clone().flat_map(|y| &plane.row(y)[x.clone()]).copied().collect();
            return Plane::from_vec(x.len(), y.len(), data);
        }
        let (horizontal, vertical) = (&self.horizontal[x], &self.vertical[y]);
        let first = vertical.first().map_or(0, |tap| tap.first);
        let end = vertical.last().map_or(0, |tap| tap.first + tap.weights.len());
        let mut narrow = Plane::zeros(horizontal.len(), end - first);
        let mut scratch = Scratch::new(plane.width, horizontal.len());
        for (g, group) in narrow.data.chunks_mut((LANES * horizontal.len()).max(1)).enumerate() {
            let read = |y: usize, row: &mut [f32]| row.copy_from_slice(plane.row(y));
            scratch.narrow(first + g * LANES, group, horizontal, &read);
        }
        let mut out = Plane::zeros(horizontal.len(), vertical.len());
        for (y, tap) in vertical.iter().enumerate() {
            for (i, &w) in tap.weights.iter().enumerate() {
                let row = narrow.row(tap.first - first + i);
                out.row_mut(y).iter_mut().zip(row).for_each(|(o, &v)| *o += w * v);
            }
        }
        out
    }
}

/// [`resize`] on each channel.
pub fn resize_color<S: Space>(image: &Color<S>, width: usize, height: usize) -> Color<S> {
    image.map_planes(|plane| resize(plane, width, height))
}

/// Channel `c` of packed 8-bit RGB, as values in [0, 1], resized like a plane; a large picture never exists in floats.
pub fn resize_channel(image: &Rgb8, c: usize, width: usize, height: usize) -> Plane {
    resize_rows((image.width, image.height), (width, height), |y, row| {
        let bytes = &image.data[3 * y * image.width..3 * (y + 1) * image.width];
        row.iter_mut().zip(bytes.chunks_exact(3)).for_each(|(v, p)| *v = f32::from(p[c]) * (1.0 / 255.0));
    })
}

/// [`resize`] on 8-bit RGB, rounded and clamped.
pub fn resize_rgb8(image: &Rgb8, width: usize, height: usize) -> Rgb8 {
    if (image.width, image.height) == (width, height) {
        return image.clone();
    }
    let mut out = Rgb8::black(width, height);
    for c in 0..3 {
        let plane = resize_channel(image, c, width, height);
        let pixels = out.data.chunks_exact_mut(3).zip(&plane.data);
        pixels.for_each(|(pixel, v)| pixel[c] = (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
    }
    out
}

/// Rows that are narrowed side by side, one in each lane of a register.
const LANES: usize = 16;
/// Output pixels from which the work is worth sharing among threads.
const SHARED: usize = 1 << 20;

/// Resizes what `read(y, row)` gives row by row: columns first, then rows.
fn resize_rows(
    (width_in, height_in): (usize, usize),
    (width, height): (usize, usize),
    read: impl Fn(usize, &mut [f32]) + Sync + Send,
) -> Plane {
    let large = width_in.max(width) * height_in.max(height) >= SHARED;
    let chunk = |rows: usize, all: usize| if large { rows } else { all };
    let horizontal = taps(width_in, width);
    let mut narrow = Plane::zeros(width, height_in);
    let rows = chunk(4 * LANES, height_in);
    par::for_each_chunk(&mut narrow.data, rows * width, |k, out| {
        let mut scratch = Scratch::new(width_in, width);
        for (g, group) in out.chunks_mut(LANES * width).enumerate() {
            scratch.narrow(k * rows + g * LANES, group, &horizontal, &read);
        }
    });
    let vertical = taps(height_in, height);
    let mut out = Plane::zeros(width, height);
    par::for_each_chunk(&mut out.data, chunk(LANES, height) * width, |k, rows| {
        for (row, tap) in rows.chunks_exact_mut(width).zip(&vertical[k * chunk(LANES, height)..]) {
            for (i, &w) in tap.weights.iter().enumerate() {
                row.iter_mut().zip(narrow.row(tap.first + i)).for_each(|(o, &v)| *o += w * v);
            }
        }
    });
    out
}

/// Room for a group of rows, turned so that the lanes of a register are rows.
struct Scratch {
    row: Vec<f32>,
    wide: Vec<[f32; LANES]>,
    narrow: Vec<[f32; LANES]>,
}

impl Scratch {
    fn new(width_in: usize, width: usize) -> Self {
        Self { row: vec![0.0; width_in], wide: vec![[0.0; LANES]; width_in], narrow: vec![[0.0; LANES]; width] }
    }

    /// Narrows the rows from `first` on into `out`, at most [`LANES`] of them.
    fn narrow(&mut self, first: usize, out: &mut [f32], taps: &[Taps], read: &impl Fn(usize, &mut [f32])) {
        let width = self.narrow.len();
        for lane in 0..out.len() / width {
            read(first + lane, &mut self.row);
            self.wide.iter_mut().zip(&self.row).for_each(|(wide, v)| wide[lane] = *v);
        }
        weigh(&self.wide, taps, &mut self.narrow);
        for (lane, row) in out.chunks_exact_mut(width).enumerate() {
            row.iter_mut().zip(&self.narrow).for_each(|(o, narrow)| *o = narrow[lane]);
        }
    }
}

#[apply(kernel)]
fn weigh(wide: &[[f32; LANES]], taps: &[Taps], narrow: &mut [[f32; LANES]]) {
    for (out, tap) in narrow.iter_mut().zip(taps) {
        let mut sums = [0.0f32; LANES];
        for (column, &weight) in wide[tap.first..].iter().zip(&tap.weights) {
            for (sum, v) in sums.iter_mut().zip(column) {
                *sum += v * weight;
            }
        }
        *out = sums;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_and_ramps_survive() {
        let flat = resize(&Plane::filled(13, 9, 0.7), 5, 20);
        assert!(flat.data.iter().all(|v| (v - 0.7).abs() < 1e-5));
        let ramp = resize(&Plane::from_fn(64, 4, |x, _| x as f32 + 0.5), 32, 4);
        for x in 4..28 {
            assert!((ramp.at(x, 1) - (x as f32 + 0.5) * 2.0).abs() < 1e-3);
        }
    }

    #[test]
    fn a_window_is_a_part_of_the_whole() {
        let plane = Plane::from_fn(31, 17, |x, y| (x * x + 3 * y) as f32);
        for (width, height) in [(70, 50), (12, 9), (31, 17)] {
            let whole = resize(&plane, width, height);
            let part = Resizer::new((31, 17), (width, height)).window(&plane, 3..9, 2..7);
            assert!((0..5).all(|y| part.row(y) == &whole.row(y + 2)[3..9]));
        }
    }

    #[test]
    fn bytes_are_resized_like_planes_on_any_number_of_threads() {
        for (from, to) in [((37, 21), (50, 9)), ((1, 1), (3, 2)), ((700, 2200), (333, 40)), ((40, 30), (1500, 1100))] {
            let data = (0..from.0 * from.1 * 3).map(|i| (i * i / 7 % 256) as u8).collect();
            let image = Rgb8 { width: from.0, height: from.1, data };
            let planes = resize_color(&image.to_color(), to.0, to.1);
            let run = |threads| par::with_threads(threads, || resize_rgb8(&image, to.0, to.1)).unwrap();
            assert_eq!(run(1), planes.to_rgb8());
            assert_eq!(run(1), run(3));
        }
    }

    #[test]
    fn shrinking_removes_what_the_small_image_cannot_hold() {
        let stripes = Plane::from_fn(64, 8, |x, _| (x % 2) as f32);
        let small = resize(&stripes, 16, 8);
        assert!(small.row(4)[1..15].iter().all(|v| (v - 0.5).abs() < 0.05), "{:?}", small.row(4));
    }
}
