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

/// Points along every direction of a basis: all that a distance needs, and the costly part of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Sorted {
    /// Points, that is values per direction.
    count: usize,
    /// Direction by direction, in rising order.
    values: Vec<f32>,
    /// Root mean square of the points' entries.
    deviation: f64,
}

impl Sorted {
    /// Sorts points along the directions of the basis of `seed`.
    pub fn new(points: &Points, seed: u64) -> Self {
        let (d, n) = (points.dimensions, points.count());
        let basis = basis(d, seed);
        let mut values = vec![0.0; d * n];
        par::for_each_chunk(&mut values, BLOCK * n, |block, out| {
            let rows = &basis[block * BLOCK * d..((block + 1) * BLOCK * d).min(d * d)];
            matmul::a_bt(rows.len() / d, n, d, rows, &points.values, out);
            out.chunks_exact_mut(n).for_each(sort);
        });
        let power: f64 = points.values.iter().map(|v| f64::from(v * v)).sum();
        Self { count: n, values, deviation: (power / (d * n) as f64).sqrt() }
    }

    /// Root mean square of the points' entries.
    pub fn deviation(&self) -> f64 {
        self.deviation
    }
}

/// Root of the mean, over directions, of the squared 1-D Wasserstein-2 distance. When `b` is `a` with δ added to every
/// point it is |δ| / √dimensions, the root mean square of δ's entries.
///
/// # Panics
/// When the two are not equally many points of equally many dimensions, along one basis.
pub fn distance(a: &Sorted, b: &Sorted) -> f64 {
    scaled_distance(a, b, [1.0, 1.0])
}

/// [`distance`] of the points multiplied by `scales`.
///
/// # Panics
/// As [`distance`].
pub fn scaled_distance(a: &Sorted, b: &Sorted, scales: [f64; 2]) -> f64 {
    assert_eq!((a.count, a.values.len()), (b.count, b.values.len()));
    let [of_a, of_b] = scales.map(|scale| scale as f32);
    let squared = |(a, b): (&f32, &f32)| f64::from(of_a * a - of_b * b).powi(2);
    let along = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(squared).sum::<f64>();
    let rows: Vec<(&[f32], &[f32])> = a.values.chunks_exact(a.count).zip(b.values.chunks_exact(b.count)).collect();
    let sums = par::map(rows.len(), |i| along(rows[i]));
    (sums.iter().sum::<f64>() / a.values.len() as f64).sqrt()
}

/// Sorts by [`f32::total_cmp`], through integers of the same order: they compare in a third of the time.
fn sort(row: &mut [f32]) {
    // Negative numbers have all bits but the sign turned; turned twice, they are themselves again.
    let turned = |bits: i32| bits ^ ((bits >> 31) as u32 >> 1) as i32;
    let mut keys: Vec<i32> = row.iter().map(|v| turned(v.to_bits() as i32)).collect();
    keys.sort_unstable();
    row.iter_mut().zip(keys).for_each(|(v, key)| *v = f32::from_bits(turned(key) as u32));
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
    fn numbers_are_sorted_through_integers() {
        let mut row: Vec<f32> = noise(1000, 1, 4).values.iter().map(|v| 1e3 * (v - 0.5)).collect();
        row.extend([0.0, -0.0, f32::INFINITY, f32::NEG_INFINITY, f32::MIN_POSITIVE, -f32::MIN_POSITIVE]);
        let mut expected = row.clone();
        expected.sort_unstable_by(f32::total_cmp);
        sort(&mut row);
        let bits = |row: &[f32]| row.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&row), bits(&expected));
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
        let [a, b] = [a, b].map(|points| Sorted::new(&points, 3));
        assert_eq!(distance(&a, &a), 0.0);
        let expected = 0.3 / 2f64.sqrt();
        assert!((distance(&a, &b) - expected).abs() < 1e-4, "{}", distance(&a, &b));
    }

    #[test]
    fn what_differs_by_a_factor_alone_is_at_no_distance_once_scaled() {
        let a = noise(500, 20, 1);
        let b = Points { dimensions: 20, values: a.values.iter().map(|v| 3.0 * v).collect() };
        let [a, b] = [a, b].map(|points| Sorted::new(&points, 3));
        assert!((b.deviation() / a.deviation() - 3.0).abs() < 1e-6);
        let scales = [&a, &b].map(|side| 1.0 / side.deviation());
        assert!(distance(&a, &b) > 0.5 && scaled_distance(&a, &b, scales) < 1e-5);
    }
}
