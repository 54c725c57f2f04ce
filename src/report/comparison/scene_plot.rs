//! A plot of a scene, with what is told beside it.

use crate::measure::Measure;
use crate::report::plot::Drawing;

/// A plot of a scene.
pub struct Plot {
    /// Name of its file.
    pub file: String,
    /// The measure whose values it shows over swept options; none over time.
    pub measure: Option<&'static Measure>,
    /// What it shows.
    pub caption: String,
    /// The plot.
    pub drawing: Drawing,
}
