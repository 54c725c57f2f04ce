//! Measures frame by frame, for plots and to find the worst frame.

use serde::{Deserialize, Serialize};

use super::footage::spread;
use super::subject::Subject;
use super::{ALL, colour, continuity, motion, sharpness};

/// Most frames looked at.
const FRAMES: usize = 60;

/// What values lie along.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Along {
    /// Numbers of frames.
    Frames,
    /// Frequencies in Hz.
    Hertz,
}

/// Values of one measure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Series {
    /// Name of the measure in [`ALL`] that it belongs to.
    pub measure: String,
    /// What the places are.
    pub along: Along,
    /// Frame numbers, or Hz, in rising order.
    pub places: Vec<f64>,
    /// A value for each place.
    pub values: Vec<f64>,
}

impl Series {
    /// The frame with the worst value; none where the places are no frames.
    pub fn worst_frame(&self) -> Option<usize> {
        let better = ALL.iter().find(|measure| measure.name == self.measure)?.better;
        let badness = |v: &f64| better.badness(*v);
        let worst = self.places.iter().zip(&self.values).max_by(|a, b| badness(a.1).total_cmp(&badness(b.1)))?;
        (self.along == Along::Frames).then_some(*worst.0 as usize)
    }
}

/// Sharpness retention, colour distance and warp error over time, and the spectrum of flicker; those whose inputs are
/// there, at most 60 frames of each, evenly spread.
pub fn over_time(subject: &Subject) -> Vec<Series> {
    let frames = spread(subject.footage.frames().len(), FRAMES);
    let numbers = |frames: &[usize]| frames.iter().map(|&t| t as f64).collect::<Vec<f64>>();
    let series = |measure: &str, places: Vec<f64>, values: Vec<f64>| Series {
        measure: measure.to_owned(),
        along: Along::Frames,
        places,
        values,
    };
    let sharpness = sharpness::at(subject, &frames)
        .map(|values| series(sharpness::SHARPNESS_RETENTION.name, numbers(&frames), values));
    let colour =
        colour::at(subject, &frames).map(|values| series(colour::COLOUR_DISTANCE.name, numbers(&frames), values));
    let (firsts, errors) = motion::warp_errors(subject.footage);
    let warp = (!errors.is_empty()).then(|| series(motion::WARP_ERROR.name, numbers(&firsts), errors));
    let flicker = continuity::flicker_spectrum(subject.footage).map(|(width, values)| {
        let places = (1..=values.len()).map(|k| k as f64 * width).collect();
        Series { along: Along::Hertz, ..series(continuity::FLICKER.name, places, values) }
    });
    [sharpness, colour, warp, flicker].into_iter().flatten().collect()
}
