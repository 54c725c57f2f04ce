//! A run's record and scene as what the measures take.

use std::collections::BTreeMap;

use crate::flow::field::Field;
use crate::library::piece::PieceRef;
use crate::library::variant::PIECE;
use crate::measure::{Node, Usage};
use crate::raster::image::Plane;
use crate::scene::file::SceneFile;
use crate::synth::record::{NodeRecord, RunRecord};

/// What is known of a video besides its frames, in pixels of the measured frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Known {
    /// The pieces it was made of.
    pub nodes: Vec<Node>,
    /// How often each piece was used.
    pub usage: Option<Usage>,
    /// The motion asked for.
    pub asked: Option<Field>,
}

impl Known {
    /// Of frames measured at `size`, from the record of the run that made them.
    pub fn of_run(record: &RunRecord, size: (usize, usize)) -> Self {
        let records = record.assignment.as_ref().map_or(&[][..], |a| &a.nodes);
        let scale = size.0 as f32 / record.working_size.0.max(1) as f32;
        let usage = usage(records);
        let asked = asked_everywhere(&record.scene, size);
        Self { nodes: records.iter().map(|n| node(n, scale)).collect(), usage, asked }
    }

    /// Of frames measured at `size`, from a scene alone.
    pub fn of_scene(scene: &SceneFile, size: (usize, usize)) -> Self {
        Self { asked: asked_everywhere(scene, size), ..Self::default() }
    }
}

fn node(record: &NodeRecord, scale: f32) -> Node {
    Node {
        x: scale * record.x as f32,
        y: scale * record.y as f32,
        side: scale * PIECE as f32,
        motion: (scale * record.motion.0, scale * record.motion.1),
        activity: scale * record.activity,
    }
}

/// How many nodes each piece moves; a library has more pieces than there are nodes.
fn usage(nodes: &[NodeRecord]) -> Option<Usage> {
    let mut counts: BTreeMap<(usize, PieceRef), u64> = BTreeMap::new();
    nodes.iter().for_each(|n| *counts.entry((n.library, n.piece)).or_default() += 1);
    (!nodes.is_empty()).then(|| Usage { counts: counts.into_values().collect(), sources: nodes.len() as u64 })
}

/// The one direction a scene asks for, as unit vectors.
fn asked_everywhere(scene: &SceneFile, (width, height): (usize, usize)) -> Option<Field> {
    let direction = scene.motion.direction?.to_radians();
    let filled = |value| Plane::filled(width, height, value);
    Some(Field { u: filled(direction.cos()), v: filled(direction.sin()) })
}
