//! Texture optimization (Kwatra et al. 2005): each patch takes its nearest, and the frame is held to the one before it.
//! What the others are compared with.

use crate::base::error::{Error, Kind, Result};
use crate::base::options::declare_options;
use crate::patch::data::channels::Role;
use crate::patch::engine::Settings;
use crate::patch::rules::Rule;
use crate::patch::vote::Manner;
use crate::scene::scene::{Scene, Still};
use crate::synth::exemplar::exemplar::Wanted;
use crate::synth::method::{MethodEntry, Outcome, Sources, Synthesizer};
use crate::synth::record::Timed;
use crate::synth::sequence::chain::Recipe;
use crate::synth::sequence::channels::{Channels, Content};
use crate::synth::sequence::patch_method::{PatchMethod, Showing, synthesize};
use crate::video::clip::Sink;

declare_options! {
    /// Options of texture optimization.
    pub struct Options named "kwatra" {
        /// Weight of the frame before at a pixel, against all the patches over it.
        lambda: f32 = 0.5, in 0, 100, "ratio", "LazyFluids 2015, Eq. 1";
        /// Weight of the given alpha, where the exemplar has any.
        alpha: f32 = 3.0, in 0, 10, "ratio", "LazyFluids 2015, Eq. 9";
        /// Side of a patch, odd.
        patch: usize = 5, in 3, 9, "pixels", "LazyFluids 2015, §5";
        /// Most rounds of search and vote on the finest level; the coarsest has twice as many.
        iterations: usize = 20, in 1, 1000, "rounds", "methods §2.2";
        /// Long side of the exemplar; 0 shrinks it until it has no more fluid than the target. It is never enlarged.
        exemplar_size: usize = 0, in 0, 4096, "pixels", "ours";
        /// Exposure of every frame: motion blur along the flow, this many frames long.
        shutter: f32 = 0.0, in 0, 10, "frames", "LazyFluids 2015, Fig. 9";
        /// Frames of the fade that closes a loop.
        fade: usize = 16, in 0, 1000, "frames", "methods §2.4";
    }
}

/// Registry entry.
pub const ENTRY: MethodEntry = MethodEntry {
    name: "kwatra",
    summary: "gives a fluid of known motion the looks of an exemplar, each patch its nearest: the baseline of lazyfluids",
    citation: "Kwatra, Essa, Bobick & Kwatra, \"Texture Optimization for Example-based Synthesis\", ACM TOG 24(3), 2005",
    library: false,
    exemplars: usize::MAX,
    designed: true,
    options: Options::declared,
    complete: |table| Ok(Options::from_table(table)?.checked()?.to_table()),
    preview: |_| {},
    build: |table| Ok(Box::new(Kwatra { options: Options::from_table(table)?.checked()? })),
};

/// The method with its options.
pub struct Kwatra {
    options: Options,
}

impl Options {
    /// What a range alone cannot say.
    fn checked(self) -> Result<Self> {
        if self.patch.is_multiple_of(2) {
            return Err(Error::new(Kind::Usage, "kwatra.patch", format!("{} is out of range", self.patch))
                .allowed("3, 5, 7 or 9"));
        }
        Ok(self)
    }
}

impl PatchMethod for Options {
    fn wanted(&self, still: &Still) -> Wanted {
        Wanted { long_side: self.exemplar_size, turns: 1, side: self.patch, enlarged: still.map.enlarged() }
    }

    /// Colour alone is made; alpha is given. The frame before has a weight per pixel, so in units of the n² patches over it.
    fn recipe(&self, _: bool, seed: u64) -> Recipe {
        let mut all: Vec<(Content, f32, Role)> = (0..3).map(|c| (Content::Now(c), 1.0, Role::Synthesised)).collect();
        all.push((Content::Now(3), self.alpha, Role::Guide));
        let settings = Settings {
            rule: Rule::Plain,
            iterations: (2 * self.iterations, self.iterations),
            manner: Manner::Robust,
            seed,
            ..Settings::default()
        };
        Recipe {
            channels: Channels::new(all, 0.0, 0.0),
            radius: self.patch / 2,
            settings,
            turned: false,
            anchor: self.lambda * (self.patch * self.patch) as f32,
            keep: 1.0,
            carries_field: false,
        }
    }

    fn showing(&self) -> Showing {
        Showing { fade: self.fade, shutter: self.shutter }
    }
}

impl Synthesizer for Kwatra {
    fn synthesize(&self, scene: &Scene, _: &Sources, sink: &mut dyn Sink, observer: &Timed) -> Result<Outcome> {
        synthesize(&self.options, scene, sink, observer)
    }
}
