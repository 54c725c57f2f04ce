//! Making a row: the video, its figures, and what becomes of a failure.

use std::collections::BTreeMap;
use std::path::Path;

use super::figures::figures;
use super::kept::Fingerprints;
use super::plan::{Cell, PlannedScene};
use super::{baselines, kept};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::report::animate::animate;
use crate::report::comparison::{Row, Sort};
use crate::report::measuring::{Measuring, Request};
use crate::report::yardstick::Yardstick;

/// What is known of a row before it is made.
pub struct Found {
    /// The row as it was made before, where nothing that it is made from has changed.
    pub kept: Option<Row>,
    /// Why it is made again; empty where it was never made.
    again: String,
    made_from: Result<BTreeMap<String, String>>,
}

/// Looks whether a row in its scene's `folder` still holds.
pub fn look(folder: &Path, cell: &Cell, files: &Fingerprints) -> Found {
    let made_from = kept::ingredients(cell, files);
    let before = kept::load(folder, &cell.stem);
    let (kept, again) = match (&made_from, before) {
        (Ok(now), Some(before)) => {
            let changes = kept::changes(&before.made_from, now);
            if !changes.is_empty() {
                (None, format!(" made again, changed: {}", changes.join(", ")))
            } else if !folder.join(format!("{}.mp4", cell.stem)).exists() {
                (None, " made again, its video is gone".into())
            } else {
                let Row { name, sort, method, point, baseline, .. } = cell.empty();
                (Some(Row { name, sort, method, point, baseline, ..before }), String::new())
            }
        }
        _ => (None, String::new()),
    };
    Found { kept, again, made_from }
}

/// Makes a row, `called` so when people are told of it. What fails is told in the row.
///
/// # Errors
/// A full disk; an interruption.
pub fn row(
    output: &Path,
    scene: &PlannedScene,
    (cell, found): (&Cell, Found),
    called: &str,
    observer: &dyn Observer,
) -> Result<Row> {
    observer.note(&format!("{called}:{}", found.again));
    let folder = output.join(&scene.name);
    let made = found.made_from.and_then(|made_from| {
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "make the folder", e))?;
        kept::forget(&folder, &cell.stem)?;
        Ok(Row { made_from, ..make(&folder, scene, cell, observer)? })
    });
    match made {
        Ok(row) => {
            kept::save(&row, &folder, &cell.stem)?;
            Ok(row)
        }
        Err(error) if ends_all(&error) => Err(error),
        Err(error) => {
            observer.note(&format!("{called}: {error}"));
            Ok(Row { failed: Some(error.to_string()), ..cell.empty() })
        }
    }
}

/// Whether no other row could be made either: the user has stopped it, or nothing can be written any more.
fn ends_all(error: &Error) -> bool {
    use std::io::ErrorKind::{QuotaExceeded, ReadOnlyFilesystem, StorageFull};
    let cause = std::error::Error::source(error).and_then(|cause| cause.downcast_ref::<std::io::Error>());
    let unwritable = cause.is_some_and(|e| [StorageFull, QuotaExceeded, ReadOnlyFilesystem].contains(&e.kind()));
    unwritable || error.kind() == Kind::Interrupted
}

fn make(folder: &Path, scene: &PlannedScene, cell: &Cell, observer: &dyn Observer) -> Result<Row> {
    let yardstick = scene.yardstick(observer)?;
    let video = folder.join(format!("{}.mp4", cell.stem));
    let empty = cell.empty();
    let fps = Some(scene.fps());
    let address = |end: &str| Some(format!("{}/{}{end}", scene.name, cell.stem));
    let row = match cell.sort {
        Sort::Frozen => baselines::frozen(empty, scene, &video, observer)?,
        Sort::Real => baselines::real(empty, scene, &video, observer)?,
        Sort::Shuffled => {
            baselines::shuffled(cell, folder, &video, observer)?;
            measured(empty, &Request { fps, ..Request::new(&video) }, yardstick, observer)?
        }
        Sort::Method => {
            let report = folder.join(&cell.stem);
            let record = animate(cell.file.clone(), &video, Some(&report), observer)?;
            let motion = address("/motion.png").filter(|_| report.join("motion.png").exists());
            let row = Row { seconds: Some(record.seconds), page: address("/index.html"), motion, ..empty };
            measured(row, &Request { record: Some(&record), fps, ..Request::new(&video) }, yardstick, observer)?
        }
    };
    Ok(Row { video: address(".mp4"), ..row })
}

/// A row with its figures: those that `enliven measure` prints, and those over time.
fn measured(row: Row, request: &Request, yardstick: &Yardstick, observer: &dyn Observer) -> Result<Row> {
    let measuring = Measuring::read(request, yardstick, observer)?;
    figures(row, &measuring, request.video, yardstick, observer)
}

#[cfg(test)]
mod tests {
    use std::io::{Error as Cause, ErrorKind};

    use super::*;

    #[test]
    fn a_full_disk_ends_all_and_a_missing_file_only_a_row() {
        let error = |kind: ErrorKind| Error::io(Path::new("a"), "write", Cause::from(kind));
        assert!(ends_all(&error(ErrorKind::StorageFull)) && ends_all(&error(ErrorKind::ReadOnlyFilesystem)));
        assert!(ends_all(&Error::interrupted()));
        assert!(!ends_all(&error(ErrorKind::NotFound)) && !ends_all(&Error::new(Kind::Limit, "memory", "too little")));
    }
}
