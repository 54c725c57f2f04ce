//! The inner iterations of TV-L1: thresholding, primal and dual step fused, several iterations per pass over memory.
//!
//! The row kernels are compiled for several instruction sets. The bits do not depend on the choice: every value comes
//! from the same operations in the same order, multiply-adds are explicit, and nothing is estimated by hardware.

use macro_rules_attribute::apply;

use crate::base::instructions::kernel;

/// Lanes that row lengths are rounded up to, so that vector loops have no remainder.
const LANES: usize = 16;
/// Bytes of the rows that one pass over the image keeps in the second-level cache.
const CACHE: usize = 384 << 10;

/// Weights of one run of iterations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Weights {
    /// Bound of the thresholding step, λθ.
    pub reach: f32,
    /// Coupling θ between the two halves of the splitting.
    pub theta: f32,
    /// Dual step τ/θ.
    pub dual_step: f32,
}

/// What each row holds, in this order.
#[derive(Debug, Clone, Copy)]
pub(super) enum Channel {
    /// Horizontal motion.
    U,
    /// Vertical motion.
    V,
    /// Dual variable of u, horizontal.
    Pux,
    /// Dual variable of u, vertical.
    Puy,
    /// Dual variable of v, horizontal.
    Pvx,
    /// Dual variable of v, vertical.
    Pvy,
    /// Horizontal derivative of the second frame, warped.
    Ix,
    /// Vertical derivative of the second frame, warped.
    Iy,
    /// Residual at zero motion, I₁(x + u₀) − ∇I·u₀ − I₀.
    Residual,
    /// 1 / |∇I|², 0 where there is no gradient.
    Inverse,
}

const CHANNELS: usize = 10;

/// All variables of one pyramid level, row by row: ten channels of a row lie side by side, so that a pass streams
/// through memory once.
///
/// A channel of a row starts with one ghost value on the left (0 for the dual variables) and ends in padding; above
/// the first row lies a row of zeros.
#[derive(Debug, Clone, Default)]
pub(super) struct State {
    pub width: usize,
    pub height: usize,
    padded: usize,
    stride: usize,
    data: Vec<f32>,
}

impl State {
    /// Sets the size and fills everything with zeros; keeps the buffer.
    pub fn resize(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.padded = width.next_multiple_of(LANES);
        self.stride = self.padded + LANES;
        self.data.clear();
        self.data.resize(self.row_len() * (height + 1), 0.0);
    }

    fn row_len(&self) -> usize {
        self.stride * CHANNELS
    }

    /// One channel of row `y`.
    pub fn row(&self, channel: Channel, y: usize) -> &[f32] {
        let start = (y + 1) * self.row_len() + channel as usize * self.stride + 1;
        &self.data[start..start + self.width]
    }

    /// All channels of row `y`, to write, in the order of [`Channel`].
    pub fn row_mut(&mut self, y: usize) -> [&mut [f32]; CHANNELS] {
        let (width, stride, len) = (self.width, self.stride, self.row_len());
        let mut channels = self.data[(y + 1) * len..(y + 2) * len].chunks_exact_mut(stride);
        std::array::from_fn(|_| &mut channels.next().expect("a row has all channels")[1..=width])
    }

    /// The channels of row `y`, in the order of [`Channel`].
    pub fn all_rows(&self, y: usize) -> impl Iterator<Item = &[f32]> {
        let len = self.row_len();
        self.data[(y + 1) * len..(y + 2) * len].chunks_exact(self.stride).map(|c| &c[1..=self.width])
    }

    /// Sets the dual variables that would point out of the picture on the right and below to 0.
    pub fn close_borders(&mut self) {
        let (right, bottom) = (self.width - 1, self.height - 1);
        for y in 0..self.height {
            let [_, _, pux, puy, pvx, pvy, ..] = self.row_mut(y);
            (pux[right], pvx[right]) = (0.0, 0.0);
            if y == bottom {
                puy.fill(0.0);
                pvy.fill(0.0);
            }
        }
    }

    /// Runs `iterations` fused iterations on the calling thread.
    pub fn iterate(&mut self, iterations: usize, weights: Weights) {
        let depth = (CACHE / (self.row_len() * size_of::<f32>()).max(1)).clamp(1, 32);
        let mut left = iterations;
        while left > 0 {
            let block = left.min(depth);
            pass(self, block, weights);
            left -= block;
        }
    }
}

