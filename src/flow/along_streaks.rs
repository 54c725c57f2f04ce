//! A rough flow turned along the streaks and edges of a picture: fluid flows along them, and a person who paints a
//! direction hardly hits them to the degree.
//!
//! Streaks are told by the structure tensor (Bigün & Granlund 1987; Weickert 1998, §2.2): where the gradients around a
//! place agree, the direction across them is the streak's.

use std::f32::consts::{FRAC_PI_2, PI};

use super::field::Field;
use crate::base::par;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;

/// Smoothing before gradients are taken, pixels (σ).
const FINE: f32 = 1.0;
/// Window over which gradients must agree, pixels (σ).
const WINDOW: f32 = 6.0;
/// Gradients smaller than this are noise, luma per pixel.
const NOISE: f32 = 0.004;
/// Smoothing of the turn, so that a flow stays one, pixels (σ).
const SMOOTH: f32 = 8.0;

/// How far a flow is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turning {
    /// Share of the way to the streaks where they are sure, 0 to 1.
    pub amount: f32,
    /// Streaks farther from the flow than this say nothing of it, radians, at most a right angle.
    pub reach: f32,
}

/// `flow` turned towards the streaks of a picture's `luma`, as far as these are sure and near; speeds stay. Only what is
/// within the matte counts.
pub fn along_streaks(flow: &Field, luma: &Plane, matte: &Plane, turning: &Turning) -> Field {
    let tensor = tensor(luma, matte);
    let turn: Vec<f32> = (0..luma.data.len())
        .map(|i| {
            let (streak, sure) = streak(tensor.each_ref().map(|p| p.data[i]));
            let apart = nearer_way(streak - flow.v.data[i].atan2(flow.u.data[i]));
            let near = 1.0 - (apart / turning.reach.max(1e-3)).powi(4);
            turning.amount * sure * near.max(0.0) * apart
        })
        .collect();
    let weighted = turn.iter().zip(&matte.data).map(|(t, m)| t * m).collect();
    let mut turn = gaussian(&Plane::from_vec(luma.width, luma.height, weighted), SMOOTH);
    turn.data.iter_mut().zip(&gaussian(matte, SMOOTH).data).for_each(|(t, w)| *t /= w.max(1e-3));
    turned(flow, &turn)
}

/// Gradients' products (xx, xy, yy), averaged around every pixel.
fn tensor(luma: &Plane, matte: &Plane) -> [Plane; 3] {
    // Beyond the matte what is within goes on, so that its edge is no streak.
    let weighted = luma.data.iter().zip(&matte.data).map(|(l, m)| l * m).collect();
    let mut fine = gaussian(&Plane::from_vec(luma.width, luma.height, weighted), FINE);
    fine.data.iter_mut().zip(&gaussian(matte, FINE).data).for_each(|(f, w)| *f /= w.max(1e-4));
    let slope = |x: usize, y: usize| {
        let (x, y) = (x as isize, y as isize);
        let across = 0.5 * (fine.clamped(x + 1, y) - fine.clamped(x - 1, y));
        (across, 0.5 * (fine.clamped(x, y + 1) - fine.clamped(x, y - 1)))
    };
    let product = |k: usize| {
        let at = |x: usize, y: usize| {
            let (across, down) = slope(x, y);
            matte.at(x, y) * [across * across, across * down, down * down][k]
        };
        gaussian(&Plane::from_fn(luma.width, luma.height, at), WINDOW)
    };
    par::map(3, product).try_into().expect("three planes")
}

/// Direction of the streaks, and how much gradients agree on it, 0 to 1.
fn streak([xx, xy, yy]: [f32; 3]) -> (f32, f32) {
    let apart = (xx - yy).hypot(2.0 * xy);
    (0.5 * (2.0 * xy).atan2(xx - yy) + FRAC_PI_2, apart / (xx + yy + NOISE * NOISE))
}

/// The angle between lines, which have no head: within a right angle each way.
fn nearer_way(angle: f32) -> f32 {
    (angle + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2
}

fn turned(flow: &Field, turn: &Plane) -> Field {
    let mut out = flow.clone();
    for ((u, v), turn) in out.u.data.iter_mut().zip(&mut out.v.data).zip(&turn.data) {
        let (sin, cos) = turn.sin_cos();
        (*u, *v) = (cos * *u - sin * *v, sin * *u + cos * *v);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (120, 100);
    const TURNING: Turning = Turning { amount: 1.0, reach: 0.8 };

    /// Stripes that run `degrees` from the x axis.
    fn stripes(degrees: f32, contrast: f32) -> Plane {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Plane::from_fn(SIZE.0, SIZE.1, |x, y| 0.5 + contrast * (0.6 * (cos * y as f32 - sin * x as f32)).sin())
    }

    fn towards(degrees: f32) -> Field {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Field { u: Plane::filled(SIZE.0, SIZE.1, 3.0 * cos), v: Plane::filled(SIZE.0, SIZE.1, 3.0 * sin) }
    }

    fn refined(stripes: &Plane, asked: f32, turning: &Turning) -> (f32, f32) {
        let flow = along_streaks(&towards(asked), stripes, &Plane::filled(SIZE.0, SIZE.1, 1.0), turning);
        let (u, v) = (flow.u.at(60, 50), flow.v.at(60, 50));
        (v.atan2(u).to_degrees(), u.hypot(v))
    }

    #[test]
    fn a_flow_a_little_off_the_streaks_is_turned_along_them_and_keeps_its_speed() {
        for (streak, asked) in [(70.0, 90.0), (110.0, 90.0), (-100.0, -80.0), (20.0, 0.0)] {
            let (angle, speed) = refined(&stripes(streak, 0.2), asked, &TURNING);
            assert!((angle - streak).abs() < 3.0, "{asked}° along streaks of {streak}° became {angle}°");
            assert!((speed - 3.0).abs() < 1e-3);
        }
    }

    #[test]
    fn streaks_that_cross_the_flow_and_flat_places_say_nothing() {
        for (picture, asked) in [(stripes(0.0, 0.2), 80.0), (stripes(70.0, 0.0), 90.0)] {
            let (angle, _) = refined(&picture, asked, &TURNING);
            assert!((angle - asked).abs() < 0.5, "{angle}");
        }
        let (angle, _) = refined(&stripes(70.0, 0.2), 90.0, &Turning { amount: 0.0, ..TURNING });
        assert!((angle - 90.0).abs() < 1e-3);
    }

    #[test]
    fn what_is_outside_the_matte_does_not_count() {
        let matte = Plane::from_fn(SIZE.0, SIZE.1, |x, _| f32::from(x < 60));
        let picture = stripes(70.0, 0.2);
        let other = Plane::from_fn(SIZE.0, SIZE.1, |x, y| if x < 62 { picture.at(x, y) } else { 0.1 * y as f32 });
        let refine = |picture: &Plane| along_streaks(&towards(90.0), picture, &matte, &TURNING);
        let (a, b) = (refine(&picture), refine(&other));
        assert!((0..50).all(|x| (a.u.at(x, 50) - b.u.at(x, 50)).abs() < 1e-3));
    }
}
