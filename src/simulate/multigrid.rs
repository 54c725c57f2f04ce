//! A multigrid cycle for the pressure (Brandt 1977), used as preconditioner (Tatebe 1993; McAdams, Sifakis & Teran 2010).
//!
//! The equation of a pixel is `Σ_f c_f (p − p_f) = b` over its four sides, `c_f` how much a side lets through
//! ([`Domain`]); what is beyond an open side has pressure 0. A coarse side lets through the mean of the two sides it is
//! made of. Corrections are interpolated linearly, with weights renormalised beside obstacles and walls, and residuals are
//! gathered by the transpose, so the cycle is symmetric.

use macro_rules_attribute::apply;

use crate::base::instructions::kernel;
use crate::base::par;
use crate::simulate::grid::Domain;

/// Weights of the two smoothing steps: Chebyshev's for eigenvalues of D⁻¹A between ½ and 2.
const SMOOTHING: [f32; 2] = [0.5617, 1.389];
/// Pairs of smoothing steps on the coarsest grid.
const COARSEST_STEPS: usize = 24;
/// Grids whose sides are up to this are not coarsened further.
const COARSEST_SIDE: usize = 4;
/// Rows that a thread takes at a time, and values below which one thread does all.
const BAND: usize = 32;
const ALONE: usize = 1 << 15;

/// One grid: arrays have a ring of one pixel of zeros around, so rows are `width + 2` long.
pub(super) struct Level {
    pub width: usize,
    pub height: usize,
    /// What the left and upper side of each pixel let through.
    pub left: Vec<f32>,
    pub top: Vec<f32>,
    /// Sum over the four sides, and one over it; 0 in obstacles.
    pub sum: Vec<f32>,
    pub inverse: Vec<f32>,
    /// One over the weight with which a pixel's four coarse neighbours count.
    share: Vec<f32>,
    x: Vec<f32>,
    b: Vec<f32>,
    spare: Vec<f32>,
}

impl Level {
    fn new(width: usize, height: usize, left: Vec<f32>, top: Vec<f32>) -> Self {
        let (stride, count) = (width + 2, (width + 2) * (height + 2));
        let mut sum = vec![0.0; count];
        for y in 1..=height {
            for i in y * stride + 1..y * stride + 1 + width {
                sum[i] = (left[i] + left[i + 1]) + (top[i] + top[i + stride]);
            }
        }
        let inverse = sum.iter().map(|&s| if s > 0.0 { 1.0 / s } else { 0.0 }).collect();
        let zeros = || vec![0.0; count];
        Self { width, height, left, top, sum, inverse, share: zeros(), x: zeros(), b: zeros(), spare: zeros() }
    }

    /// The grid of the picture.
    fn finest(domain: &Domain) -> Self {
        let (width, height) = (domain.width, domain.height);
        let stride = width + 2;
        let (mut left, mut top) = (vec![0.0; stride * (height + 2)], vec![0.0; stride * (height + 2)]);
        for y in 0..height {
            left[(y + 1) * stride + 1..][..width + 1].copy_from_slice(domain.pass_u.row(y));
        }
        for y in 0..=height {
            top[(y + 1) * stride + 1..][..width].copy_from_slice(domain.pass_v.row(y));
        }
        Self::new(width, height, left, top)
    }

    /// The grid of half the size.
    fn coarser(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let (stride, fine) = (width + 2, self.width + 2);
        let (mut left, mut top) = (vec![0.0; stride * (height + 2)], vec![0.0; stride * (height + 2)]);
        for y in 0..=height {
            for x in 0..=width {
                // The far sides of an odd grid lie half a coarse pixel early.
                let (fx, fy) = ((2 * x).min(self.width), (2 * y).min(self.height));
                let at = |x: usize, y: usize| (y + 1) * fine + x + 1;
                let i = (y + 1) * stride + x + 1;
                if y < height {
                    let second = if fy + 1 < self.height { self.left[at(fx, fy + 1)] } else { 0.0 };
                    left[i] = 0.5 * (self.left[at(fx, fy)] + second);
                }
                if x < width {
                    let second = if fx + 1 < self.width { self.top[at(fx + 1, fy)] } else { 0.0 };
                    top[i] = 0.5 * (self.top[at(fx, fy)] + second);
                }
            }
        }
        Self::new(width, height, left, top)
    }