/// `block` iterations in one pass over the rows (a wavefront: iteration k works one row behind iteration k − 1).
fn pass(state: &mut State, block: usize, weights: Weights) {
    let height = state.height;
    for step in 0..height + block - 1 {
        for y in (step.saturating_sub(block - 1)..=step.min(height - 1)).rev() {
            state.primal(y, weights);
            if y > 0 {
                state.dual(y - 1, weights);
            }
            if y == height - 1 {
                state.dual(y, weights);
            }
        }
    }
}

impl State {
    /// Primal step of row `y`.
    fn primal(&mut self, y: usize, weights: Weights) {
        let (n, stride, len) = (self.padded, self.stride, self.row_len());
        let (above, rest) = self.data[y * len..].split_at_mut(len);
        let (primal, others) = rest[..len].split_at_mut(2 * stride);
        primal_row(n, primal, others, &above[2 * stride..], weights);
    }

    /// Dual step of row `y`.
    fn dual(&mut self, y: usize, weights: Weights) {
        let (n, width, stride, len) = (self.padded, self.width, self.stride, self.row_len());
        let last = y + 1 == self.height;
        let (row, below) = self.data[(y + 1) * len..].split_at_mut(len);
        let (primal, duals) = row.split_at_mut(2 * stride);
        for (c, (primal, dual)) in primal.chunks_exact_mut(stride).zip(duals.chunks_exact_mut(2 * stride)).enumerate() {
            // The derivative across the right border is 0: the ghost repeats the last value.
            primal[width + 1] = primal[width];
            let down = if last { &primal[..stride] } else { &below[c * stride..][..stride] };
            dual_row(n, dual, primal, down, weights.dual_step);
        }
    }
}

/// Thresholding and primal step of one row (Zach et al. 2007, Propositions 1 and 3).
///
/// `primal`: u, v; `others`: the row's other channels; `above`: the dual variables of the row above.
#[apply(kernel)]
fn primal_row(n: usize, primal: &mut [f32], others: &[f32], above: &[f32], weights: Weights) {
    let stride = primal.len() / 2;
    let channel = |c: Channel, ghosts: usize| &others[(c as usize - 2) * stride + 1 - ghosts..][..n];
    let up = |c: Channel| &above[(c as usize - 2) * stride + 1..][..n];
    let (pux, pux_left) = (channel(Channel::Pux, 0), channel(Channel::Pux, 1));
    let (pvx, pvx_left) = (channel(Channel::Pvx, 0), channel(Channel::Pvx, 1));
    let (puy, puy_up) = (channel(Channel::Puy, 0), up(Channel::Puy));
    let (pvy, pvy_up) = (channel(Channel::Pvy, 0), up(Channel::Pvy));
    let (ix, iy) = (channel(Channel::Ix, 0), channel(Channel::Iy, 0));
    let (residual, inverse) = (channel(Channel::Residual, 0), channel(Channel::Inverse, 0));
    let (u, v) = primal.split_at_mut(stride);
    let (u, v) = (&mut u[1..=n], &mut v[1..=n]);
    let Weights { reach, theta, .. } = weights;
    for i in 0..n {
        let rho = ix[i].mul_add(u[i], iy[i].mul_add(v[i], residual[i]));
        let t = (-rho * inverse[i]).clamp(-reach, reach);
        let div_u = (pux[i] - pux_left[i]) + (puy[i] - puy_up[i]);
        let div_v = (pvx[i] - pvx_left[i]) + (pvy[i] - pvy_up[i]);
        u[i] = theta.mul_add(div_u, t.mul_add(ix[i], u[i]));
        v[i] = theta.mul_add(div_v, t.mul_add(iy[i], v[i]));
    }
}

/// Dual step of one component of one row: ascent and projection onto the unit disc.
///
/// `dual`: horizontal and vertical dual variable; `own`: the component, `down`: the same of the row below.
#[apply(kernel)]
fn dual_row(n: usize, dual: &mut [f32], own: &[f32], down: &[f32], step: f32) {
    let (px, py) = dual.split_at_mut(dual.len() / 2);
    let (px, py) = (&mut px[1..=n], &mut py[1..=n]);
    let (own, right, down) = (&own[1..=n], &own[2..n + 2], &down[1..=n]);
    for i in 0..n {
        let x = step.mul_add(right[i] - own[i], px[i]);
        let y = step.mul_add(down[i] - own[i], py[i]);
        let square = x.mul_add(x, y * y);
        let scale = inverse_sqrt(if square > 1.0 { square } else { 1.0 });
        px[i] = x * scale;
        py[i] = y * scale;
    }
}

