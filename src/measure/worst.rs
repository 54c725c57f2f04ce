//! The frame in which a measure is worst, where it is one of frames, or of steps between them.

use super::over_time::Series;
use super::subject::Subject;
use super::{continuity, nodes};

/// Names of measures with the number of the frame in which each is worst: by their values over time where there are such,
/// else where a single frame stands out. Measures of whole videos have none.
pub fn worst_frames(subject: &Subject, series: &[Series]) -> Vec<(String, usize)> {
    let over_time = series.iter().filter_map(|s| Some((s.measure.clone(), s.worst_frame()?)));
    let steps = continuity::worst_frames(subject.footage).into_iter();
    let seams = nodes::worst_frame(subject).map(|frame| (nodes::SEAM_RATIO.name, frame));
    over_time.chain(steps.chain(seams).map(|(name, frame)| (name.to_owned(), frame))).collect()
}
