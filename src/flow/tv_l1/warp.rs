//! Linearisation of the data term around the present motion: the second frame, warped, and its derivatives.

use macro_rules_attribute::apply;

use super::iterate::State;
use crate::base::instructions::kernel;
use crate::raster::catmull_rom::weights_and_slopes;

/// Border of a [`Padded`] frame, pixels on every side.
const BORDER: usize = 3;

/// A frame with its border pixels repeated outwards, so that no tap needs clamping.
#[derive(Debug, Clone, Default)]
pub(super) struct Padded {
    width: usize,
    height: usize,
    stride: usize,
    data: Vec<f32>,
}

impl Padded {
    /// Takes over a frame of `width` × `height` values.
    pub fn fill(&mut self, width: usize, height: usize, frame: &[f32]) {
        (self.width, self.height, self.stride) = (width, height, width + 2 * BORDER);
        self.data.clear();
        for y in 0..height + 2 * BORDER {
            let source = y.saturating_sub(BORDER).min(height - 1);
            let row = &frame[source * width..(source + 1) * width];
            self.data.extend_from_slice(&[row[0]; BORDER]);
            self.data.extend_from_slice(row);
            self.data.extend_from_slice(&[row[width - 1]; BORDER]);
        }
    }

    /// Row `y` (of the frame; −3 to height + 2) with its borders.
    #[inline(always)]
    fn row(&self, y: isize) -> &[f32] {
        let start = (y + BORDER as isize) as usize * self.stride;
        &self.data[start..start + self.stride]
    }
}

/// Scratch of one row.
#[derive(Debug, Clone, Default)]
struct Row {
    /// First of the 4 × 4 taps of each pixel, an index into the padded frame.
    start: Vec<u32>,
    /// Share of a pixel past the second tap, horizontally.
    tx: Vec<f32>,
    /// Vertical weights of the four taps and their derivatives.
    wy: [Vec<f32>; 8],
    /// The taps summed over y, with the weights and with their derivatives.
    columns: Vec<[f32; 4]>,
    slopes: Vec<[f32; 4]>,
}

/// Linearises the residual around the present motion.
#[derive(Debug, Clone, Default)]
pub(super) struct Linearise {
    row: Row,
}

impl Linearise {
    /// Linearises `I₁(x + u) − I₀(x)` around the motion in `state`, with the gradient a mix of both frames' (`blend` of
    /// it from the first; ½ is symmetric in time). Where the motion leaves the picture there is no data.
    pub fn apply(&mut self, state: &mut State, from: &Padded, to: &Padded, blend: f32) {
        let (width, height) = (state.width, state.height);
        self.row.start.resize(width, 0);
        self.row.tx.resize(width, 0.0);
        self.row.wy.iter_mut().for_each(|w| w.resize(width, 0.0));
        self.row.columns.resize(width, [0.0; 4]);
        self.row.slopes.resize(width, [0.0; 4]);
        for y in 0..height {
            let [u, v, _, _, _, _, ix, iy, residual, inverse] = state.row_mut(y);
            place(&mut self.row, y as f32, u, v, to);
            gather(&mut self.row, to);
            let own: [&[f32]; 5] = std::array::from_fn(|i| from.row(y as isize + i as isize - 2));
            combine(&self.row, y as f32, height, own, blend, (u, v), (ix, iy), (residual, inverse));
        }
    }
}

/// Where the taps of each pixel of row `y` begin, and their weights.
#[apply(kernel)]
fn place(row: &mut Row, y: f32, u: &[f32], v: &[f32], to: &Padded) {
    let n = u.len();
    let (start, tx, v) = (&mut row.start[..n], &mut row.tx[..n], &v[..n]);
    let [w0, w1, w2, w3, d0, d1, d2, d3] = row.wy.each_mut().map(|w| &mut w[..n]);
    let (right, bottom) = (to.width as f32, to.height as f32);
    let stride = to.stride as i32;
    for x in 0..n {
        let sx = (x as f32 + u[x]).clamp(-1.0, right);
        let sy = (y + v[x]).clamp(-1.0, bottom);
        let (x0, y0) = (sx.floor(), sy.floor());
        tx[x] = sx - x0;
        start[x] = ((y0 as i32 + (BORDER as i32 - 1)) * stride + (x0 as i32 + (BORDER as i32 - 1))) as u32;
        let (w, d) = weights_and_slopes(sy - y0);
        (w0[x], w1[x], w2[x], w3[x]) = (w[0], w[1], w[2], w[3]);
        (d0[x], d1[x], d2[x], d3[x]) = (d[0], d[1], d[2], d[3]);
    }
}

