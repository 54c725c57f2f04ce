//! The static flow that a picture is carried along, and how.

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

/// Motion in pixels of the working image per output frame, at working size: what is asked for; where nothing is, that of
/// the assigned pieces, times `pace` (output per library frame). A direction asked without a speed takes the pieces', and
/// a speed without a direction theirs.
pub fn flow(still: &Still, motion: &AssignedMotion, pace: f32) -> Field {
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
        let ((u, v), least) = if u.hypot(v) >= SURE { ((u, v), 0.0) } else { (own, 1e-6) };
        let length = if speed >= 0.0 {
            speed
        } else if least == 0.0 {
            activity.data[i]
        } else {
            own.0.hypot(own.1)
        };
        let scale = length / u.hypot(v).max(1e-6);
        (flow.u.data[i], flow.v.data[i]) = (scale * u, scale * v);
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
