//! What a comparison found.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::blind::findings::BlindTest;
use super::sort::Sort;
use crate::base::error::{Error, Kind, Result};
use crate::measure::Measure;
use crate::measure::over_time::Series;

/// Everything that a comparison found.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Version of the program, and the first bytes of its hash.
    pub program: String,
    /// What repeats it, run in its folder.
    pub command: String,
    /// The scenes, in the order asked for.
    pub scenes: Vec<SceneRows>,
    /// What people chose who did not know which video was which; none where nobody was asked.
    #[serde(default)]
    pub blind: Option<BlindTest>,
}

/// A scene and what was made of it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneRows {
    /// Its name, also that of its folder and of its file below `scenes`.
    pub name: String,
    /// Frames of each video.
    pub frames: usize,
    /// Frames per second.
    pub fps: f32,
    /// Width and height of the frames.
    pub size: (usize, usize),
    /// Pictures that explain it: a file as seen from the page, and what it shows.
    pub pictures: Vec<(String, String)>,
    /// What gives meaning to the numbers, and the methods.
    pub rows: Vec<Row>,
}

/// One video with its figures.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Row {
    /// Name within its scene: a method, with the options that a sweep sets.
    pub name: String,
    /// What it is.
    pub sort: Sort,
    /// The method; empty where none was run.
    pub method: String,
    /// What a sweep sets: options of the method, and their values as they were written.
    pub point: Vec<(String, String)>,
    /// Whether it stands there to give meaning to the numbers of others.
    pub baseline: bool,
    /// The video, as seen from the page.
    pub video: Option<String>,
    /// Which line of its frames the slice through time beside the video shows; none without a slice.
    #[serde(default)]
    pub line: Option<String>,
    /// The page of its run.
    pub page: Option<String>,
    /// A picture of the motion that it aimed at, as seen from the page.
    pub motion: Option<String>,
    /// Why there is no video.
    pub failed: Option<String>,
    /// Seconds that the method took.
    pub seconds: Option<f64>,
    /// Values by the names of [`crate::measure::ALL`]; those without a value are left out.
    pub values: BTreeMap<String, f64>,
    /// Values over time.
    pub series: Vec<Series>,
    /// Numbers of the frames in which a measure is worst, by its name.
    pub worst: BTreeMap<String, usize>,
    /// What it was made from: it is made again when any of this changes.
    pub made_from: BTreeMap<String, String>,
}

impl Row {
    /// Its slice through time, as seen from the page, and which line of the frames it shows.
    pub(super) fn slice(&self) -> Option<(String, &str)> {
        let (video, line) = self.video.as_deref().zip(self.line.as_deref())?;
        Some((PathBuf::from(video).with_extension(SLICE).display().to_string(), line))
    }

    /// A measure's value.
    pub fn value(&self, measure: &Measure) -> Option<f64> {
        self.values.get(measure.name).copied()
    }

    /// Whether there is a video.
    pub fn is_made(&self) -> bool {
        self.video.is_some()
    }

    /// Whether it gives meaning to the numbers of others.
    pub(super) fn is_reference(&self) -> bool {
        self.baseline || self.sort != Sort::Method
    }

    /// Whether it still has to be tried.
    pub fn is_to_make(&self) -> bool {
        self.video.is_none() && self.failed.is_none()
    }
}

impl SceneRows {
    /// Whether all that can be made is made.
    pub(super) fn is_finished(&self) -> bool {
        !self.rows.iter().any(Row::is_to_make)
    }

    /// The methods' rows that were made, without the one that is a reference.
    pub(super) fn methods(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| !row.is_reference() && row.is_made())
    }

    /// Whether a row is the best method by a measure, or as good.
    pub(super) fn is_best(&self, row: &Row, measure: &Measure) -> bool {
        let badness = |row: &Row| row.value(measure).map(|v| measure.better.badness(v));
        !row.is_reference() && self.best(measure).is_some_and(|best| badness(best) == badness(row))
    }

    /// The best method by a measure; none where fewer than two have a value.
    pub(super) fn best(&self, measure: &Measure) -> Option<&Row> {
        let with: Vec<(&Row, f64)> = self.methods().filter_map(|row| Some((row, row.value(measure)?))).collect();
        let badness = |v: f64| measure.better.badness(v);
        let best = with.iter().min_by(|a, b| badness(a.1).total_cmp(&badness(b.1)))?;
        (with.len() > 1).then_some(best.0)
    }
}

/// Extension of a row's slice through time, beside its video.
pub const SLICE: &str = "slice.png";

impl Comparison {
    /// Reads what was written into `folder`.
    ///
    /// # Errors
    /// A folder without a comparison, or one by another version.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join("results.json");
        if !path.exists() {
            return Err(Error::file(Kind::Unusable, folder, "there is no comparison in this folder")
                .remedy("name one with -o that enliven compare has made"));
        }
        let text = std::fs::read_to_string(&path).map_err(|e| Error::io(&path, "read", e))?;
        serde_json::from_str(&text).map_err(|e| {
            Error::file(Kind::Data, &path, format!("cannot be read as a comparison: {e}")).remedy("run it again")
        })
    }

    /// How many rows still have to be tried.
    pub fn to_make(&self) -> usize {
        self.scenes.iter().flat_map(|scene| &scene.rows).filter(|row| row.is_to_make()).count()
    }
}
