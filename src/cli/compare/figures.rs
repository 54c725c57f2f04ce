//! A row's figures.

use std::collections::BTreeMap;
use std::path::Path;

use crate::base::error::Result;
use crate::base::observe::Observer;
use crate::measure::over_time::over_time;
use crate::measure::worst::worst_frames;
use crate::measure::{Footage, Value};
use crate::raster::image::Rgb8;
use crate::raster::picture_io::write_png;
use crate::report::comparison::{Row, SLICE};
use crate::report::measuring::Measuring;
use crate::report::slice::Line;
use crate::report::yardstick::Yardstick;

/// A row with the figures of what was read.
pub fn figures(
    row: Row,
    measuring: &Measuring,
    video: &Path,
    yardstick: &Yardstick,
    observer: &dyn Observer,
) -> Result<Row> {
    let values = values(&measuring.values(observer)?);
    let footage = &measuring.footage;
    let line = sliced(footage, footage.frames(), video, yardstick)?;
    let (series, subject) = (over_time(&measuring.subject()), measuring.subject());
    let worst = worst_frames(&subject, &series).into_iter().collect();
    Ok(Row { values, series, worst, line: Some(line), ..row })
}

/// Writes beside the video a slice through `frames`, a loop twice, and tells which line of them it shows.
///
/// # Errors
/// A folder that cannot be written to.
pub fn sliced(footage: &Footage, frames: &[Rgb8], video: &Path, yardstick: &Yardstick) -> Result<String> {
    let line = Line::through(footage, yardstick.direction());
    let turns = if footage.loops() { 2 } else { 1 };
    let columns = frames.iter().collect::<Vec<_>>().repeat(turns);
    write_png(&video.with_extension(SLICE), &line.slice(columns.into_iter()))?;
    Ok(line.words())
}

/// By name, without those that have no value.
pub fn values(values: &[Value]) -> BTreeMap<String, f64> {
    values.iter().filter_map(|(measure, value)| Some((measure.name.to_owned(), (*value)?))).collect()
}