/// Sums the taps of each pixel over y.
#[apply(kernel)]
fn gather(row: &mut Row, to: &Padded) {
    let n = row.start.len();
    let (columns, slopes) = (&mut row.columns[..n], &mut row.slopes[..n]);
    let wy = row.wy.each_ref().map(|w| &w[..n]);
    let span = 3 * to.stride + 4;
    for x in 0..n {
        let taps = &to.data[row.start[x] as usize..][..span];
        let (mut column, mut slope) = ([0.0f32; 4], [0.0f32; 4]);
        for i in 0..4 {
            let taps = &taps[i * to.stride..][..4];
            for j in 0..4 {
                column[j] = wy[i][x].mul_add(taps[j], column[j]);
                slope[j] = wy[i + 4][x].mul_add(taps[j], slope[j]);
            }
        }
        columns[x] = column;
        slopes[x] = slope;
    }
}

/// Finishes a row: interpolated value and derivatives, the residual and what the thresholding step needs of them.
#[apply(kernel)]
#[allow(clippy::too_many_arguments)]
fn combine(
    row: &Row,
    y: f32,
    height: usize,
    own: [&[f32]; 5],
    blend: f32,
    motion: (&[f32], &[f32]),
    derivatives: (&mut [f32], &mut [f32]),
    residuals: (&mut [f32], &mut [f32]),
) {
    let ((u, v), (ix, iy), (residual, inverse)) = (motion, derivatives, residuals);
    let n = u.len();
    let (columns, slopes, tx, v) = (&row.columns[..n], &row.slopes[..n], &row.tx[..n], &v[..n]);
    let (ix, iy, residual, inverse) = (&mut ix[..n], &mut iy[..n], &mut residual[..n], &mut inverse[..n]);
    let along: [&[f32]; 5] = std::array::from_fn(|i| &own[2][BORDER - 2 + i..][..n]);
    let across = own.map(|row| &row[BORDER..][..n]);
    let (right, bottom) = ((n - 1) as f32, (height - 1) as f32);
    for x in 0..n {
        let (sx, sy) = (x as f32 + u[x], y + v[x]);
        let inside = (sx >= 0.0) & (sx <= right) & (sy >= 0.0) & (sy <= bottom);
        let (w, d) = weights_and_slopes(tx[x]);
        let (value, dx, dy) = (dot(w, columns[x]), dot(d, columns[x]), dot(w, slopes[x]));
        let own_dx = derivative(along[0][x], along[1][x], along[3][x], along[4][x]);
        let own_dy = derivative(across[0][x], across[1][x], across[3][x], across[4][x]);
        let gx = blend.mul_add(own_dx - dx, dx);
        let gy = blend.mul_add(own_dy - dy, dy);
        let square = gx.mul_add(gx, gy * gy);
        let rest = gx.mul_add(-u[x], gy.mul_add(-v[x], value - across[2][x]));
        let weight = if inside { 1.0 } else { 0.0 };
        ix[x] = weight * gx;
        iy[x] = weight * gy;
        residual[x] = weight * rest;
        inverse[x] = weight / if square > 1e-9 { square } else { 1e-9 };
    }
}

#[inline(always)]
fn dot(a: [f32; 4], b: [f32; 4]) -> f32 {
    (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3])
}

