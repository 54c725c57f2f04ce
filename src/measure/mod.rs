//! Numbers for what a video looks like and how it moves, without any trained network.
//!
//! Every measure is one line of [`ALL`]: a name, a unit, a definition and a function of a [`Subject`]. A measure whose
//! inputs are missing gives `None`. All of them look only at what lies inside the matte. `docs/metrics.md` says what
//! each one means and what fools it: none should be quoted alone.

mod colour;
mod continuity;
pub mod footage;
mod motion;
pub mod nodes;
pub mod over_time;
mod patches;
pub mod preference;
pub mod read;
mod sharpness;
mod sliced;
mod spectrum;
pub mod subject;
pub mod worst;

pub use footage::{Footage, Recorder};
pub use nodes::Node;
pub use subject::{Subject, Usage};

/// Which way a measure is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Better {
    /// Smaller is better.
    Lower,
    /// Larger is better.
    Higher,
    /// Nearer to 0 is better, from either side.
    Zero,
    /// Nearer to 1 is better, from either side.
    One,
}

impl Better {
    /// How bad a value is: the lower, the better.
    pub fn badness(self, value: f64) -> f64 {
        match self {
            Self::Lower => value,
            Self::Higher => -value,
            Self::Zero => value.abs(),
            Self::One => (value - 1.0).abs(),
        }
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Lower => "lower",
            Self::Higher => "higher",
            Self::Zero => "near 0",
            Self::One => "near 1",
        }
    }
}

/// One measure.
#[derive(Debug, Clone, Copy)]
pub struct Measure {
    /// Name, as tables print it.
    pub name: &'static str,
    /// Unit of the value.
    pub unit: &'static str,
    /// What is computed, in one line.
    pub definition: &'static str,
    /// What it needs beyond the frames; empty when nothing.
    pub needs: &'static str,
    /// Which way is better.
    pub better: Better,
    /// The value; `None` when an input is missing or the value has no meaning (0 / 0).
    pub compute: fn(&Subject) -> Option<f64>,
}

/// Every measure, in the order of reports.
pub const ALL: &[Measure] = &[
    patches::PATCH_DISTANCE,
    patches::DYNAMICS_DISTANCE,
    patches::DYNAMICS_SHAPE,
    spectrum::TEMPORAL_SPECTRUM_DISTANCE,
    colour::COLOUR_DISTANCE,
    sharpness::SHARPNESS_RETENTION,
    sharpness::SHARPNESS_SLOPE,
    motion::WARP_ERROR,
    continuity::FLICKER,
    continuity::LOOP_RATIO,
    continuity::LARGEST_STEP_RATIO,
    continuity::CONTRAST_DIP,
    motion::DIRECTION_ERROR,
    motion::SPEED_CORRELATION,
    motion::MOTION_SHARE,
    nodes::SEAM_RATIO,
    nodes::MIDLINE_VARIANCE_RATIO,
    nodes::USAGE_ENTROPY,
];

/// A measure and its value.
pub type Value = (&'static Measure, Option<f64>);

/// Every measure of `subject`, in the order of [`ALL`].
pub fn all(subject: &Subject) -> Vec<Value> {
    ALL.iter().map(|measure| (measure, (measure.compute)(subject))).collect()
}

/// One measure by its name; `None` when there is none of that name, or it gives none.
pub fn value(name: &str, subject: &Subject) -> Option<f64> {
    ALL.iter().find(|measure| measure.name == name).and_then(|measure| (measure.compute)(subject))
}
