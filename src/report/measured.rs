//! A run's record, and what its scene asks, as the measures take them.

use std::collections::BTreeMap;

use crate::base::error::Result;
use crate::flow::field::Field;
use crate::library::piece::PieceRef;
use crate::library::variant::PIECE;
use crate::measure::{Node, Usage};
use crate::raster::image::Plane;
use crate::raster::resample::resize;
use crate::scene::asked::Asked;
use crate::scene::designed::Designed;
use crate::synth::record::{NodeRecord, RunRecord};

/// Frames of a designed target that its mean motion is of.
const TARGET_FRAMES: usize = 16;
/// Asked directions less sure than this are none.
const LEAST_STRENGTH: f32 = 0.25;

/// What is known of a video besides its frames, in pixels of the measured frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Known {
    /// The pieces it was made of; empty without a record.
    pub nodes: Vec<Node>,
    /// How often each piece was used.
    pub usage: Option<Usage>,
    /// The motion asked for: directions, times the speed where one was asked.
    pub asked: Option<Field>,
    /// The speed asked for, 0 where none was.
    pub asked_speed: Option<Plane>,
}

impl Known {
    /// Of frames measured at `size` and `fps` frames per second: from the record of their run, and from what the scene
    /// asks of frames at its own rate.
    pub fn new(record: Option<&RunRecord>, asked: Option<(&Asked, f32)>, size: (usize, usize), fps: f32) -> Self {
        let assignment = record.and_then(|record| Some((record.assignment.as_ref()?, record.working_size)));
        let (nodes, usage) = match assignment {
            Some((assignment, working)) => {
                let scale = size.0 as f32 / working.0.max(1) as f32;
                let pace = record.map_or(1.0, |record| record.scene.output.fps / fps);
                let nodes = assignment.nodes.iter().map(|n| node(n, scale, pace)).collect();
                (nodes, Some(usage(&assignment.nodes)))
            }
            None => (Vec::new(), None),
        };
        let speed = asked.and_then(|(asked, rate)| speed(asked, rate / fps, size));
        let motion = asked.and_then(|(asked, _)| motion(asked, speed.as_ref(), size));
        Self { nodes, usage, asked: motion, asked_speed: speed }
    }

    /// With the motion of a designed target, `pace` of its frames a measured one: the mean of what it has where it is
    /// opaque, over at most 16 frames; as it is where the target has none.
    ///
    /// # Errors
    /// Unreadable files.
    pub fn with_target(self, designed: &Designed, pace: f32, size: (usize, usize)) -> Result<Self> {
        if !designed.has_flow() {
            return Ok(self);
        }
        let mut mean = Field::zeros(designed.size.0, designed.size.1);
        let count = designed.frames().min(TARGET_FRAMES);
        for t in (0..count).map(|i| i * designed.frames() / count) {
            let (flow, alpha) = (designed.flow(t)?, designed.alpha(t)?);
            for (sum, part) in [(&mut mean.u, &flow.u), (&mut mean.v, &flow.v)] {
                let moving = part.data.iter().zip(&alpha.data).map(|(v, a)| v * a / count as f32);
                sum.data.iter_mut().zip(moving).for_each(|(s, v)| *s += v);
            }
        }
        let scale = pace * size.0 as f32 / designed.size.0 as f32;
        let sized = |plane: &Plane| resize(plane, size.0, size.1).map(|v| scale * v);
        Ok(Self { asked: Some(Field { u: sized(&mean.u), v: sized(&mean.v) }), ..self })
    }
}

fn node(record: &NodeRecord, scale: f32, pace: f32) -> Node {
    Node {
        x: scale * record.x as f32,
        y: scale * record.y as f32,
        side: scale * PIECE as f32,
        activity: pace * scale * record.activity,
    }
}

/// How many nodes each piece moves; a library has more pieces than there are nodes.
fn usage(nodes: &[NodeRecord]) -> Usage {
    let mut counts: BTreeMap<(usize, PieceRef), u64> = BTreeMap::new();
    nodes.iter().for_each(|n| *counts.entry((n.library, n.piece)).or_default() += 1);
    Usage { counts: counts.into_values().collect(), sources: nodes.len() as u64 }
}

/// The speed asked for, `pace` frames of the scene per frame; `None` when none is asked anywhere.
fn speed(asked: &Asked, pace: f32, (width, height): (usize, usize)) -> Option<Plane> {
    let scale = pace * width as f32 / asked.speed.width as f32;
    let known = asked.speed.map(|s| scale * s.max(0.0));
    asked.speed.data.iter().any(|&s| s >= 0.0).then(|| resize(&known, width, height).map(|s| s.max(0.0)))
}

/// The directions asked for, times the speed where one is asked, so that what is asked to stand still has none; `None`
/// when none is asked anywhere.
fn motion(asked: &Asked, speed: Option<&Plane>, (width, height): (usize, usize)) -> Option<Field> {
    let part = |plane: &Plane| resize(plane, width, height);
    let mut field = Field { u: part(&asked.direction.u), v: part(&asked.direction.v) };
    let timed = speed.map(|_| part(&asked.speed.map(|s| if s >= 0.0 { 1.0 } else { 0.0 })));
    let mut any = false;
    for (i, (u, v)) in field.u.data.iter_mut().zip(&mut field.v.data).enumerate() {
        let strength = u.hypot(*v);
        let told = timed.as_ref().is_some_and(|timed| timed.data[i] >= 0.5);
        let length = speed.filter(|_| told).map_or(1.0, |speed| speed.data[i]);
        let factor = if strength >= LEAST_STRENGTH { length / strength } else { 0.0 };
        (*u, *v) = (*u * factor, *v * factor);
        any |= factor > 0.0;
    }
    any.then_some(field)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_made_sure_and_speeds_scaled() {
        let plane = |value| Plane::filled(8, 4, value);
        let asked = |u, speed| Asked { direction: Field { u: plane(u), v: plane(0.0) }, speed: plane(speed) };
        let known = |asked: Asked, fps| Known::new(None, Some((&asked, 25.0)), (4, 2), fps);
        let still = known(asked(0.5, -1.0), 25.0);
        assert_eq!((still.asked.unwrap().u, still.asked_speed), (Plane::filled(4, 2, 1.0), None));
        let moving = known(asked(-0.5, 3.0), 25.0);
        let (motion, speed) = (moving.asked.unwrap(), moving.asked_speed.unwrap());
        assert!(motion.u.data.iter().all(|u| (u + 1.5).abs() < 1e-5));
        assert!(speed.data.iter().all(|s| (s - 1.5).abs() < 1e-5));
        // Half as many frames move twice as far each.
        assert!(known(asked(-0.5, 3.0), 12.5).asked_speed.unwrap().data.iter().all(|s| (s - 3.0).abs() < 1e-5));
        assert_eq!(known(asked(0.1, -1.0), 25.0), Known::default());
    }

    #[test]
    fn black_in_a_speed_map_has_no_weight_and_no_speed_has_one() {
        let direction = Field { u: Plane::filled(12, 4, 1.0), v: Plane::zeros(12, 4) };
        let speed = Plane::from_fn(12, 4, |x, _| [0.0, 2.0, -1.0][x / 4]);
        let known = Known::new(None, Some((&Asked { direction, speed }, 25.0)), (12, 4), 25.0);
        let motion = known.asked.unwrap();
        assert_eq!([1, 6, 10].map(|x| motion.u.at(x, 2)), [0.0, 2.0, 1.0]);
    }
}