/// Fourth-order central difference from the values at −2, −1, 1, 2.
#[inline(always)]
fn derivative(a: f32, b: f32, d: f32, e: f32) -> f32 {
    (8.0 * (d - b) - (e - a)) * (1.0 / 12.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    /// One pixel of the linearisation from its definition, compiled for the plain instruction set: Ix, Iy, residual,
    /// inverse.
    fn pixel(from: &Padded, to: &Padded, x: usize, y: usize, u: f32, v: f32, blend: f32) -> [f32; 4] {
        let (width, height) = (from.width as f32, from.height as f32);
        let at = |frame: &Padded, x: isize, y: isize| frame.row(y)[(x + BORDER as isize) as usize];
        let (sx, sy) = ((x as f32 + u).clamp(-1.0, width), (y as f32 + v).clamp(-1.0, height));
        let (x0, y0) = (sx.floor(), sy.floor());
        let ((wx, dx), (wy, dy)) = (weights_and_slopes(sx - x0), weights_and_slopes(sy - y0));
        let (mut column, mut slope) = ([0.0f32; 4], [0.0f32; 4]);
        for (i, j) in (0..4).flat_map(|i| (0..4).map(move |j| (i, j))) {
            let tap = at(to, x0 as isize - 1 + j as isize, y0 as isize - 1 + i as isize);
            column[j] = wy[i].mul_add(tap, column[j]);
            slope[j] = dy[i].mul_add(tap, slope[j]);
        }
        let (value, dx, dy) = (dot(wx, column), dot(dx, column), dot(wx, slope));
        let own = |i: isize, j: isize| at(from, x as isize + i, y as isize + j);
        let gx = blend.mul_add(derivative(own(-2, 0), own(-1, 0), own(1, 0), own(2, 0)) - dx, dx);
        let gy = blend.mul_add(derivative(own(0, -2), own(0, -1), own(0, 1), own(0, 2)) - dy, dy);
        let residual = gx.mul_add(-u, gy.mul_add(-v, value - own(0, 0)));
        let inside = |place: f32, size: f32| place >= 0.0 && place <= size - 1.0;
        let weight = if inside(x as f32 + u, width) && inside(y as f32 + v, height) { 1.0 } else { 0.0 };
        [weight * gx, weight * gy, weight * residual, weight / gx.mul_add(gx, gy * gy).max(1e-9)]
    }

    #[test]
    fn rows_equal_single_pixels_bit_for_bit() {
        for (width, height) in [(1, 1), (3, 2), (17, 5), (40, 9)] {
            let frame = |seed: u64| {
                let mut padded = Padded::default();
                let data: Vec<f32> = (0..width * height).map(|i| rng::unit(rng::hash(seed, &[i as u64]))).collect();
                padded.fill(width, height, &data);
                padded
            };
            let (from, to) = (frame(1), frame(2));
            let mut state = State::default();
            state.resize(width, height);
            let motion = |seed: u64, i: usize| {
                // Some vectors leave the picture, one of them by far.
                let wild = if i % 11 == 7 { 1e9 } else { 6.0 };
                wild * (rng::unit(rng::hash(seed, &[i as u64])) - 0.5)
            };
            for y in 0..height {
                let [u, v, ..] = state.row_mut(y);
                (0..width).for_each(|x| (u[x], v[x]) = (motion(3, y * width + x), motion(4, y * width + x)));
            }
            Linearise::default().apply(&mut state, &from, &to, 0.5);
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let i = y * width + x;
                let expected = pixel(&from, &to, x, y, motion(3, i), motion(4, i), 0.5);
                let [.., ix, iy, residual, inverse] = state.row_mut(y);
                let got = [ix[x], iy[x], residual[x], inverse[x]];
                assert_eq!(got.map(f32::to_bits), expected.map(f32::to_bits), "{width}x{height} at {x},{y}: {got:?}");
            }
        }
    }

    #[test]
    fn the_interpolant_is_exact_on_parabolas() {
        let (width, height) = (12, 10);
        let parabola = |x: f32, y: f32| 0.02 * x * x - 0.01 * x * y + 0.03 * y - 0.1;
        let data: Vec<f32> = (0..width * height).map(|i| parabola((i % width) as f32, (i / width) as f32)).collect();
        let mut frame = Padded::default();
        frame.fill(width, height, &data);
        let mut state = State::default();
        state.resize(width, height);
        let [u, v, ..] = state.row_mut(4);
        u.fill(0.3);
        v.fill(-0.6);
        Linearise::default().apply(&mut state, &frame, &frame, 0.0);
        let [.., ix, iy, _, _] = state.row_mut(4);
        for x in 2..width - 3 {
            let (sx, sy) = (x as f32 + 0.3, 3.4);
            assert!((ix[x] - (0.04 * sx - 0.01 * sy)).abs() < 1e-5, "{}", ix[x]);
            assert!((iy[x] - (0.03 - 0.01 * sx)).abs() < 1e-5, "{}", iy[x]);
        }
    }
}
