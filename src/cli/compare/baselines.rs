//! The rows that give meaning to the numbers, and to votes: the picture held still, the real clip, shuffled frames.

use std::path::Path;

use super::figures::{figures, sliced, values};
use super::plan::{Cell, PlannedScene};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::{par, rng};
use crate::measure::footage::LONG_SIDE;
use crate::measure::over_time::over_time;
use crate::measure::read;
use crate::measure::{Footage, Subject, all};
use crate::raster::image::Rgb8;
use crate::raster::resample::{resize_rgb8, shrunk};
use crate::report::comparison::Row;
use crate::report::measuring::Measuring;
use crate::scene::scene::Scene;
use crate::video::write::options::{FrameRate, SinkOptions};
use crate::video::write::sink;

/// Writes the picture as a video in which nothing moves, and measures it as it was before coding: quite still.
///
/// # Errors
/// A scene that cannot be read, a place that cannot be written to, a cancel.
pub fn frozen(row: Row, scene: &PlannedScene, video: &Path, observer: &dyn Observer) -> Result<Row> {
    let (yardstick, fps, length) = (scene.yardstick(observer)?, scene.fps(), scene.frames());
    let Some(still) = yardstick.still() else { return Ok(row) };
    write(video, std::iter::repeat_n(&still.picture, length), fps, observer)?;
    let (width, height) = measured_size(still.map.output);
    let frames = vec![resize_rgb8(&still.picture, width, height); length];
    let footage = Footage::new(frames, fps, true, yardstick.matte())?;
    let measuring = Measuring::of(footage, still.map.output, None, yardstick, observer)?;
    figures(row, &measuring, video, yardstick, observer)
}

/// What the videos of a scene are measured at: MP4 holds even sizes only.
fn measured_size((width, height): (usize, usize)) -> (usize, usize) {
    shrunk((width.next_multiple_of(2), height.next_multiple_of(2)), LONG_SIDE)
}

/// Writes the frames of the row that `cell` shuffles, whose video is in `folder`, in an order by chance, each once.
///
/// # Errors
/// A row that was not made; a place that cannot be written to; a cancel.
pub fn shuffled(cell: &Cell, folder: &Path, video: &Path, observer: &dyn Observer) -> Result<()> {
    let Some(row) = &cell.shuffles else { return Ok(()) };
    let from = folder.join(format!("{}.mp4", row.stem));
    if !from.exists() {
        return Err(Error::new(
            Kind::Unusable,
            "--plant shuffled",
            format!("{} was not made, so there is nothing to shuffle", row.name),
        )
        .remedy("name another method first in --methods"));
    }
    let output = Scene::new(cell.file.clone())?.settings().output;
    let frames = read::video(&from, usize::MAX, None, observer)?.frames;
    let order = rng::shuffled(output.seed, frames.len());
    write(video, order.iter().map(|&i| &frames[i]), output.fps, observer)
}

fn write<'a>(video: &Path, frames: impl Iterator<Item = &'a Rgb8>, fps: f32, observer: &dyn Observer) -> Result<()> {
    let mut frames = frames.peekable();
    let Some(&first) = frames.peek() else { return Ok(()) };
    let rate = FrameRate::new(f64::from(fps))?;
    let options = SinkOptions { width: first.width, height: first.height, rate, loops: true, alpha: false };
    let mut sink = sink::create(video, options)?;
    for frame in frames {
        observe::check(observer)?;
        sink.push(frame)?;
    }
    sink.finish()
}

/// Writes the real clip, as many frames as the others have where it is long enough, and measures its second half against
/// its first: what no method can be expected to beat. A clip too short for that is shown only.
///
/// # Errors
/// A clip that cannot be read; a cancel.
pub fn real(row: Row, scene: &PlannedScene, video: &Path, observer: &dyn Observer) -> Result<Row> {
    let (yardstick, fps, length) = (scene.yardstick(observer)?, scene.fps(), scene.frames());
    let Some(still) = yardstick.still() else { return Ok(row) };
    let (width, height) = still.map.output;
    // As the other videos are measured, so that the clip is read once.
    let fitted = yardstick.fitted(measured_size((width, height)), fps, observer)?;
    let Some((path, clip)) = &fitted.reference else { return Ok(row) };
    let frames = clip.frames();
    // The scene's size and matte are right for a clip of the same camera only.
    let same = frames[0].width * height == frames[0].height * width;
    let (w, h) = if same { (width, height) } else { (frames[0].width, frames[0].height) };
    let shown: Vec<Rgb8> = frames.iter().take(length).map(|frame| resize_rgb8(frame, w, h)).collect();
    // As long as two turns of a loop.
    let line = sliced(clip, &frames[..frames.len().min(2 * length)], video, yardstick)?;
    let half = frames.len() / 2;
    if half < read::MIN_REFERENCE {
        let (clip, least) = (path.display(), 2 * read::MIN_REFERENCE);
        observer.note(&format!(
            "{clip}: {} frames at {fps} a second are shown, but too few to measure one half against the other: {least} are needed",
            frames.len()
        ));
        write(video, shown.iter(), fps, observer)?;
        return Ok(Row { line: Some(line), ..row });
    }
    let matte = same.then_some(&still.matte);
    let (first, second) = frames.split_at(half);
    let footage = Footage::new(second[..half].to_vec(), fps, false, matte)?;
    let reference = Footage::new(first.to_vec(), fps, false, matte)?;
    let subject = Subject { reference: Some(&reference), ..Subject::new(&footage) };
    // One core writes while others measure.
    let (written, (values, series)) =
        par::join(|| write(video, shown.iter(), fps, observer), || (values(&all(&subject)), over_time(&subject)));
    written?;
    Ok(Row { values, series, line: Some(line), ..row })
}
