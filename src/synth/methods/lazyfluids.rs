//! LazyFluids: the looks of an exemplar on a fluid whose motion is given (Jamriška et al. 2015).

use crate::base::error::{Error, Kind, Result};
use crate::base::options::declare_options;
use crate::patch::data::channels::Role;
use crate::patch::data::segments::Thresholds;
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
    /// Options of LazyFluids.
    pub struct Options named "lazyfluids" {
        /// Which patches may be used how often: "uniform" is the method, the others are what it is compared with.
        nnf: Rule = Rule::Uniform, in 0, 4, "", "LazyFluids 2015, §4.1, Fig. 2";
        /// Weight of the frame before.
        lambda: f32 = 0.2, in 0, 10, "ratio", "LazyFluids 2015, Eq. 9";
        /// Weight of blurred alpha: less gives richer outlines.
        eta: f32 = 3.0, in 0, 10, "ratio", "LazyFluids 2015, Eq. 9";
        /// Half width of the blur of alpha.
        r: f32 = 3.0, in 0, 50, "pixels", "LazyFluids 2015, §4.2";
        /// Blurred alpha up to which there is nothing.
        l: f32 = 0.1, in 0, 1, "ratio", "LazyFluids 2015, §4.2";
        /// Blurred alpha from which a patch is inside.
        u: f32 = 0.9, in 0, 1, "ratio", "LazyFluids 2015, §4.2";
        /// Side of a patch, odd.
        patch: usize = 5, in 3, 9, "pixels", "LazyFluids 2015, §5";
        /// Quarter turns of the exemplar that are sources too: 4, or 1 for the exemplar as it stands.
        rotations: usize = 1, in 1, 4, "turns", "LazyFluids 2015, Fig. 8";
        /// Most rounds of search and vote on the finest level; the coarsest has twice as many.
        iterations: usize = 30, in 1, 1000, "rounds", "methods §2.2";
        /// How much the picture's own fluid keeps its place: weight of the mean colour of the fluid around a pixel.
        place: f32 = 4.0, in 0, 20, "ratio", "ours";
        /// How far around.
        around: f32 = 12.0, in 1, 200, "pixels", "ours";
        /// How much of the frame before every level starts from, where the exemplar is not the picture's own fluid: less looks
        /// crisper and boils more.
        keep: f32 = 0.75, in 0, 1, "ratio", "ours";
        /// How the patches over a pixel make it.
        vote: Manner = Manner::Median, in 0, 4, "", "Wexler et al. 2007; ours";
        /// Long side of the exemplar; 0 shrinks it until it has no more fluid than the target, so that all of it is used.
        /// It is never enlarged.
        exemplar_size: usize = 0, in 0, 4096, "pixels", "ours";
        /// Exposure of every frame: motion blur along the flow, this many frames long.
        shutter: f32 = 0.0, in 0, 10, "frames", "LazyFluids 2015, Fig. 9";
        /// Frames of the fade that closes a loop.
        fade: usize = 16, in 0, 1000, "frames", "methods §2.4";
    }
}

/// Registry entry.
pub const ENTRY: MethodEntry = MethodEntry {
    name: "lazyfluids",
    summary: "gives a fluid of known motion the looks of an exemplar, all of whose patches are used equally often",
    citation: "Jamriška, Fišer, Asente, Lu, Shechtman & Sýkora, \"LazyFluids: Appearance Transfer for Fluid Animations\", \
               ACM TOG 34(4), 2015",
    library: false,
    exemplars: usize::MAX,
    designed: true,
    options: Options::declared,
    complete: |table| Ok(Options::from_table(table)?.checked()?.to_table()),
    preview: |_| {},
    build: |table| Ok(Box::new(LazyFluids { options: Options::from_table(table)?.checked()? })),
};

/// The method with its options.
pub struct LazyFluids {
    options: Options,
}

impl Options {
    /// What a range alone cannot say.
    fn checked(self) -> Result<Self> {
        let bad = |key: &str, value: String, allowed: &str| {
            Err(Error::new(Kind::Usage, format!("lazyfluids.{key}"), format!("{value} is out of range"))
                .allowed(allowed))
        };
        match self {
            Self { patch, .. } if patch.is_multiple_of(2) => bad("patch", patch.to_string(), "3, 5, 7 or 9"),
            Self { rotations, .. } if ![1, 4].contains(&rotations) => bad("rotations", rotations.to_string(), "1 or 4"),
            Self { l, u, .. } if l >= u => bad("l", l.to_string(), "less than lazyfluids.u"),
            _ => Ok(self),
        }
    }

    /// The channels of Eq. 8 with the weights of Eq. 9; the picture's own fluid also keeps its place.
    fn channels(&self, own: bool) -> Channels {
        use Content::{Around, Before, Blurred, Now};
        let mut all: Vec<(Content, f32, Role)> = (0..3).map(|c| (Now(c), 1.0, Role::Synthesised)).collect();
        all.extend([(Now(3), 3.0, Role::Synthesised), (Blurred, self.eta, Role::Guide)]);
        all.extend((0..3).map(|c| (Before(c), self.lambda, Role::Modulated)));
        all.push((Before(3), 3.0 * self.lambda, Role::Modulated));
        if own && self.place > 0.0 {
            all.extend((0..3).map(|c| (Around(c), self.place, Role::Guide)));
        }
        Channels::new(all, self.r / 2.0, self.around)
    }
}

impl PatchMethod for Options {
    fn wanted(&self, still: &Still) -> Wanted {
        let Self { exemplar_size: long_side, rotations: turns, patch: side, .. } = *self;
        Wanted { long_side, turns, side, enlarged: still.map.enlarged() }
    }

    fn recipe(&self, own: bool, seed: u64) -> Recipe {
        let settings = Settings {
            rule: self.nnf,
            manner: self.vote,
            iterations: (2 * self.iterations, self.iterations),
            thresholds: Thresholds { lower: self.l, upper: self.u },
            seed,
            ..Settings::default()
        };
        Recipe {
            channels: self.channels(own),
            radius: self.patch / 2,
            settings,
            turned: self.rotations == 4,
            anchor: 0.0,
            keep: if own { 1.0 } else { self.keep },
            carries_field: true,
        }
    }

    fn showing(&self) -> Showing {
        Showing { fade: self.fade, shutter: self.shutter }
    }
}

impl Synthesizer for LazyFluids {
    fn synthesize(&self, scene: &Scene, _: &Sources, sink: &mut dyn Sink, observer: &Timed) -> Result<Outcome> {
        synthesize(&self.options, scene, sink, observer)
    }
}
