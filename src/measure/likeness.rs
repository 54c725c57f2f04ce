//! One number for how far a video is like a real clip, which sliding, freezing, grain and blur cannot win.
//!
//! Every single measure is won by a fault: a frozen picture has all the detail, a sliding one moves, grain changes as much
//! as water does, blur is never wrong by much. So five errors are taken together: of the dynamics, of the spectrum over
//! time, of the deviation over time, of how long forms last, and of the detail. Each is 0 for another stretch of the clip itself and 1 for what
//! nobody takes for it. The likeness is 1 less their root mean square, so that one bad part cannot be paid for by the rest.

use super::definition::{Better, Measure};
use super::detail;
use super::footage::Footage;
use super::patches;
use super::renewal;
use super::spectrum;
use super::subject::Subject;

/// Decibels of the temporal spectrum distance that count as a whole error: a tenth, or tenfold, of the power.
const DECADE: f64 = 10.0;
/// Difference of correlations that counts as a whole error: what is new never falls to 0, since something near is alike.
const HALF: f64 = 0.5;

/// All parts together.
pub const LIKENESS: Measure = Measure {
    name: "likeness",
    unit: "0 to 1",
    definition: "1 less the root mean square of five errors, of dynamics, spectrum, deviation, renewal and detail: 1 is like another stretch of the reference",
    needs: "reference, 32 frames in each; a picture or reference of the video's size",
    better: Better::Higher,
    compute: |subject| {
        let parts = [dynamics(subject)?, spectrum(subject)?, deviation(subject)?, renewal(subject)?, detail(subject)?];
        Some(1.0 - (parts.iter().map(|error| error * error).sum::<f64>() / parts.len() as f64).sqrt())
    },
};

/// The motion itself.
pub const LIKENESS_OF_DYNAMICS: Measure = Measure {
    name: "likeness of dynamics",
    unit: "0 to 1",
    definition: "1 less the dynamics distance between its floor (one half of the reference against the other) and that of the frozen clip",
    needs: "reference, 14 frames",
    better: Better::Higher,
    compute: |subject| Some(1.0 - dynamics(subject)?),
};

/// How fast things happen.
pub const LIKENESS_OF_SPECTRUM: Measure = Measure {
    name: "likeness of spectrum",
    unit: "0 to 1",
    definition: "1 less the temporal spectrum distance above its floor, over 10 dB",
    needs: "reference, 32 frames in each",
    better: Better::Higher,
    compute: |subject| Some(1.0 - spectrum(subject)?),
};

/// How much changes.
pub const LIKENESS_OF_DEVIATION: Measure = Measure {
    name: "likeness of deviation",
    unit: "0 to 1",
    definition: "1 less the octaves between the deviations over time of video and reference, above their floor",
    needs: "reference, 14 frames",
    better: Better::Higher,
    compute: |subject| Some(1.0 - deviation(subject)?),
};

/// How long forms last.
pub const LIKENESS_OF_RENEWAL: Measure = Measure {
    name: "likeness of renewal",
    unit: "0 to 1",
    definition: "1 less twice the difference, above its floor, in how well what is seen in a window is found again within 48 pixels after 4 and 12 frames",
    needs: "reference, 13 frames in each",
    better: Better::Higher,
    compute: |subject| Some(1.0 - renewal(subject)?),
};

/// What is seen in a frame that stands.
pub const LIKENESS_OF_DETAIL: Measure = Measure {
    name: "likeness of detail",
    unit: "0 to 1",
    definition: "1 less the detail lost and added, above what the reference itself loses and adds",
    needs: "picture or reference, of the video's size",
    better: Better::Higher,
    compute: |subject| Some(1.0 - detail(subject)?),
};

/// Strength of the motion.
pub const DEVIATION_RATIO: Measure = Measure {
    name: "deviation ratio",
    unit: "ratio",
    definition: "deviation over time of luma, root mean square over the fluid, over that of the reference",
    needs: "reference",
    better: Better::One,
    compute: |subject| {
        let ratio =
            patches::deviation(subject.footage, subject.seed)? / patches::deviation(subject.reference?, subject.seed)?;
        ratio.is_finite().then_some(ratio)
    },
};

/// Error of the dynamics, 0 to 1.
fn dynamics(subject: &Subject) -> Option<f64> {
    let (reference, seed) = (subject.reference?, subject.seed);
    let own = patches::dynamics_distance(subject.footage, reference, seed)?;
    let frozen = patches::deviation(reference, seed)?;
    let floor = reference.halves().and_then(|[a, b]| patches::dynamics_distance(a, b, seed)).unwrap_or(0.0);
    // Of a clip whose halves differ as much as a frozen picture does, nothing can be told.
    (frozen > 0.0).then(|| ((own - floor) / (frozen - floor).max(0.1 * frozen)).clamp(0.0, 1.0))
}

/// Error of the spectrum, 0 to 1.
fn spectrum(subject: &Subject) -> Option<f64> {
    let (reference, seed) = (subject.reference?, subject.seed);
    let own = spectrum::distance(subject.footage, reference, seed)?;
    let floor = reference.halves().and_then(|[a, b]| spectrum::distance(a, b, seed)).unwrap_or(0.0);
    Some(((own - floor) / DECADE).clamp(0.0, 1.0))
}

/// Error of the deviation, 0 to 1.
fn deviation(subject: &Subject) -> Option<f64> {
    let (reference, seed) = (subject.reference?, subject.seed);
    let octaves = |a: &Footage, b: &Footage| {
        let (a, b) = (patches::deviation(a, seed)?, patches::deviation(b, seed)?);
        (b > 0.0).then(|| (a / b).log2().abs())
    };
    let floor = reference.halves().and_then(|[a, b]| octaves(a, b)).unwrap_or(0.0);
    Some((octaves(subject.footage, reference)? - floor).clamp(0.0, 1.0))
}

/// Error of the renewal, 0 to 1.
fn renewal(subject: &Subject) -> Option<f64> {
    let (reference, seed) = (subject.reference?, subject.seed);
    let between = |a: &Footage, b: &Footage| {
        let (a, b) = (renewal::kept(a, seed)?, renewal::kept(b, seed)?);
        Some(a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>() / b.len() as f64)
    };
    let floor = reference.halves().and_then(|[a, b]| between(a, b)).unwrap_or(0.0);
    Some(((between(subject.footage, reference)? - floor) / HALF).clamp(0.0, 1.0))
}

/// Error of the detail, 0 to 1.
fn detail(subject: &Subject) -> Option<f64> {
    Some(detail::above_floor(subject)?.clamp(0.0, 1.0))
}
