//! The static flow that a picture is carried along, and how.

use super::placing::Placed;
use super::run::Run;
use super::travel;
use crate::base::error::Result;
use crate::flow::field::Field;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::raster::resample::resize;
use crate::render::extrapolate::fill;
use crate::render::recover::AssignedMotion;
use crate::scene::asked::{Asked, FLUID};
use crate::scene::scene::Still;

/// Smoothing of the pieces' motion over the picture, pixels of the working image: neighbouring pieces disagree, and a
/// picture must not be torn where they meet.
const SMOOTH: f32 = 24.0;
/// A direction less sure than this is none.
const SURE: f32 = 0.25;

/// What the picture of a run is carried along, see [`flow`]; `pace` is the user's.
///
/// # Errors
/// A damaged pack, a cancel.
pub fn of(run: &Run, placed: &Placed, pace: f32) -> Result<Field> {
    Ok(flow(run.still, &travel::measure(run, placed)?, pace * run.pace()))
}

/// Motion in pixels of the working image per output frame, at working size: what is asked for; where nothing is, that of
/// the assigned pieces, times `pace` (output per library frame). A direction asked without a speed takes the pieces', and
/// a speed without a direction theirs.
fn flow(still: &Still, motion: &AssignedMotion, pace: f32) -> Field {
    let (width, height) = still.map.working;
    let matte = &still.working_matte;
    let smooth = |plane: &Plane| within(&resize(plane, width, height).map(|v| pace * v), matte);
    let [u, v, activity] = [&motion.mean.u, &motion.mean.v, &motion.activity].map(smooth);
    let mut flow = Field { u, v };
    if let Some(asked) = &still.asked {
        follow(&mut flow, asked, &activity);
    }
    let known = matte.map(|m| if m > FLUID { 1.0 } else { 0.0 });
    let [u, v] = fill(&[&flow.u, &flow.v], &known).try_into().expect("two planes of two");
    Field { u, v }
}

fn follow(flow: &mut Field, asked: &Asked, activity: &Plane) {
    for i in 0..activity.data.len() {
        let (u, v, speed) = (asked.direction.u.data[i], asked.direction.v.data[i], asked.speed.data[i]);
        let own = (flow.u.data[i], flow.v.data[i]);
        // From nothing asked to something in between: a picture is torn where motion leaps.
        let sure = ((u.hypot(v) - SURE) / SURE).clamp(0.0, 1.0);
        let along = |(u, v): (f32, f32), length: f32| {
            let scale = if speed >= 0.0 { speed } else { length } / u.hypot(v).max(1e-6);
            (scale * u, scale * v)
        };
        let (asked, own) = (along((u, v), activity.data[i]), along(own, own.0.hypot(own.1)));
        let mix = |asked: f32, own: f32| own + sure * (asked - own);
        (flow.u.data[i], flow.v.data[i]) = (mix(asked.0, own.0), mix(asked.1, own.1));
    }
}

/// Smoothed, counting what lies within the matte.
fn within(plane: &Plane, matte: &Plane) -> Plane {
    let weight = matte.map(|m| m.max(1e-3));
    let weighted = plane.data.iter().zip(&weight.data).map(|(p, w)| p * w).collect();
    let mut sum = gaussian(&Plane::from_vec(plane.width, plane.height, weighted), SMOOTH);
    sum.data.iter_mut().zip(&gaussian(&weight, SMOOTH).data).for_each(|(s, t)| *s /= t);
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_does_not_leap_where_a_direction_becomes_sure() {
        let (width, still) = (101, Plane::zeros(101, 1));
        let direction = Field { u: Plane::from_fn(width, 1, |x, _| x as f32 * 0.01), v: still.clone() };
        let asked = Asked { direction, speed: still.map(|_| 6.0) };
        let mut flow = Field { u: still.clone(), v: still.map(|_| -1.0) };
        follow(&mut flow, &asked, &still.map(|_| 1.0));
        assert!((flow.u.data[20], flow.v.data[20]) == (0.0, -6.0) && (flow.u.data[60], flow.v.data[60]) == (6.0, 0.0));
        assert!(flow.u.data.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.3));
    }
}
