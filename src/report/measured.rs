//! A run's record, and what its scene asks, as the measures take them.

use std::collections::BTreeMap;

use crate::flow::field::Field;
use crate::library::piece::PieceRef;
use crate::library::variant::PIECE;
use crate::measure::{Node, Usage};
use crate::raster::image::Plane;
use crate::raster::resample::resize;
use crate::scene::asked::Asked;
use crate::synth::record::{NodeRecord, RunRecord};

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
    /// Of frames measured at `size`: from the record of their run, and from what the scene asks.
    pub fn new(record: Option<&RunRecord>, asked: Option<&Asked>, size: (usize, usize)) -> Self {
        let assignment = record.and_then(|record| Some((record.assignment.as_ref()?, record.working_size)));
        let (nodes, usage) = match assignment {
            Some((assignment, working)) => {
                let scale = size.0 as f32 / working.0.max(1) as f32;
                (assignment.nodes.iter().map(|n| node(n, scale)).collect(), Some(usage(&assignment.nodes)))
            }
            None => (Vec::new(), None),
        };
        let speed = asked.and_then(|asked| speed(asked, size));
        let motion = asked.and_then(|asked| motion(asked, speed.as_ref(), size));
        Self { nodes, usage, asked: motion, asked_speed: speed }
    }
}

fn node(record: &NodeRecord, scale: f32) -> Node {
    Node {
        x: scale * record.x as f32,
        y: scale * record.y as f32,
        side: scale * PIECE as f32,
        activity: scale * record.activity,
    }
}

/// How many nodes each piece moves; a library has more pieces than there are nodes.
fn usage(nodes: &[NodeRecord]) -> Usage {
    let mut counts: BTreeMap<(usize, PieceRef), u64> = BTreeMap::new();
    nodes.iter().for_each(|n| *counts.entry((n.library, n.piece)).or_default() += 1);
    Usage { counts: counts.into_values().collect(), sources: nodes.len() as u64 }
}

/// The speed asked for; `None` when none is asked anywhere.
fn speed(asked: &Asked, (width, height): (usize, usize)) -> Option<Plane> {
    let scale = width as f32 / asked.speed.width as f32;
    let known = asked.speed.map(|s| scale * s.max(0.0));
    asked.speed.data.iter().any(|&s| s >= 0.0).then(|| resize(&known, width, height).map(|s| s.max(0.0)))
}

/// The directions asked for, times the speed where one is asked; `None` when none is asked anywhere.
fn motion(asked: &Asked, speed: Option<&Plane>, (width, height): (usize, usize)) -> Option<Field> {
    let part = |plane: &Plane| resize(plane, width, height);
    let mut field = Field { u: part(&asked.direction.u), v: part(&asked.direction.v) };
    let mut any = false;
    for (i, (u, v)) in field.u.data.iter_mut().zip(&mut field.v.data).enumerate() {
        let strength = u.hypot(*v);
        let length = speed.map(|s| s.data[i]).filter(|s| *s > 0.0).unwrap_or(1.0);
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
        let known = Known::new(None, Some(&asked(0.5, -1.0)), (4, 2));
        assert_eq!((known.asked.unwrap().u, known.asked_speed), (Plane::filled(4, 2, 1.0), None));
        let known = Known::new(None, Some(&asked(-0.5, 3.0)), (4, 2));
        let (motion, speed) = (known.asked.unwrap(), known.asked_speed.unwrap());
        assert!(motion.u.data.iter().all(|u| (u + 1.5).abs() < 1e-5));
        assert!(speed.data.iter().all(|s| (s - 1.5).abs() < 1e-5));
        assert_eq!(Known::new(None, Some(&asked(0.1, -1.0)), (4, 2)), Known::default());
    }
}
