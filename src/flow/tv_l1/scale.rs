//! Resampling between pyramid levels, with weights computed once from plain arithmetic.

use super::iterate::State;
use crate::raster::catmull_rom;

/// Interpolation weights of one axis.
#[derive(Debug, Clone, Default)]
pub(super) struct Axis {
    input: usize,
    firsts: Vec<usize>,
    taps: usize,
    weights: Vec<f32>,
}

impl Axis {
    /// Catmull–Rom weights from `input` to `output` samples, widened when shrinking.
    pub fn new(input: usize, output: usize) -> Self {
        let ratio = input as f64 / output as f64;
        let widen = ratio.max(1.0);
        let taps = ((4.0 * widen).ceil() as usize + 1).min(input);
        let mut axis = Self { input, taps, ..Self::default() };
        for o in 0..output {
            let centre = (o as f64 + 0.5) * ratio - 0.5;
            let low = (centre - 2.0 * widen).ceil() as isize;
            let high = (centre + 2.0 * widen).floor() as isize;
            let first = low.clamp(0, (input - taps) as isize);
            let mut weights = vec![0.0f64; taps];
            for i in low..=high {
                let place = i.clamp(0, input as isize - 1) - first;
                weights[place.clamp(0, taps as isize - 1) as usize] += catmull_rom::kernel((i as f64 - centre) / widen);
            }
            let sum: f64 = weights.iter().sum();
            axis.firsts.push(first as usize);
            axis.weights.extend(weights.iter().map(|w| (w / sum) as f32));
        }
        axis
    }

    fn output(&self) -> usize {
        self.firsts.len()
    }

    fn taps(&self, o: usize) -> (usize, &[f32]) {
        (self.firsts[o], &self.weights[o * self.taps..(o + 1) * self.taps])
    }
}

/// Resizes `image` into `out`; `rows` is scratch.
pub(super) fn resize(image: &[f32], x: &Axis, y: &Axis, rows: &mut Vec<f32>, out: &mut Vec<f32>) {
    out.clear();
    out.reserve(x.output() * y.output());
    for o in 0..y.output() {
        let (first, weights) = y.taps(o);
        rows.clear();
        rows.resize(x.input, 0.0);
        for (i, &w) in weights.iter().enumerate() {
            let source = &image[(first + i) * x.input..][..x.input];
            rows.iter_mut().zip(source).for_each(|(r, &s)| *r += w * s);
        }
        for p in 0..x.output() {
            let (first, weights) = x.taps(p);
            out.push(rows[first..].iter().zip(weights).map(|(r, w)| r * w).sum());
        }
    }
}

/// Bilinear interpolation of motion and dual variables from one level to the next finer one.
#[derive(Debug, Clone, Default)]
pub(super) struct Refine {
    /// Left neighbour of every column, and the share of the right one.
    columns: Vec<(u32, f32)>,
    /// One row interpolated over y, its last value repeated.
    row: Vec<f32>,
}

impl Refine {
    /// Fills `fine` with the motion and dual variables of `coarse`; motion vectors are scaled with the size.
    pub fn apply(&mut self, coarse: &State, fine: &mut State) {
        let (sx, sy) = (coarse.width as f32 / fine.width as f32, coarse.height as f32 / fine.height as f32);
        self.columns.clear();
        self.columns.extend((0..fine.width).map(|x| place(x, sx, coarse.width)));
        self.row.resize(coarse.width + 1, 0.0);
        let gains = [1.0 / sx, 1.0 / sy, 1.0, 1.0, 1.0, 1.0];
        for y in 0..fine.height {
            let (top, share) = place(y, sy, coarse.height);
            let (top, bottom) = (top as usize, (top as usize + 1).min(coarse.height - 1));
            let rows = coarse.all_rows(top).zip(coarse.all_rows(bottom));
            for ((out, (top, bottom)), gain) in fine.row_mut(y).into_iter().zip(rows).zip(gains) {
                for ((r, t), b) in self.row.iter_mut().zip(top).zip(bottom) {
                    *r = gain * (t + share * (b - t));
                }
                self.row[coarse.width] = self.row[coarse.width - 1];
                for (out, &(left, share)) in out.iter_mut().zip(&self.columns) {
                    let pair = &self.row[left as usize..left as usize + 2];
                    *out = pair[0] + share * (pair[1] - pair[0]);
                }
            }
        }
        fine.close_borders();
    }
}

/// Sample below output `o` among `size` samples, and the share of the next one.
fn place(o: usize, scale: f32, size: usize) -> (u32, f32) {
    let at = ((o as f32 + 0.5) * scale - 0.5).max(0.0);
    let low = (at as usize).min(size - 1);
    (low as u32, (at - low as f32).min(1.0))
}
