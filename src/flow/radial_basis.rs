//! Smooth interpolation of scattered values with radial basis functions (Okabe et al. 2011, §5).

use macro_rules_attribute::apply;

use crate::base::instructions::kernel;

/// Interpolates `N` values at once: `c + Σ wᵢ |x − xᵢ|` with Σ wᵢ = 0, the smoothest such sum near the samples. The
/// kernel φ(r) = r has no scale to choose, and the constant lets it carry equal values everywhere.
#[derive(Debug, Clone, PartialEq)]
pub struct RadialBasis<const N: usize> {
    centres: Vec<(f32, f32)>,
    weights: Vec<[f32; N]>,
    constant: [f32; N],
}

impl<const N: usize> RadialBasis<N> {
    /// Fits `values` at `centres` (pixels, at least one, equal in number). `ridge` (pixels, above 0) is how much values
    /// that lie near each other are averaged: samples closer than about this many pixels count as one.
    ///
    /// # Panics
    /// When the numbers differ or are 0.
    pub fn fit(centres: &[(f32, f32)], values: &[[f32; N]], ridge: f32) -> Self {
        let n = centres.len();
        assert!(n > 0 && n == values.len());
        // −(Φ − ridge·I) is positive definite on Σ w = 0; the last row and column are that condition and the constant.
        let distance = |i: usize, j: usize| {
            let (dx, dy) = (f64::from(centres[i].0 - centres[j].0), f64::from(centres[i].1 - centres[j].1));
            if i == j { -f64::from(ridge) } else { (dx * dx + dy * dy).sqrt() }
        };
        let row = |i: usize| -> Vec<f64> {
            let one = |j: usize| if i == n && j == n { 0.0 } else { 1.0 };
            (0..=n).map(|j| if i < n && j < n { distance(i, j) } else { one(j) }).collect()
        };
        let right = |i: usize| values.get(i).map_or([0.0; N], |v| v.map(f64::from));
        let solved = solve((0..=n).map(row).collect(), (0..=n).map(right).collect());
        let mut weights: Vec<[f32; N]> = solved.iter().map(|w| w.map(|w| w as f32)).collect();
        let constant = weights.pop().unwrap_or([0.0; N]);
        Self { centres: centres.to_vec(), weights, constant }
    }

    /// Values along a row: at the `width` positions `(½, y), (1½, y)…`, pixels.
    pub fn row(&self, y: f32, width: usize) -> [Vec<f32>; N] {
        let mut out = self.constant.map(|c| vec![c; width]);
        let mut distances = vec![0.0; width];
        for (&(cx, cy), weights) in self.centres.iter().zip(&self.weights) {
            distances_along(&mut distances, cx, y - cy);
            for (out, &weight) in out.iter_mut().zip(weights) {
                add_scaled(out, &distances, weight);
            }
        }
        out
    }
}

#[apply(kernel)]
fn distances_along(out: &mut [f32], cx: f32, dy: f32) {
    for (x, out) in out.iter_mut().enumerate() {
        let dx = x as i32 as f32 + 0.5 - cx;
        *out = (dx * dx + dy * dy).sqrt();
    }
}

#[apply(kernel)]
fn add_scaled(out: &mut [f32], values: &[f32], weight: f32) {
    out.iter_mut().zip(values).for_each(|(o, v)| *o += weight * v);
}

/// Solves a square system with `N` right sides by elimination with row pivots.
fn solve<const N: usize>(mut matrix: Vec<Vec<f64>>, mut right: Vec<[f64; N]>) -> Vec<[f64; N]> {
    let n = matrix.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|&a, &b| matrix[a][k].abs().total_cmp(&matrix[b][k].abs())).unwrap_or(k);
        matrix.swap(k, pivot);
        right.swap(k, pivot);
        let (upper, lower) = matrix.split_at_mut(k + 1);
        let (pivot_row, pivot_right) = (&upper[k], right[k]);
        for (row, right) in lower.iter_mut().zip(&mut right[k + 1..]) {
            let factor = row[k] / pivot_row[k];
            row[k..].iter_mut().zip(&pivot_row[k..]).for_each(|(r, p)| *r -= factor * p);
            right.iter_mut().zip(pivot_right).for_each(|(r, p)| *r -= factor * p);
        }
    }
    for k in (0..n).rev() {
        let (row, diagonal) = (&matrix[k], matrix[k][k]);
        let known: [f64; N] = std::array::from_fn(|c| (k + 1..n).map(|j| row[j] * right[j][c]).sum());
        right[k].iter_mut().zip(known).for_each(|(r, s)| *r = (*r - s) / diagonal);
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at<const N: usize>(fit: &RadialBasis<N>, x: usize, y: usize) -> [f32; N] {
        fit.row(y as f32 + 0.5, x + 1).map(|row| row[x])
    }

    #[test]
    fn samples_are_met_and_equal_values_hold_everywhere() {
        let centres = [(10.5, 10.5), (40.5, 12.5), (25.5, 60.5), (70.5, 70.5)];
        let values = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.5], [0.25, 0.25]];
        let fit = RadialBasis::fit(&centres, &values, 1e-3);
        for (c, v) in centres.iter().zip(values) {
            let found = at(&fit, c.0 as usize, c.1 as usize);
            assert!(found.iter().zip(v).all(|(f, v)| (f - v).abs() < 1e-3), "{found:?} {v:?}");
        }
        let flat = RadialBasis::fit(&centres, &[[0.5]; 4], 1.0);
        assert!(flat.row(200.5, 300).iter().flatten().all(|v| (v - 0.5).abs() < 1e-4));
    }

    #[test]
    fn a_single_sample_and_equal_places_are_no_trouble() {
        assert_eq!(at(&RadialBasis::fit(&[(3.0, 4.0)], &[[2.0]], 1.0), 9, 9), [2.0]);
        let twice = RadialBasis::fit(&[(3.5, 3.5), (3.5, 3.5)], &[[1.0], [0.0]], 1.0);
        assert!((at(&twice, 3, 3)[0] - 0.5).abs() < 1e-5);
    }
}
