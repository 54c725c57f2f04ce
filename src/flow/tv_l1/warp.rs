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

    /// Value and derivatives of the Catmull–Rom interpolant at pixel coordinates `(x, y)` (integers at pixel centres),
    /// −1 ≤ x ≤ width, −1 ≤ y ≤ height.
    #[inline(always)]
    fn sample(&self, x: f32, y: f32) -> [f32; 3] {
        let (x0, y0) = (x.floor(), y.floor());
        let ((wx, dx), (wy, dy)) = (cubic(x - x0), cubic(y - y0));
        let left = (x0 as isize + BORDER as isize - 1) as usize;
        let start = (y0 as isize + BORDER as isize - 1) as usize * self.stride + left;
        let (mut column, mut slope) = ([0.0f32; 4], [0.0f32; 4]);
        for i in 0..4 {
            let row = &self.data[start + i * self.stride..][..4];
            for j in 0..4 {
                column[j] = wy[i].mul_add(row[j], column[j]);
                slope[j] = dy[i].mul_add(row[j], slope[j]);
            }
        }
        [dot(wx, column), dot(dx, column), dot(wx, slope)]
    }
}

/// Weights of the four taps around a position `t` past the second, and their derivatives.
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

/// Linearises the residual around the motion in `state`: `I₁(x + u) − I₀(x)`, with the gradient a mix of both frames'
/// (`blend` of it from the first; ½ is symmetric in time). Where the motion leaves the picture there is no data.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
pub(super) fn linearise(state: &mut State, from: &Padded, to: &Padded, blend: f32) {
    linearise_plain(state, from, to, blend);
}

/// [`linearise`] for whatever instruction set the caller was compiled for; same bits on all.
#[inline(always)]
pub(super) fn linearise_plain(state: &mut State, from: &Padded, to: &Padded, blend: f32) {
    let (width, height) = (state.width, state.height);
    let (right, bottom) = ((width - 1) as f32, (height - 1) as f32);
    for y in 0..height {
        let rows: [&[f32]; 5] = std::array::from_fn(|i| from.row(y as isize + i as isize - 2));
        let [u, v, _, _, _, _, ix, iy, residual, inverse] = state.row_mut(y);
        for x in 0..width {
            let (sx, sy) = (x as f32 + u[x], y as f32 + v[x]);
            let inside = sx >= 0.0 && sx <= right && sy >= 0.0 && sy <= bottom;
            let [value, dx, dy] = to.sample(sx.max(-1.0).min(right + 1.0), sy.max(-1.0).min(bottom + 1.0));
            let own = &rows[2][x..x + 2 * BORDER + 1];
            let own_dx = derivative(own[1], own[2], own[4], own[5]);
            let c = x + BORDER;
            let own_dy = derivative(rows[0][c], rows[1][c], rows[3][c], rows[4][c]);
            let gx = blend.mul_add(own_dx - dx, dx);
            let gy = blend.mul_add(own_dy - dy, dy);
            let square = gx.mul_add(gx, gy * gy);
            let rest = gx.mul_add(-u[x], gy.mul_add(-v[x], value - own[3]));
            let some = |value: f32| if inside { value } else { 0.0 };
            ix[x] = some(gx);
            iy[x] = some(gy);
            residual[x] = some(rest);
            inverse[x] = some(1.0 / square.max(1e-9));
        }
    }
}

/// Fourth-order central difference from the values at −2, −1, 1, 2.
#[inline(always)]
fn derivative(a: f32, b: f32, d: f32, e: f32) -> f32 {
    (8.0 * (d - b) - (e - a)) * (1.0 / 12.0)
}
