//! Linearisation of the data term around the present motion: the second frame, warped, and its derivatives.

use multiversion::multiversion;

use super::iterate::State;

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
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
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
        let (w, d) = cubic(sy - y0);
        (w0[x], w1[x], w2[x], w3[x]) = (w[0], w[1], w[2], w[3]);
        (d0[x], d1[x], d2[x], d3[x]) = (d[0], d[1], d[2], d[3]);
    }
}

/// Sums the taps of each pixel over y.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
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
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
#[allow(clippy::too_many_arguments)]
fn combine(
    row: &Row,
    y: f32,
    height: usize,
    own: [&[f32]; 5],
    blend: f32,
    (u, v): (&[f32], &[f32]),
    (ix, iy): (&mut [f32], &mut [f32]),
    (residual, inverse): (&mut [f32], &mut [f32]),
) {
    let n = u.len();
    let (columns, slopes, tx, v) = (&row.columns[..n], &row.slopes[..n], &row.tx[..n], &v[..n]);
    let (ix, iy, residual, inverse) = (&mut ix[..n], &mut iy[..n], &mut residual[..n], &mut inverse[..n]);
    let along: [&[f32]; 5] = std::array::from_fn(|i| &own[2][BORDER - 2 + i..][..n]);
    let across = own.map(|row| &row[BORDER..][..n]);
    let (right, bottom) = ((n - 1) as f32, (height - 1) as f32);
    for x in 0..n {
        let (sx, sy) = (x as f32 + u[x], y + v[x]);
        let inside = (sx >= 0.0) & (sx <= right) & (sy >= 0.0) & (sy <= bottom);
        let (w, d) = cubic(tx[x]);
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

/// Catmull–Rom weights of the four taps around a position `t` past the second, and their derivatives.
#[inline(always)]
fn cubic(t: f32) -> ([f32; 4], [f32; 4]) {
    let w = [
        (((-0.5 * t + 1.0) * t) - 0.5) * t,
        ((1.5 * t - 2.5) * t) * t + 1.0,
        (((-1.5 * t + 2.0) * t) + 0.5) * t,
        ((0.5 * t - 0.5) * t) * t,
    ];
    let d = [(-1.5 * t + 2.0) * t - 0.5, (4.5 * t - 5.0) * t, (-4.5 * t + 4.0) * t + 0.5, (1.5 * t - 1.0) * t];
    (w, d)
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
