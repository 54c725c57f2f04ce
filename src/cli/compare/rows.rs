//! Making a row: the video, its figures, and what becomes of a failure.

use std::collections::BTreeMap;
use std::path::Path;

use super::plan::{Cell, PlannedScene};
use super::{baselines, kept};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::cli::animate::animate;
use crate::measure::Value;
use crate::measure::over_time::over_time;
use crate::report::comparison::{Row, SceneRows, Sort};
use crate::report::measuring::{Measuring, Request};
use crate::report::yardstick::Yardstick;

/// Pictures of a run's folder that explain its scene.
const PICTURES: [(&str, &str); 3] = [
    ("motion.png", "Motion: red right, yellow-green down, cyan left, violet up; white is still."),
    ("exemplar.png", "What the looks are borrowed from."),
    ("asked-orientation.png", "Direction asked for."),
];

/// A row as it was made before, where nothing changed; else it is made now. What fails is told in the row.
///
/// # Errors
/// A full disk; an interruption.
pub fn row(output: &Path, scene: &PlannedScene, cell: &Cell, observer: &dyn Observer) -> Result<Row> {
    let folder = output.join(&scene.name);
    std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "make the folder", e))?;
    let called = format!("{}, {}", scene.name, cell.name);
    let empty = Row { name: cell.name.clone(), sort: cell.sort, ..Row::default() };
    let made_from = match kept::ingredients(cell) {
        Ok(made_from) => made_from,
        Err(error) => return failed(empty, &called, &error, observer),
    };
    if let Some(before) = kept::load(&folder, &cell.stem) {
        let changes = kept::changes(&before.made_from, &made_from);
        let there = folder.join(format!("{}.mp4", cell.stem)).exists();
        match (changes.is_empty(), there) {
            (true, true) => {
                observer.note(&format!("{called}: kept, nothing has changed"));
                return Ok(before);
            }
            (true, false) => observer.note(&format!("{called}: made again, its video is gone")),
            (false, _) => observer.note(&format!("{called}: made again, changed: {}", changes.join(", "))),
        }
    } else {
        observer.note(&format!("{called}:"));
    }
    match make(&folder, scene, cell, observer) {
        Ok(made) => {
            let row = Row { made_from, ..made };
            kept::save(&row, &folder, &cell.stem)?;
            Ok(row)
        }
        Err(error) => failed(empty, &called, &error, observer),
    }
}

fn failed(empty: Row, called: &str, error: &Error, observer: &dyn Observer) -> Result<Row> {
    if error.kind() == Kind::Interrupted {
        return Err(Error::interrupted());
    }
    observer.note(&format!("{called}: {error}"));
    Ok(Row { failed: Some(error.to_string()), ..empty })
}

fn make(folder: &Path, scene: &PlannedScene, cell: &Cell, observer: &dyn Observer) -> Result<Row> {
    let yardstick = scene.yardstick(observer)?;
    let video = folder.join(format!("{}.mp4", cell.stem));
    let empty = Row { name: cell.name.clone(), sort: cell.sort, ..Row::default() };
    let fps = Some(scene.fps());
    let address = |end: &str| Some(format!("{}/{}{end}", scene.name, cell.stem));
    let row = match cell.sort {
        Sort::Frozen => {
            baselines::frozen(&cell.file, &video, observer)?;
            measured(empty, &Request { loops: true, fps, ..Request::new(&video) }, yardstick, observer)?
        }
        Sort::Real => baselines::real(empty, scene.fps(), scene.frames(), &video, yardstick, observer)?,
        Sort::Method => {
            let record = animate(cell.file.clone(), &video, Some(&folder.join(&cell.stem)), observer)?;
            let row = Row { seconds: Some(record.seconds), page: address("/index.html"), ..empty };
            measured(row, &Request { record: Some(&record), fps, ..Request::new(&video) }, yardstick, observer)?
        }
    };
    Ok(Row { video: address(".mp4"), ..row })
}

/// A row with its figures: those that `enliven measure` prints, and those over time.
fn measured(row: Row, request: &Request, yardstick: &Yardstick, observer: &dyn Observer) -> Result<Row> {
    let measuring = Measuring::read(request, yardstick, observer)?;
    let values = values(&measuring.values(observer)?);
    Ok(Row { values, series: over_time(&measuring.subject()), ..row })
}

/// By name, without those that have no value.
pub fn values(values: &[Value]) -> BTreeMap<String, f64> {
    values.iter().filter_map(|(measure, value)| Some((measure.name.to_owned(), (*value)?))).collect()
}

/// The pictures of the scene, from the first run that has each.
pub fn add_pictures(scene: &mut SceneRows, output: &Path) {
    let runs: Vec<String> = scene
        .rows
        .iter()
        .filter_map(|row| row.page.as_deref()?.strip_suffix("/index.html").map(str::to_owned))
        .collect();
    let found = |&(file, caption): &(&str, &str)| {
        let address = runs.iter().map(|run| format!("{run}/{file}")).find(|address| output.join(address).exists())?;
        Some((address, caption.to_owned()))
    };
    scene.pictures = PICTURES.iter().filter_map(found).collect();
}
