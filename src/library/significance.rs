//! Which pixels of a clip are fluid: the motion mask (Okabe et al. 2011, §4, Fig. 5-d).
//!
//! The paper keeps pixels whose *averaged motion* is significant. Two readings are changed. A place that oscillates has
//! no mean motion, so the mean *length* of the motion is tested. And whitewater changes too fast for optical flow, which
//! reports next to nothing there, so the temporal deviation of the intensity stands beside it: what either of them
//! lacks the other may make up for, but neither may be as small as noise.

use crate::raster::filter;
use crate::raster::image::Plane;

/// Mean length of the motion that is significant on its own evidence, working pixels per frame.
pub const ACTIVITY: f32 = 0.15;
/// Temporal standard deviation of the luma that goes with it: five steps of 8-bit luma.
pub const DEVIATION: f32 = 5.0 / 255.0;
/// Least mean length of the motion, whatever the deviation: what flow shows on noise between still frames.
pub const LEAST_ACTIVITY: f32 = 0.03;
/// Least deviation, whatever the motion: what rounding and a lossy codec do to a still picture.
pub const LEAST_DEVIATION: f32 = 1.5 / 255.0;
/// Smoothing of both before the test, Gaussian, in working pixels.
const SMOOTHING: f32 = 2.0;

/// 1 where motion is significant, 0 elsewhere, from the mean length of the motion (working pixels per frame) and the
/// temporal deviation of luma in [0, 1]. `allowed` (white = use) takes pixels out on the user's behalf.
pub fn mask(activity: &Plane, deviation: &Plane, allowed: Option<&Plane>) -> Plane {
    let activity = filter::gaussian(activity, SMOOTHING);
    let deviation = filter::gaussian(deviation, SMOOTHING);
    Plane::from_fn(activity.width, activity.height, |x, y| {
        let (a, d) = (activity.at(x, y), deviation.at(x, y));
        let moves = a >= LEAST_ACTIVITY && d >= LEAST_DEVIATION && a * d >= ACTIVITY * DEVIATION;
        let used = allowed.is_none_or(|allowed| allowed.at(x, y) >= 0.5);
        f32::from(u8::from(moves && used))
    })
}

/// Mean of `plane` over the rectangle from `(x0, y0)` to `(x1, y1)`, continuous positions inside it, by covered area.
pub fn area_mean(plane: &Plane, (x0, y0): (f32, f32), (x1, y1): (f32, f32)) -> f32 {
    let span = |from: f32, to: f32, end: usize| (from.max(0.0) as usize)..(to.ceil() as usize).min(end);
    let cover = |from: f32, to: f32, at: usize| (to.min(at as f32 + 1.0) - from.max(at as f32)).max(0.0);
    let mut sum = 0.0;
    for y in span(y0, y1, plane.height) {
        let row: f32 = span(x0, x1, plane.width).map(|x| cover(x0, x1, x) * plane.at(x, y)).sum();
        sum += cover(y0, y1, y) * row;
    }
    sum / ((x1 - x0) * (y1 - y0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(activity: f32, deviation: f32) -> bool {
        let plane = |v| Plane::filled(8, 8, v);
        mask(&plane(activity), &plane(deviation), None).at(4, 4) == 1.0
    }

    #[test]
    fn both_kinds_of_evidence_are_needed_and_one_may_help_the_other() {
        assert!(verdict(0.5, 0.05) && verdict(0.1, 0.1) && verdict(1.0, 0.008));
        assert!(!verdict(0.0, 0.3) && !verdict(2.0, 0.0) && !verdict(0.05, 0.02));
    }

    #[test]
    fn the_user_may_take_pixels_out() {
        let half = Plane::from_fn(16, 8, |x, _| f32::from(u8::from(x < 8)));
        let mask = mask(&Plane::filled(16, 8, 1.0), &Plane::filled(16, 8, 1.0), Some(&half));
        assert_eq!(mask, half);
    }

    #[test]
    fn area_means_weigh_parts_of_pixels() {
        let ramp = Plane::from_fn(12, 12, |x, _| x as f32 + 0.5);
        assert!((area_mean(&ramp, (16.0 / 3.0, 0.0), (32.0 / 3.0, 16.0 / 3.0)) - 8.0).abs() < 0.05);
        assert_eq!(area_mean(&ramp, (4.0, 4.0), (8.0, 8.0)), 6.0);
    }
}
