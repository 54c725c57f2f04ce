//! What a person can choose of the library's route.

use crate::assign::solve::Solver;
use crate::base::error::{Error, Kind, Result};
use crate::base::options::{Table, Value, declare_options};

declare_options! {
    /// Options of the library's route: all are those of `database`, most those of `hybrid`.
    pub struct Options named "database" {
        /// Candidates per node; more is slower.
        candidates: usize = 100, in 1, 1000, "pieces", "Okabe 2011, §5.1";
        /// Most candidates from one place of one clip; 0 is no limit.
        per_place: usize = 0, in 0, 1000, "pieces", "methods §1.6", EXPERT;
        /// Weight of the motion spectrum against the mean motion, between neighbours.
        sigma: f32 = 1.0, in 0, 100, "ratio", "Okabe 2011, Eq. 3", EXPERT;
        /// Weight of the textureness between neighbours.
        rho: f32 = 1.0, in 0, 100, "ratio", "Okabe 2011, Eq. 2", EXPERT;
        /// Weight of the smoothness term against the data term.
        lambda: f32 = 0.06, in 0, 10, "ratio", "Okabe 2011, §5.3", EXPERT;
        /// Weight of how rough picture and piece are, as part of the data term.
        texture: f32 = 0.1, in 0, 10, "ratio", "methods §1.6", EXPERT;
        /// Weight of how slowly a piece changes, as part of the data term: 0 takes quiet pieces for wild water as well.
        lively: f32 = 0.2, in 0, 10, "ratio", "methods §1.6", EXPERT;
        /// Weight of the share of a piece that stands still where the picture's fluid should move.
        still: f32 = 0.2, in 0, 10, "ratio", "methods §1.1", EXPERT;
        /// Weight of half the angle's versine between a piece's motion and the asked direction, as part of the data term.
        direction: f32 = 0.4, in 0, 10, "ratio", "Okabe 2011, §5", EXPERT;
        /// Weight of every octave by which a piece is too slow or too fast for the asked speed, beyond what playback mends.
        speed: f32 = 0.1, in 0, 10, "ratio", "methods §1.6", EXPERT;
        /// How the energy is minimised: messages and then moves, one of them alone; "expansion" is the paper's.
        solver: Solver = Solver::Dual, in 0, 2, "", "Okabe 2011, §5.3", EXPERT;
        /// Most sweeps of messages, and most rounds of moves; both end sooner when nothing changes.
        sweeps: usize = 100, in 0, 10000, "sweeps", "Kolmogorov 2006", EXPERT;
        /// Exposure of the recovered average image: a streak is this many frames of motion long.
        shutter: f32 = 6.0, in 0, 100, "frames", "Okabe 2011, §6";
        /// Width of the Gaussian in the recovered average image, per speed.
        blur: f32 = 0.5, in 0, 10, "frames", "Okabe 2011, §6";
        /// Share of the recovered average image; the rest keeps the picture's own detail, still.
        recovery: f32 = 0.8, in 0, 1, "ratio", "methods §1.6";
        /// Contrast of the motion relative to what the picture's contrast and the clip's still part leave for it.
        strength: f32 = 1.0, in 0, 4, "ratio", "methods §1.5";
        /// Largest factor on a clip's differences, before `coarse`; more lifts its noise.
        max_gain: f32 = 3.0, in 1, 20, "ratio", "Okabe 2011, Fig. 13", EXPERT;
        /// Factor of the coarse bands of the differences, where swell, changing light and large flames live.
        coarse: f32 = 1.0, in 0, 4, "ratio", "methods §1.6";
        /// Share of the way to the picture's own distribution of detail that frames are brought, place by place.
        appearance: f32 = 0.5, in 0, 1, "ratio", "Heeger & Bergen 1995";
        /// Side of the places.
        regions: usize = 96, in 24, 10000, "pixels", "Okabe 2011, §6", EXPERT;
        /// Largest factor on the detail of frames on that way.
        appearance_gain: f32 = 2.0, in 1, 20, "ratio", "Okabe 2011, Fig. 13", EXPERT;
        /// How far the outline lets go of the matte, as fire and smoke do: 0 not at all, 0.9 much; -1 takes 0.9 where most
        /// pieces come from clips tagged fire or smoke, else 0.
        tau: f32 = -1.0, in -1, 0.98, "ratio", "Okabe 2011, §6";
        /// How much an outline that moves opens and closes with the bright and dark of the fluid in it.
        flicker: f32 = 1.0, in 0, 4, "ratio", "methods §1.5";
        /// Detail finer than a working pixel travels with the flow where the output is larger; false keeps it in place.
        drift: bool = true, in 0, 1, "switch", "methods §2.4", EXPERT;
        /// Phases of its loop that a clip is used at; more keeps copies from moving in unison, and is slower.
        phases: usize = 1, in 1, 8, "phases", "methods §1.5", EXPERT;
    }
}

/// Candidates per node of a preview.
const PREVIEW_CANDIDATES: i64 = 25;

impl Options {
    /// Fewer candidates for a quick look, unless a person set their number.
    pub fn shrink(table: &mut Table) {
        table.entry("candidates".into()).or_insert(Value::Integer(PREVIEW_CANDIDATES));
    }

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
