//! Gaussian and Laplacian pyramids (Burt & Adelson 1983), with the even kernel (1, 3, 3, 1) / 8.
//!
//! The kernel is even so that a coarse pixel lies exactly over two fine ones: position `p` of a level is `p / 2` of
//! the next, flips are exact, and grids that are multiples of a power of two stay on pixels.

use super::image::Plane;

/// The next coarser level: half the size, rounded up, borders clamped.
pub fn reduce(plane: &Plane) -> Plane {
    let (width, height) = (plane.width.div_ceil(2), plane.height.div_ceil(2));
    let mut out = Plane::zeros(width, height);
    let mut row = vec![0.0; plane.width + 3];
    for y in 0..height {
        let at = |dy: isize| plane.row((2 * y as isize + dy).clamp(0, plane.height as isize - 1) as usize);
        let (a, b, c, d) = (at(-1), at(0), at(1), at(2));
        for (x, r) in row[1..=plane.width].iter_mut().enumerate() {
            *r = (a[x] + d[x]) + 3.0 * (b[x] + c[x]);
        }
        row[0] = row[1];
        row[plane.width + 1] = row[plane.width];
        row[plane.width + 2] = row[plane.width];
        for (o, r) in out.row_mut(y).iter_mut().zip(row.windows(4).step_by(2)) {
            *o = ((r[0] + r[3]) + 3.0 * (r[1] + r[2])) * (1.0 / 64.0);
        }
    }
    out
}

/// A level as the next finer one, of `width` × `height` pixels, sees it.
pub fn expand(plane: &Plane, width: usize, height: usize) -> Plane {
    let mut out = Plane::zeros(width, height);
    let mut row = vec![0.0; plane.width + 2];
    for y in 0..height {
        let near = plane.row((y / 2).min(plane.height - 1));
        let other = y as isize / 2 + if y % 2 == 0 { -1 } else { 1 };
        let other = plane.row(other.clamp(0, plane.height as isize - 1) as usize);
        for (r, (n, o)) in row[1..=plane.width].iter_mut().zip(near.iter().zip(other)) {
            *r = 0.75 * n + 0.25 * o;
        }
        row[0] = row[1];
        row[plane.width + 1] = row[plane.width];
        for (pair, r) in out.row_mut(y).chunks_mut(2).zip(row.windows(3)) {
            pair[0] = 0.75 * r[1] + 0.25 * r[0];
            if let Some(second) = pair.get_mut(1) {
                *second = 0.75 * r[1] + 0.25 * r[2];
            }
        }
    }
    out
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