    /// Sets the shares, knowing the coarser grid. Beyond an open side the correction falls to 0 at the side itself.
    fn share_with(&mut self, coarse: &Self) {
        let (stride, coarse_stride) = (self.width + 2, coarse.width + 2);
        for y in 0..self.height {
            for x in 0..self.width {
                let i = (y + 1) * stride + x + 1;
                if self.sum[i] == 0.0 {
                    continue;
                }
                let near = (y / 2 + 1) * coarse_stride + x / 2 + 1;
                let (nx, ny) = (if x % 2 == 0 { near - 1 } else { near + 1 }, if y % 2 == 0 { 0 } else { 2 });
                let ny = near + ny * coarse_stride - coarse_stride;
                let both = ny + nx - near;
                let open_x = (x == 0 && self.left[i] > 0.0) || (x + 1 == self.width && self.left[i + 1] > 0.0);
                let open_y = (y == 0 && self.top[i] > 0.0) || (y + 1 == self.height && self.top[i + stride] > 0.0);
                let counts = |at: usize, weight: f32, open: bool| match (coarse.sum[at] > 0.0, open) {
                    (true, _) => weight,
                    (false, true) => 3.0 * weight,
                    (false, false) => 0.0,
                };
                let weight = counts(near, 0.5625, false)
                    + (counts(nx, 0.1875, open_x) + counts(ny, 0.1875, open_y))
                    + counts(both, 0.0625, open_x || open_y);
                self.share[i] = if weight > 0.0 { 1.0 / weight } else { 0.0 };
            }
        }
    }

    /// `out = A x`.
    pub fn apply(&self, x: &[f32], out: &mut [f32]) {
        self.rows(out, |i, row| apply_row(row, x, self, i));
    }

    /// Calls `f(first, row)` for the inner part of each row of `out`, `first` the index of its first value.
    fn rows(&self, out: &mut [f32], f: impl Fn(usize, &mut [f32]) + Sync + Send) {
        let (stride, width) = (self.width + 2, self.width);
        let inner = &mut out[stride..stride * (self.height + 1)];
        let band = |first: usize, rows: &mut [f32]| {
            for (y, row) in rows.chunks_exact_mut(stride).enumerate() {
                f((first + y + 1) * stride + 1, &mut row[1..=width]);
            }
        };
        if inner.len() < ALONE {
            band(0, inner);
        } else {
            par::for_each_chunk(inner, stride * BAND, |n, rows| band(n * BAND, rows));
        }
    }

    /// Smooths `x` by the steps `weights`; `from_zero` when `x` is to be taken as 0.
    fn smooth(&mut self, weights: [f32; 2], from_zero: bool) {
        let (mut x, mut spare) = (std::mem::take(&mut self.x), std::mem::take(&mut self.spare));
        for (n, weight) in weights.into_iter().enumerate() {
            if from_zero && n == 0 {
                self.rows(&mut spare, |i, row| first_row(row, self, i, weight));
            } else {
                self.rows(&mut spare, |i, row| smooth_row(row, &x, self, i, weight));
            }
            std::mem::swap(&mut x, &mut spare);
        }
        (self.x, self.spare) = (x, spare);
    }

    /// The residual `b − A x` times the shares, into `spare`.
    fn weighted_residual(&mut self) {
        let mut spare = std::mem::take(&mut self.spare);
        self.rows(&mut spare, |i, row| residual_row(row, self, i));
        self.spare = spare;
    }

    /// Right side of this grid from the weighted residual of the finer one.
    fn gather(&mut self, fine: &Self) {
        let mut b = std::mem::take(&mut self.b);
        let (stride, last) = (fine.width + 2, fine.height + 1);
        self.rows(&mut b, |i, row| {
            let y = 2 * (i / (row.len() + 2));
            let at = |y: usize| &fine.spare[y.min(last) * stride..][..stride];
            gather_row(row, [at(y - 2), at(y - 1), at(y), at(y + 1)]);
        });
        // Obstacles take nothing.
        b.iter_mut().zip(&self.sum).filter(|(_, s)| **s == 0.0).for_each(|(b, _)| *b = 0.0);
        self.b = b;
    }

    /// Adds the correction of the coarser grid.
    fn correct(&mut self, coarse: &Self) {
        let mut x = std::mem::take(&mut self.x);
        let (stride, coarse_stride) = (self.width + 2, coarse.width + 2);
        self.rows(&mut x, |i, row| {
            let y = i / stride - 1;
            let near = (y / 2 + 1) * coarse_stride;
            let far = if y % 2 == 0 { near - coarse_stride } else { near + coarse_stride };
            let rows = [near, far].map(|at| &coarse.x[at..at + coarse_stride]);
            correct_row(row, rows, &self.share[i..]);
        });
        self.x = x;
    }
}

/// The grids, finest first.
pub(super) struct Multigrid {
    pub levels: Vec<Level>,
}

impl Multigrid {
    pub fn new(domain: &Domain) -> Self {
        let mut levels = vec![Level::finest(domain)];
        while let Some(last) = levels.last_mut()
            && last.width.max(last.height) > COARSEST_SIDE
        {
            let coarse = last.coarser();
            last.share_with(&coarse);
            levels.push(coarse);
        }
        Self { levels }
    }

