//! Sliced Wasserstein distance between two sets of points (Rabin, Peyré, Delon & Bernot 2011), along the directions of
//! a random orthonormal basis: as many as there are dimensions, and none is told twice.

use crate::base::{matmul, par, rng};

/// Directions projected together.
const BLOCK: usize = 16;

/// Points, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Points {
    /// Numbers in a point.
    pub dimensions: usize,
    /// `count * dimensions` numbers.
    pub values: Vec<f32>,
}

impl Points {
    fn count(&self) -> usize {
        self.values.len() / self.dimensions
    }
}

/// Root of the mean, over directions, of the squared 1-D Wasserstein-2 distance. When `b` is `a` with δ added to every
/// point it is |δ| / √dimensions, the root mean square of δ's entries.
///
/// # Panics
/// When the two are not equally many points of equally many dimensions.
pub fn distance(a: &Points, b: &Points, seed: u64) -> f64 {
    assert_eq!((a.dimensions, a.values.len()), (b.dimensions, b.values.len()));
    let (d, n) = (a.dimensions, a.count());
    let basis = basis(d, seed);
    let sums = par::map(d.div_ceil(BLOCK), |block| {
        let rows = &basis[block * BLOCK * d..((block + 1) * BLOCK * d).min(d * d)];
        let [a, b] = [a, b].map(|points| projections(points, rows));
        a.chunks_exact(n).zip(b.chunks_exact(n)).map(|(a, b)| squared(a, b)).sum::<f64>()
    });
    (sums.iter().sum::<f64>() / (d * n) as f64).sqrt()
}

/// The points along each direction, sorted.
fn projections(points: &Points, directions: &[f32]) -> Vec<f32> {
    let (d, n) = (points.dimensions, points.count());
    let mut out = vec![0.0; directions.len() / d * n];
    matmul::a_bt(directions.len() / d, n, d, directions, &points.values, &mut out);
    out.chunks_exact_mut(n).for_each(|row| row.sort_unstable_by(f32::total_cmp));
    out
}

fn squared(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

/// A random orthonormal basis of `d` dimensions, row by row: hashed normal numbers, made orthogonal (Gram & Schmidt,
/// twice over against rounding).
fn basis(d: usize, seed: u64) -> Vec<f32> {
    let mut rows: Vec<Vec<f64>> = Vec::with_capacity(d);
    for i in 0..d {
        let mut row: Vec<f64> = (0..d).map(|j| normal(rng::hash(seed, &[i as u64, j as u64]))).collect();
        for _ in 0..2 {
            for other in &rows {
                let along: f64 = row.iter().zip(other).map(|(a, b)| a * b).sum();
                row.iter_mut().zip(other).for_each(|(r, o)| *r -= along * o);
            }
        }
        let length = row.iter().map(|v| v * v).sum::<f64>().sqrt();
        row.iter_mut().for_each(|v| *v /= length);
        rows.push(row);
    }
    rows.into_iter().flatten().map(|v| v as f32).collect()
}

/// A normally distributed number from a hash (Box & Muller 1958).
fn normal(hash: u64) -> f64 {
    let (a, b) = (f64::from(rng::unit(hash)), f64::from(rng::unit(rng::mix(hash))));
    (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize, dimensions: usize, seed: u64) -> Points {
        let values = (0..n * dimensions).map(|i| rng::unit(rng::hash(seed, &[i as u64]))).collect();
        Points { dimensions, values }
    }

    #[test]
    fn the_basis_is_orthonormal() {
        let basis = basis(37, 5);
        for (i, a) in basis.chunks_exact(37).enumerate() {
            for (j, b) in basis.chunks_exact(37).enumerate() {
                let dot: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
                assert!((dot - if i == j { 1.0 } else { 0.0 }).abs() < 1e-5, "{i} {j}: {dot}");
            }
        }
    }

    #[test]
    fn a_shift_is_its_root_mean_square_and_a_set_is_at_no_distance_from_itself() {
        let a = noise(500, 20, 1);
        let values = a.values.iter().enumerate().map(|(i, v)| v + if i % 20 < 10 { 0.3 } else { 0.0 }).collect();
        let b = Points { dimensions: 20, values };
        assert_eq!(distance(&a, &a, 3), 0.0);
        let expected = 0.3 / 2f64.sqrt();
        assert!((distance(&a, &b, 3) - expected).abs() < 1e-4, "{}", distance(&a, &b, 3));
    }
}
