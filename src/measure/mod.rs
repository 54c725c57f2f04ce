//! Numbers for what a video looks like and how it moves, without any trained network.
//!
//! Every measure is one line of [`ALL`]: a name, a unit, a definition and a function of a [`Subject`]. A measure whose
//! inputs are missing gives `None`. All of them look only at what lies inside the matte. `docs/metrics.md` says what
//! each one means and what fools it: none should be quoted alone.

mod colour;
mod continuity;
mod definition;
mod detail;
pub mod footage;
mod likeness;
mod motion;
pub mod nodes;
pub mod over_time;
mod patches;
pub mod preference;
pub mod read;
mod renewal;
mod sharpness;
mod sliced;
pub mod spectrum;
pub mod subject;
pub mod worst;

pub use definition::{Better, Measure};
pub use footage::{Footage, Recorder};
pub use subject::{Node, Subject, Usage};

/// Every measure, in the order of reports.
pub const ALL: &[Measure] = &[
    likeness::LIKENESS,
    likeness::LIKENESS_OF_DYNAMICS,
    likeness::LIKENESS_OF_SPECTRUM,
    likeness::LIKENESS_OF_DEVIATION,
    likeness::LIKENESS_OF_RENEWAL,
    likeness::LIKENESS_OF_DETAIL,
    patches::PATCH_DISTANCE,
    patches::DYNAMICS_DISTANCE,
    patches::DYNAMICS_SHAPE,
    spectrum::TEMPORAL_SPECTRUM_DISTANCE,
    likeness::DEVIATION_RATIO,
    colour::COLOUR_DISTANCE,
    detail::DETAIL_LOST,
    detail::DETAIL_ADDED,
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
