//! Methods beside each other on the same scenes: what was made, what was measured, the tables and the page.

pub mod blind;
mod colours;
mod groups;
mod overall;
mod page;
mod plots;
mod reading;
mod results;
mod scene_plot;
mod slices;
mod sort;
mod sweeps;
mod table;
mod tables;
mod videos;

pub use results::{Comparison, Row, SLICE, SceneRows};
pub use sort::Sort;

use std::path::Path;

use serde::Serialize;

use crate::base::atomic_file;
use crate::base::error::{Error, Kind, Result};
use colours::Palette;
use overall::{Overall, overall};

/// Everything that was found, and what follows from it for all scenes together.
#[derive(Serialize)]
struct Results<'a> {
    #[serde(flatten)]
    comparison: &'a Comparison,
    overall: &'a [Overall],
}

/// File of the votes of a blind test, with names.
pub const VOTES: &str = "votes.csv";

impl Comparison {
    /// Writes the page, the tables, and the plots of finished scenes into `folder`, which holds the videos.
    ///
    /// # Errors
    /// A folder that cannot be written to, a full disk.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let overall = overall(self);
        let results = Results { comparison: self, overall: &overall };
        let json = serde_json::to_string_pretty(&results);
        let json = json.map_err(|e| Error::new(Kind::Data, "results", e.to_string()))?;
        let palette = Palette::new(self);
        self.scenes.iter().try_for_each(|scene| plots::write(scene, &palette, folder))?;
        let files = [
            ("results.json", json),
            ("results.csv", tables::csv(self)),
            ("summary.csv", tables::summary(&overall)),
            ("index.html", page::page(self, &overall).into_string()),
        ];
        let votes = self.blind.as_ref().map(|test| (VOTES, tables::votes(test)));
        files
            .into_iter()
            .chain(votes)
            .try_for_each(|(name, text)| atomic_file::write(&folder.join(name), text.as_bytes()))
    }
}
