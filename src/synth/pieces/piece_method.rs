//! The library's route from its first stage to its last (Okabe, Anjyo & Onai 2011).

use super::options::Options;
use super::outcome::outcome;
use super::pick::{self, LabelOptions};
use super::placing::place;
use super::run::{Carrying, Run};
use super::{frames, gate, rendering};
use crate::assign::candidates;
use crate::assign::nodes::NodeGrid;
use crate::assign::pair_costs::Weights;
use crate::assign::solve;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::stage;
use crate::scene::scene::Scene;
use crate::synth::memory;
use crate::synth::method::{Outcome, Sources, Synthesizer};
use crate::synth::record::Timed;
use crate::video::clip::Sink;

/// A method that borrows motion piece by piece from a library.
pub struct PieceMethod {
    name: &'static str,
    options: Options,
    carrying: Option<Carrying>,
    random: bool,
}

impl Synthesizer for PieceMethod {
    fn synthesize(&self, scene: &Scene, sources: &Sources, sink: &mut dyn Sink, observer: &Timed) -> Result<Outcome> {
        let Self { name, options, carrying, .. } = self;
        check_sources(name, sources)?;
        let still = stage(observer, "read picture", 0, || scene.still(observer))?;
        let run = Run { name, carrying: carrying.as_ref(), options, scene, sources, still: &still, observer };
        let grid = NodeGrid::over(&still.working_matte, 0.02)?;
        let wishes = gate::wishes(&grid, &still);
        let candidates = pick::candidates(&grid, &still, &wishes, sources, scene, &self.search(), observer)?;
        memory::check(scene)?;
        let labels = match self.random {
            true => pick::random_labels(&candidates, scene.settings().output.seed),
            false => pick::labels(&grid, &still, &wishes, &candidates, sources, &self.labelling(scene), observer)?,
        };
        let placed = place(&run, &grid, &labels.choices, wishes)?;
        let mut clips = frames::study(&run, &placed)?;
        // A library cut short by somebody else while it is mapped must not be read any further.
        sources.packs.iter().try_for_each(|(_, pack)| pack.check_length())?;
        let apart = rendering::separate(&run, &placed)?;
        let rendering = stage(observer, "prepare", 0, || rendering::prepare(&run, &placed, &mut clips, apart))?;
        frames::make(&run, &placed, &clips, &rendering, sink)?;
        outcome(&run, &placed, &clips, &rendering, &candidates, &labels)
    }
}

impl PieceMethod {
    /// A method of this name; the differences are laid over the recovered average, or over a picture that is carried.
    pub fn new(name: &'static str, options: Options, carrying: Option<Carrying>) -> Self {
        Self { name, options, carrying, random: false }
    }

    /// The same with a random candidate at every node: what the labels are worth is measured against it.
    pub fn with_random_labels(self) -> Self {
        Self { random: true, ..self }
    }

    fn search(&self) -> candidates::Options {
        candidates::Options { count: self.options.candidates, per_place: self.options.per_place }
    }

    fn labelling(&self, scene: &Scene) -> LabelOptions {
        let Options { sigma, rho, lambda, texture, still, lively, direction, speed, solver, sweeps, .. } = self.options;
        let solver = solve::Options { solver, sweeps };
        let (weights, fps) = (Weights { sigma, rho }, scene.settings().output.fps);
        LabelOptions { weights, lambda, texture, still, lively, direction, speed, fps, solver }
    }
}

fn check_sources(name: &str, sources: &Sources) -> Result<()> {
    if sources.packs.is_empty() {
        return Err(Error::new(Kind::Usage, "library", format!("the {name} method needs a library"))
            .remedy("build one with `enliven-db build CLIPS -o NAME.pack`, and name it with --library NAME.pack"));
    }
    Ok(())
}
