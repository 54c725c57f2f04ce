//! What every stage of a run looks at.

use super::options::Options;
use crate::flow::field::Field;
use crate::render::carry::Carry;
use crate::scene::file::Output;
use crate::scene::scene::{Scene, Still};
use crate::synth::method::Sources;
use crate::synth::record::Timed;

/// How the picture is carried under the pieces' differences.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carrying {
    /// Longest time that detail of the picture travels before it starts again, frames at 25 a second.
    pub life: f32,
    /// Share of that time in which the old and the new are seen together.
    pub fade: f32,
    /// Factor of the speed that the pieces' texture is measured to have, where none is asked for.
    pub pace: f32,
    /// Factor of the fluctuation of the pieces' motion about its mean; 0 lets the picture go straight along its way.
    pub sway: f32,
    /// Time until a displacement by it has shrunk to 1/e, frames at 25 a second.
    pub memory: f32,
}

impl Carrying {
    /// How the picture is carried along `flow` in the loop of `output`.
    pub fn carry<'a>(&self, flow: &'a Field, output: &Output) -> Carry<'a> {
        let &Self { life, fade, .. } = self;
        Carry { flow, frames: output.length(), fps: output.fps, life, fade, seed: output.seed }
    }
}

/// What every stage of a run looks at.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// Name of the method.
    pub name: &'static str,
    /// How the picture is carried under the differences; none: its recovered average stays.
    pub carrying: Option<&'a Carrying>,
    /// Options of the method.
    pub options: &'a Options,
    /// What is asked for.
    pub scene: &'a Scene,
    /// The libraries.
    pub sources: &'a Sources,
    /// The picture and its matte.
    pub still: &'a Still,
    /// Who is told.
    pub observer: &'a Timed<'a>,
}

impl Run<'_> {
    /// How the picture is carried, where it sways.
    pub fn swaying(&self) -> Option<&Carrying> {
        self.carrying.filter(|carrying| carrying.sway > 0.0)
    }

    /// Library frames per output frame. The rate of a library is a constant of the program that built it; several
    /// libraries have the same.
    pub fn pace(&self) -> f32 {
        self.sources.packs[0].1.parameters().rate as f32 / self.scene.settings().output.fps
    }
}
