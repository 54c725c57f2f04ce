//! The database method: motion borrowed piece by piece from a library (Okabe, Anjyo & Onai 2011).

use super::outcome::outcome;
use super::pick::{self, LabelOptions};
use super::placing::place;
use super::record::Timed;
use super::{MethodEntry, Outcome, Sources, Synthesizer, frames, gate, hybrid, memory, rendering};
use crate::assign::candidates;
use crate::assign::nodes::NodeGrid;
use crate::assign::pair_costs::Weights;
use crate::assign::solve::{self, Solver};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::stage;
use crate::base::options::declare_options;
use crate::scene::scene::{Scene, Still};
use crate::video::clip::Sink;

declare_options! {
    /// Options of the database method.
    pub struct Options named "database" {
        /// Candidates per node; more is slower.
        candidates: usize = 100, in 1, 1000, "pieces", "Okabe 2011, §5.1";
        /// Most candidates from one place of one clip; 0 is no limit.
        per_place: usize = 0, in 0, 1000, "pieces", "methods §1.6";
        /// Weight of the motion spectrum against the mean motion, between neighbours.
        sigma: f32 = 1.0, in 0, 100, "ratio", "Okabe 2011, Eq. 3";
        /// Weight of the textureness between neighbours.
        rho: f32 = 1.0, in 0, 100, "ratio", "Okabe 2011, Eq. 2";
        /// Weight of the smoothness term against the data term.
        lambda: f32 = 0.06, in 0, 10, "ratio", "Okabe 2011, §5.3";
        /// Weight of how rough picture and piece are, as part of the data term.
        texture: f32 = 0.1, in 0, 10, "ratio", "methods §1.6";
        /// Weight of how slowly a piece changes, as part of the data term: 0 takes quiet pieces for wild water as well.
        lively: f32 = 0.2, in 0, 10, "ratio", "methods §1.6";
        /// Weight of the share of a piece that stands still where the picture's fluid should move.
        still: f32 = 0.2, in 0, 10, "ratio", "methods §1.1";
        /// Weight of half the angle's versine between a piece's motion and the asked direction, as part of the data term.
        direction: f32 = 0.4, in 0, 10, "ratio", "Okabe 2011, §5";
        /// Weight of every octave by which a piece is too slow or too fast for the asked speed, beyond what playback mends.
        speed: f32 = 0.1, in 0, 10, "ratio", "methods §1.6";
        /// How the energy is minimised: messages and then moves, one of them alone; "expansion" is the paper's.
        solver: Solver = Solver::Dual, in 0, 2, "", "Okabe 2011, §5.3";
        /// Most sweeps of messages, and most rounds of moves; both end sooner when nothing changes.
        sweeps: usize = 100, in 0, 10000, "sweeps", "Kolmogorov 2006";
        /// Exposure of the recovered average image: a streak is this many frames of motion long.
        shutter: f32 = 6.0, in 0, 100, "frames", "Okabe 2011, §6";
        /// Width of the Gaussian in the recovered average image, per speed.
        blur: f32 = 0.5, in 0, 10, "frames", "Okabe 2011, §6";
        /// Share of the recovered average image; the rest keeps the picture's own detail, still.
        recovery: f32 = 0.8, in 0, 1, "ratio", "methods §1.6";
        /// Contrast of the motion relative to what the picture's contrast and the clip's still part leave for it.
        strength: f32 = 1.0, in 0, 4, "ratio", "methods §1.5";
        /// Largest factor on a clip's differences, before `coarse`; more lifts its noise.
        max_gain: f32 = 3.0, in 1, 20, "ratio", "Okabe 2011, Fig. 13";
        /// Factor of the coarse bands of the differences, where swell, changing light and large flames live.
        coarse: f32 = 1.0, in 0, 4, "ratio", "methods §1.6";
        /// Share of the way to the picture's own distribution of detail that frames are brought, place by place.
        appearance: f32 = 0.5, in 0, 1, "ratio", "Heeger & Bergen 1995";
        /// Side of the places.
        regions: usize = 96, in 24, 10000, "pixels", "Okabe 2011, §6";
        /// Largest factor on the detail of frames on that way.
        appearance_gain: f32 = 2.0, in 1, 20, "ratio", "Okabe 2011, Fig. 13";
        /// How far the outline lets go of the matte, as fire and smoke do: 0 not at all, 0.9 much; -1 takes 0.9 where most
        /// pieces come from clips tagged fire or smoke, else 0.
        tau: f32 = -1.0, in -1, 0.98, "ratio", "Okabe 2011, §6";
        /// How much an outline that moves opens and closes with the bright and dark of the fluid in it.
        flicker: f32 = 1.0, in 0, 4, "ratio", "methods §1.5";
        /// Detail finer than a working pixel travels with the flow where the output is larger; false keeps it in place.
        drift: bool = true, in 0, 1, "switch", "methods §2.4";
        /// Phases of its loop that a clip is used at; more keeps copies from moving in unison, and is slower.
        phases: usize = 1, in 1, 8, "phases", "methods §1.5";
    }
}

/// Registry entry.
pub const ENTRY: MethodEntry = MethodEntry {
    name: "database",
    summary: "borrows motion piece by piece from a library of clips",
    citation: "Okabe, Anjyo & Onai, \"Creating Fluid Animation from a Single Image using Video Database\", CGF 30(7), 2011",
    library: true,
    exemplars: 0,
    designed: false,
    options: Options::declared,
    complete: |table| Ok(Options::from_table(table)?.checked("database")?.to_table()),
    build: |table| Ok(Box::new(Database::new(Options::from_table(table)?.checked("database")?))),
};

impl Options {
    /// What a range alone cannot say; `name` is the method's.
    ///
    /// # Errors
    /// An outline that lets go by a negative share.
    pub fn checked(self, name: &str) -> Result<Self> {
        if self.tau < 0.0 && self.tau != -1.0 {
            return Err(Error::new(Kind::Usage, format!("{name}.tau"), format!("{} is out of range", self.tau))
                .allowed("0 to 0.98, or -1 for what the clips' fluid wants"));
        }
        Ok(self)
    }
}

/// The method with its options; or, with what to carry, the hybrid of it and `advect`.
pub struct Database {
    name: &'static str,
    options: Options,
    carrying: Option<hybrid::Options>,
    random: bool,
}

/// What every stage of a run looks at.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// Name of the method.
    pub name: &'static str,
    /// How the picture is carried under the differences; none: its recovered average stays.
    pub carrying: Option<&'a hybrid::Options>,
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
    /// Library frames per output frame. The rate of a library is a constant of the program that built it; several
    /// libraries have the same.
    pub fn pace(&self) -> f32 {
        self.sources.packs[0].1.parameters().rate as f32 / self.scene.settings().output.fps
    }
}

impl Synthesizer for Database {
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

impl Database {
    /// The method as it is.
    pub fn new(options: Options) -> Self {
        Self { name: ENTRY.name, options, carrying: None, random: false }
    }

    /// The stages of the database method, its differences laid over a picture that is carried.
    pub fn carrying(name: &'static str, options: Options, carrying: hybrid::Options) -> Self {
        Self { name, options, carrying: Some(carrying), random: false }
    }

    /// The method with a random candidate at every node: what the labels are worth is measured against it.
    ///
    /// # Errors
    /// Options that do not go together.
    pub fn with_random_labels(options: Options) -> Result<Self> {
        Ok(Self { random: true, ..Self::new(options.checked(ENTRY.name)?) })
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
