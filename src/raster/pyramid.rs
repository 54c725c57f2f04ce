//! Gaussian and Laplacian pyramids (Burt & Adelson 1983), with the even kernel (1, 3, 3, 1) / 8.
//!
//! The kernel is even so that a coarse pixel lies exactly over two fine ones: position `p` of a level is `p / 2` of
//! the next, flips are exact, and grids that are multiples of a power of two stay on pixels.

use macro_rules_attribute::apply;

use super::image::Plane;
use crate::base::instructions::kernel;

/// The next coarser level: half the size, rounded up, borders clamped.
pub fn reduce(plane: &Plane) -> Plane {
    let (width, height) = (plane.width.div_ceil(2), plane.height.div_ceil(2));
    let mut out = Plane::zeros(width, height);
    let mut row = vec![0.0; plane.width + 3];
    for y in 0..height {
        let at = |dy: isize| plane.row((2 * y as isize + dy).clamp(0, plane.height as isize - 1) as usize);
        reduce_row([at(-1), at(0), at(1), at(2)], &mut row, out.row_mut(y));
    }
    out
}

/// One row of the coarser level from four of the finer; `row` has room for three more than those.
#[apply(kernel)]
fn reduce_row(rows: [&[f32]; 4], row: &mut [f32], out: &mut [f32]) {
    let [a, b, c, d] = rows;
    let width = a.len();
    for ((((r, a), b), c), d) in row[1..=width].iter_mut().zip(a).zip(b).zip(c).zip(d) {
        *r = (a + d) + 3.0 * (b + c);
    }
    row[0] = row[1];
    row[width + 1] = row[width];
    row[width + 2] = row[width];
    for ((o, p), q) in out.iter_mut().zip(row.chunks_exact(2)).zip(row[2..].chunks_exact(2)) {
        *o = ((p[0] + q[1]) + 3.0 * (p[1] + q[0])) * (1.0 / 64.0);
    }
}

/// A level as the next finer one, of `width` × `height` pixels, sees it.
pub fn expand(plane: &Plane, width: usize, height: usize) -> Plane {
    let mut out = Plane::zeros(width, height);
    let mut row = vec![0.0; plane.width + 2];
    for y in 0..height {
        let near = plane.row((y / 2).min(plane.height - 1));
        let other = y as isize / 2 + if y % 2 == 0 { -1 } else { 1 };
        let other = plane.row(other.clamp(0, plane.height as isize - 1) as usize);
        expand_row(near, other, &mut row, out.row_mut(y));
    }
    out
}

/// One row of the finer level from the nearest and the next one; `row` has room for two more than those.
#[apply(kernel)]
fn expand_row(near: &[f32], other: &[f32], row: &mut [f32], out: &mut [f32]) {
    let width = near.len();
    for ((r, n), o) in row[1..=width].iter_mut().zip(near).zip(other) {
        *r = 0.75 * n + 0.25 * o;
    }
    row[0] = row[1];
    row[width + 1] = row[width];
    let half = out.len() / 2;
    let mut pairs = out.chunks_exact_mut(2);
    for (((pair, left), r), right) in pairs.by_ref().zip(&row[..]).zip(&row[1..]).zip(&row[2..]) {
        pair[0] = 0.75 * r + 0.25 * left;
        pair[1] = 0.75 * r + 0.25 * right;
    }
    if let [last] = pairs.into_remainder() {
        *last = 0.75 * row[half + 1] + 0.25 * row[half];
    }
}

/// `bands` band-pass levels, fine to coarse, and the low-pass rest below them.
pub fn laplacian(plane: &Plane, bands: usize) -> (Vec<Plane>, Plane) {
    let mut levels = Vec::with_capacity(bands);
    let mut rest = plane.clone();
    for _ in 0..bands {
        let coarse = reduce(&rest);
        let low = expand(&coarse, rest.width, rest.height);
        rest.data.iter_mut().zip(&low.data).for_each(|(r, l)| *r -= l);
        levels.push(std::mem::replace(&mut rest, coarse));
    }
    (levels, rest)
}

/// The inverse of [`laplacian`]; `rest` is `None` for zeros.
pub fn collapse(bands: &[Plane], rest: Option<&Plane>) -> Plane {
    let mut sum = rest.cloned();
    for band in bands.iter().rev() {
        let mut level =
            sum.map_or_else(|| Plane::zeros(band.width, band.height), |s| expand(&s, band.width, band.height));
        level.data.iter_mut().zip(&band.data).for_each(|(l, b)| *l += b);
        sum = Some(level);
    }
    sum.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{hash, unit};

    fn noise(width: usize, height: usize) -> Plane {
        Plane::from_fn(width, height, |x, y| unit(hash(5, &[x as u64, y as u64])))
    }

    #[test]
    fn a_pyramid_collapses_to_its_plane() {
        for (width, height) in [(64, 48), (37, 21), (5, 3), (1, 1)] {
            let plane = noise(width, height);
            let (bands, rest) = laplacian(&plane, 4);
            let again = collapse(&bands, Some(&rest));
            assert!(plane.data.iter().zip(&again.data).all(|(a, b)| (a - b).abs() < 1e-5), "{width}x{height}");
        }
    }

    #[test]
    fn constants_have_no_bands_and_flips_commute() {
        let (bands, rest) = laplacian(&Plane::filled(40, 24, 0.6), 3);
        assert!(bands.iter().all(|b| b.data.iter().all(|v| v.abs() < 1e-6)));
        assert!(rest.data.iter().all(|v| (v - 0.6).abs() < 1e-6));
        let plane = noise(48, 32);
        let flip = |p: &Plane| Plane::from_fn(p.width, p.height, |x, y| p.at(p.width - 1 - x, y));
        let (a, _) = laplacian(&flip(&plane), 3);
        let (b, _) = laplacian(&plane, 3);
        assert!(a.iter().zip(&b).all(|(a, b)| a == &flip(b)));
    }
}