    /// One V-cycle from zero for the right side `b`; the answer lies in [`Multigrid::answer`].
    pub fn cycle(&mut self, b: &[f32]) {
        self.levels[0].b.copy_from_slice(b);
        let last = self.levels.len() - 1;
        for l in 0..last {
            let (fine, coarse) = self.levels.split_at_mut(l + 1);
            fine[l].smooth(SMOOTHING, true);
            fine[l].weighted_residual();
            coarse[0].gather(&fine[l]);
        }
        let [first, second] = SMOOTHING;
        for n in 0..COARSEST_STEPS {
            self.levels[last].smooth(SMOOTHING, n == 0);
        }
        for l in (0..last).rev() {
            let (fine, coarse) = self.levels.split_at_mut(l + 1);
            fine[l].correct(&coarse[0]);
            fine[l].smooth([second, first], false);
        }
    }

    pub fn answer(&self) -> &[f32] {
        &self.levels[0].x
    }
}

/// Neighbours of the pixels from `i` on: left, right, above, below.
#[inline(always)]
fn around(values: &[f32], i: usize, stride: usize, n: usize) -> [&[f32]; 4] {
    [i - 1, i + 1, i - stride, i + stride].map(|at| &values[at..at + n])
}

/// What the four sides let through, and the sum, from `i` on.
#[inline(always)]
fn sides(level: &Level, i: usize, n: usize) -> [&[f32]; 5] {
    let stride = level.width + 2;
    let [left, right] = [i, i + 1].map(|at| &level.left[at..at + n]);
    let [top, bottom] = [i, i + stride].map(|at| &level.top[at..at + n]);
    [left, right, top, bottom, &level.sum[i..i + n]]
}

#[apply(kernel)]
fn apply_row(out: &mut [f32], x: &[f32], level: &Level, i: usize) {
    let n = out.len();
    let [xl, xr, xt, xb] = around(x, i, level.width + 2, n);
    let [cl, cr, ct, cb, sum] = sides(level, i, n);
    let x = &x[i..i + n];
    for k in 0..n {
        out[k] = sum[k] * x[k] - ((cl[k] * xl[k] + cr[k] * xr[k]) + (ct[k] * xt[k] + cb[k] * xb[k]));
    }
}

#[apply(kernel)]
fn first_row(out: &mut [f32], level: &Level, i: usize, weight: f32) {
    let n = out.len();
    let (b, inverse) = (&level.b[i..i + n], &level.inverse[i..i + n]);
    for k in 0..n {
        out[k] = weight * inverse[k] * b[k];
    }
}

#[apply(kernel)]
fn smooth_row(out: &mut [f32], x: &[f32], level: &Level, i: usize, weight: f32) {
    let n = out.len();
    let [xl, xr, xt, xb] = around(x, i, level.width + 2, n);
    let [cl, cr, ct, cb, _] = sides(level, i, n);
    let (x, b, inverse) = (&x[i..i + n], &level.b[i..i + n], &level.inverse[i..i + n]);
    for k in 0..n {
        let near = (cl[k] * xl[k] + cr[k] * xr[k]) + (ct[k] * xt[k] + cb[k] * xb[k]);
        out[k] = x[k] + weight * (inverse[k] * (b[k] + near) - x[k]);
    }
}

#[apply(kernel)]
fn residual_row(out: &mut [f32], level: &Level, i: usize) {
    let n = out.len();
    let [xl, xr, xt, xb] = around(&level.x, i, level.width + 2, n);
    let [cl, cr, ct, cb, sum] = sides(level, i, n);
    let (x, b, share) = (&level.x[i..i + n], &level.b[i..i + n], &level.share[i..i + n]);
    for k in 0..n {
        let ax = sum[k] * x[k] - ((cl[k] * xl[k] + cr[k] * xr[k]) + (ct[k] * xt[k] + cb[k] * xb[k]));
        out[k] = share[k] * (b[k] - ax);
    }
}

/// A coarse row from four fine rows, ring and all: weights ¼, ¾, ¾, ¼ both ways, the transpose of interpolation.
fn gather_row(out: &mut [f32], rows: [&[f32]; 4]) {
    let [a, b, c, d] = rows;
    let mixed = |x: usize| 0.75 * (b[x] + c[x]) + 0.25 * (a[x] + d[x]);
    let last = a.len() - 1;
    for (x, out) in out.iter_mut().enumerate() {
        let right = |x: usize| if x <= last { mixed(x) } else { 0.0 };
        *out = 0.75 * (mixed(2 * x + 1) + right(2 * x + 2)) + 0.25 * (mixed(2 * x) + right(2 * x + 3));
    }
}

/// Adds to a fine row the nearer and the farther coarse row, ring and all.
fn correct_row(out: &mut [f32], [near, far]: [&[f32]; 2], share: &[f32]) {
    let mixed = |x: usize| 0.75 * near[x] + 0.25 * far[x];
    for (x, (pair, share)) in out.chunks_mut(2).zip(share.chunks(2)).enumerate() {
        let here = 0.75 * mixed(x + 1);
        let beside = [mixed(x), mixed(x + 2)];
        for ((out, share), beside) in pair.iter_mut().zip(share).zip(beside) {
            *out += share * (here + 0.25 * beside);
        }
    }
}
