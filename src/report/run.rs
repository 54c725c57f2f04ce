//! The report of a run: its page with the pictures beside it, and the summary.

use std::path::Path;

use super::contact_sheet::contact_sheet;
use super::run_page;
use crate::base::error::{Error, Kind, Result};
use crate::base::own_file;
use crate::raster::image::Rgb8;
use crate::raster::picture_io::write_own_png;
use crate::synth::method::Outcome;
use crate::synth::record::RunRecord;

/// Everything that [`write`] may write into its folder.
pub const FILES: [&str; 11] = [
    "index.html",
    "summary.json",
    "contact-sheet.png",
    "assignment.png",
    "motion.png",
    "exemplar.png",
    "background.png",
    "orientation.png",
    "speed.png",
    "asked-orientation.png",
    "asked-speed.png",
];
/// Frames on a contact sheet.
pub const SHEET_FRAMES: usize = 12;
/// Frames side by side on it.
const SHEET_COLUMNS: usize = 4;
/// Widest contact sheet in pixels.
const SHEET_WIDTH: usize = 1920;

/// Writes into `folder`, which exists: `index.html`, `contact-sheet.png` of `frames`, every picture of `outcome` under its
/// name, and `summary.json`. `video` is where the video lies as seen from the folder.
///
/// # Errors
/// A file in the folder that is not an earlier report's; a folder that cannot be written to, a full disk.
pub fn write(folder: &Path, outcome: &Outcome, frames: &[Rgb8], video: Option<&Path>) -> Result<()> {
    write_own_png(&folder.join("contact-sheet.png"), &contact_sheet(frames, SHEET_COLUMNS, SHEET_WIDTH))?;
    for (name, picture) in &outcome.pictures {
        let path = folder.join(name).with_extension("png");
        debug_assert!(FILES.iter().any(|file| path.ends_with(file)));
        write_own_png(&path, picture)?;
    }
    own_file::write(&folder.join("summary.json"), to_json(&outcome.record)?.as_bytes())?;
    let names: Vec<&str> = outcome.pictures.iter().map(|(name, _)| *name).collect();
    let page = run_page::page(&outcome.record, &names, video).into_string();
    own_file::write(&folder.join("index.html"), page.as_bytes())
}

/// A record as the text of `summary.json`.
///
/// # Errors
/// A path that is not UTF-8.
pub fn to_json(record: &RunRecord) -> Result<String> {
    serde_json::to_string_pretty(record).map_err(|e| Error::new(Kind::Data, "summary", e.to_string()))
}
