//! The files that a run writes beside its video, and how they are found again.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::own_file::{self, Inputs};
use crate::synth::record::RunRecord;
use crate::video::write::sink;

/// What the record of a run is called beside its video.
pub const SUMMARY: &str = "summary.json";

/// The record written beside a video, when there is one.
///
/// # Errors
/// A file that cannot be read as one.
pub fn record_of(video: &Path) -> Result<Option<RunRecord>> {
    let Some(path) = written_beside(video, SUMMARY) else { return Ok(None) };
    let text = std::fs::read_to_string(&path).map_err(|e| Error::io(&path, "read", e))?;
    let record = serde_json::from_str(&text).map_err(|e| {
        Error::file(Kind::Data, &path, format!("cannot be read as the summary of a run: {e}"))
            .remedy("make the video again, or move this file away to measure without it")
    })?;
    Ok(Some(record))
}

/// Where a file of the program's own goes beside `output`: under its usual name, or where a person's file or one that this
/// run reads has that, under the next that is free, which is told.
pub fn free_beside(output: &Path, what: &str, inputs: &Inputs, observer: &dyn Observer) -> PathBuf {
    let usual = beside(output, what);
    let path = inputs.free(names_beside(output, what)).unwrap_or_else(|| usual.clone());
    if path != usual {
        observer.note(&format!("{}: stays as it is; this run writes {}", usual.display(), path.display()));
    }
    path
}

/// What was written beside a video by the latest run: of the files of the program's own the youngest, else one that a person
/// put there under the usual name.
pub fn written_beside(video: &Path, what: &str) -> Option<PathBuf> {
    let usual = beside(video, what);
    let others = names_beside(video, what).skip(1).take_while(|path| path.exists());
    let own = std::iter::once(usual.clone()).chain(others).filter(|path| own_file::is_own(path));
    let age = |path: &PathBuf| path.metadata().and_then(|found| found.modified()).ok();
    own.max_by_key(age).or_else(|| usual.exists().then_some(usual))
}

/// `falls.scene.toml`, `falls.run.scene.toml`, `falls.run2.scene.toml`…
fn names_beside(output: &Path, what: &str) -> impl Iterator<Item = PathBuf> {
    let numbered = (2..1000).map(|n| format!("run{n}.")).map(Cow::Owned);
    let infixes = [Cow::Borrowed(""), "run.".into()].into_iter().chain(numbered);
    infixes.map(move |infix| beside(output, &format!("{infix}{what}")))
}

/// `falls.mp4` and `scene.toml` to `falls.scene.toml`; a folder keeps its whole name, whether it is there yet or not.
pub fn beside(output: &Path, what: &str) -> PathBuf {
    let name = if sink::is_folder(output) { output.file_name() } else { output.file_stem() };
    let mut name = name.unwrap_or_default().to_os_string();
    name.push(".");
    name.push(what);
    output.with_file_name(name)
}
