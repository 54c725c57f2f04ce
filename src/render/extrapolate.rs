//! Fills the places where an image is not known from those where it is: push–pull (Gortler et al. 1996, §3.4).

use crate::raster::image::Plane;
use crate::raster::pyramid::{expand, reduce};

/// How much faster than its mean a coarser level's weight grows: a pixel half known counts as known.
const GAIN: f32 = 2.0;

/// `planes` where `weight` (0 to 1) is 1, elsewhere what lies around, near before far. Where the weight is fractional,
/// the two are mixed. Without any weight everything is 0.
///
/// # Panics
/// When a plane has not the size of `weight`.
pub fn fill(planes: &[&Plane], weight: &Plane) -> Vec<Plane> {
    let mut out: Vec<Plane> = planes.iter().map(|p| (*p).clone()).collect();
    assert!(out.iter().all(|p| (p.width, p.height) == (weight.width, weight.height)));
    if weight.width.max(weight.height) > 1 {
        let coarse = coarser(&out, weight);
        for (plane, coarse) in out.iter_mut().zip(&coarse) {
            let around = expand(coarse, plane.width, plane.height);
            for ((p, a), w) in plane.data.iter_mut().zip(&around.data).zip(&weight.data) {
                *p = w * *p + (1.0 - w) * a;
            }
        }
    } else {
        out.iter_mut().zip(&weight.data).for_each(|(p, w)| p.data.iter_mut().for_each(|p| *p *= w.min(1.0).ceil()));
    }
    out
}

/// The next coarser level, filled.
fn coarser(planes: &[Plane], weight: &Plane) -> Vec<Plane> {
    let total = reduce(weight);
    let mean = |plane: &Plane| {
        let weighted = plane.data.iter().zip(&weight.data).map(|(p, w)| p * w).collect();
        let mut sum = reduce(&Plane::from_vec(plane.width, plane.height, weighted));
        sum.data.iter_mut().zip(&total.data).for_each(|(s, t)| *s = if *t > 0.0 { *s / t } else { 0.0 });
        sum
    };
    let coarse: Vec<Plane> = planes.iter().map(mean).collect();
    fill(&coarse.iter().collect::<Vec<_>>(), &total.map(|t| (GAIN * t).min(1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_stays_and_a_constant_fills_everything() {
        let plane = Plane::from_fn(61, 37, |x, y| if x < 20 && y > 9 { 0.7 } else { 0.1 });
        let weight = Plane::from_fn(61, 37, |x, y| if x < 20 && y > 9 { 1.0 } else { 0.0 });
        let out = &fill(&[&plane], &weight)[0];
        assert!(out.data.iter().all(|v| (v - 0.7).abs() < 1e-5));
    }

    #[test]
    fn the_nearer_side_wins() {
        let plane = Plane::from_fn(64, 16, |x, _| if x < 32 { 0.2 } else { 0.8 });
        let weight = Plane::from_fn(64, 16, |x, _| if (8..56).contains(&x) { 0.0 } else { 1.0 });
        let out = &fill(&[&plane], &weight)[0];
        assert!((out.at(10, 8) - 0.2).abs() < 0.06 && (out.at(53, 8) - 0.8).abs() < 0.06);
        assert!(out.row(8).windows(2).all(|pair| pair[0] <= pair[1] + 0.02));
        assert_eq!(out.at(3, 8), 0.2);
    }

    #[test]
    fn nothing_known_is_zero() {
        let out = fill(&[&Plane::filled(9, 5, 0.4)], &Plane::zeros(9, 5));
        assert!(out[0].data.iter().all(|&v| v == 0.0));
    }
}