/// 1/√x for x ≥ 1, relative error below 5·10⁻⁶, the same bits on every machine with FMA (which hardware estimates
/// are not): a first guess from the exponent, then two Newton steps.
#[inline(always)]
fn inverse_sqrt(x: f32) -> f32 {
    let guess = f32::from_bits(0x5F37_5A86 - (x.to_bits() >> 1));
    let half = 0.5 * x;
    let guess = guess * (-half * guess).mul_add(guess, 1.5);
    guess * (-half * guess).mul_add(guess, 1.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    fn random_state(width: usize, height: usize) -> State {
        let mut state = State::default();
        state.resize(width, height);
        for y in 0..height {
            let random = |c: u64, x: usize| rng::unit(rng::hash(5, &[c, x as u64, y as u64])) - 0.5;
            let [u, v, _, _, _, _, ix, iy, residual, inverse] = state.row_mut(y);
            for x in 0..width {
                (u[x], v[x], residual[x]) = (4.0 * random(0, x), 4.0 * random(1, x), 0.3 * random(2, x));
                (ix[x], iy[x]) = if x % 5 == 3 { (0.0, 0.0) } else { (random(3, x), random(4, x)) };
                inverse[x] = 1.0 / (ix[x] * ix[x] + iy[x] * iy[x]).max(1e-9);
            }
        }
        state
    }

    /// The same iteration as Zach et al. print it: one step after the other over the whole picture, pixel by pixel,
    /// compiled for the plain instruction set.
    fn naive(state: &State, iterations: usize, weights: Weights) -> Vec<Vec<f32>> {
        let (w, h) = (state.width, state.height);
        let mut c: Vec<Vec<f32>> = vec![Vec::new(); CHANNELS];
        (0..h).for_each(|y| state.all_rows(y).zip(&mut c).for_each(|(row, channel)| channel.extend_from_slice(row)));
        for _ in 0..iterations {
            for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
                let i = y * w + x;
                let [ix, iy, residual, inverse] = [c[6][i], c[7][i], c[8][i], c[9][i]];
                let rho = ix.mul_add(c[0][i], iy.mul_add(c[1][i], residual));
                let t = (-rho * inverse).clamp(-weights.reach, weights.reach);
                for k in 0..2 {
                    let (px, py) = (&c[2 + 2 * k], &c[3 + 2 * k]);
                    let left = if x > 0 { px[i - 1] } else { 0.0 };
                    let above = if y > 0 { py[i - w] } else { 0.0 };
                    let divergence = (px[i] - left) + (py[i] - above);
                    c[k][i] = weights.theta.mul_add(divergence, t.mul_add([ix, iy][k], c[k][i]));
                }
            }
            for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
                let i = y * w + x;
                for k in 0..2 {
                    let right = if x + 1 < w { c[k][i + 1] - c[k][i] } else { 0.0 };
                    let down = if y + 1 < h { c[k][i + w] - c[k][i] } else { 0.0 };
                    let px = weights.dual_step.mul_add(right, c[2 + 2 * k][i]);
                    let py = weights.dual_step.mul_add(down, c[3 + 2 * k][i]);
                    let scale = inverse_sqrt(px.mul_add(px, py * py).max(1.0));
                    (c[2 + 2 * k][i], c[3 + 2 * k][i]) = (px * scale, py * scale);
                }
            }
        }
        c
    }

    #[test]
    fn fused_iterations_equal_separate_ones_bit_for_bit() {
        let weights = Weights { reach: 6.0, theta: 0.3, dual_step: 0.8 };
        let sizes = [(1, 1), (3, 2), (17, 5), (5, 17), (16, 16), (33, 40), (1, 9), (9, 1), (700, 3)];
        for ((width, height), iterations) in sizes.into_iter().flat_map(|s| [1, 2, 7, 45].map(|i| (s, i))) {
            let mut state = random_state(width, height);
            let expected = naive(&state, iterations, weights);
            state.iterate(iterations, weights);
            for (y, (channel, expected)) in (0..height).flat_map(|y| expected.iter().enumerate().map(move |e| (y, e))) {
                let row = state.all_rows(y).nth(channel).unwrap();
                let expected = &expected[y * width..(y + 1) * width];
                let same = row.iter().zip(expected).all(|(a, b)| a.to_bits() == b.to_bits());
                assert!(same, "{width}x{height}, {iterations} iterations, channel {channel}, row {y}");
            }
        }
    }

    #[test]
    fn inverse_square_root_is_close() {
        for i in 0..100_000 {
            let x = 1.0 + i as f32 * 0.01;
            let error = (f64::from(inverse_sqrt(x)) * f64::from(x).sqrt() - 1.0).abs();
            assert!(error < 5e-6, "{error} at {x}");
        }
    }
}
