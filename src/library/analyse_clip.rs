//! One clip of a build: read, judged, analysed and kept as a segment, in one streamed pass.

use std::io::BufWriter;
use std::ops::Range;
use std::path::Path;

use super::analyse::analyse;
use super::options::{Options, RATE};
use super::piece::ClipId;
use super::scan::{Judged, conform_options, judge};
use super::segment::{SegmentMeta, SegmentWriter, write_refusal};
use crate::base::atomic_file::AtomicFile;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::raster::image::Plane;
use crate::raster::{picture_io, resample};
use crate::video::clip::Turn;
use crate::video::conform::{ConformReport, Conformed};

/// What became of a clip.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Analysed {
    /// Its segment lies at its place.
    Segment,
    /// It cannot serve, for this reason; a segment says so to the next run.
    Refused(String),
}

/// Name of the stage in which a clip is judged.
pub const JUDGE: &str = "judge";
/// Name of the stage of frames read and compressed; one step is a frame.
pub const DECODE: &str = "decode";

/// Judges and analyses the clip at `path` and writes its segment to `target`. `mask` excludes other moving objects
/// (white = use). A clip with a fault that leaves a long enough stretch is used in that stretch, with a note.
///
/// The clip is read twice: judging costs little beside the analysis, which a clip that cannot serve is spared.
///
/// # Errors
/// When the clip or the mask cannot be read, the segment cannot be written, or the run was cancelled.
pub fn run(
    path: &Path,
    id: ClipId,
    mask: Option<&Path>,
    target: &Path,
    options: &Options,
    observer: &dyn Observer,
) -> Result<Analysed> {
    let Judged { conform, report: judgement } = observe::stage(observer, JUDGE, 0, || judge(path, options, observer))?;
    let size = conform.working;
    let mask = mask.map(|mask| read_mask(mask, &conform)).transpose()?;
    let mut meta = SegmentMeta { id, width: 0, height: 0, frames: 0, refusal: None, notes: notes(&conform) };
    let faults = judgement.reasons.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
    let Some(range) = judgement.usable else {
        return refuse(faults, meta, target, options);
    };
    if !faults.is_empty() {
        meta.notes.push(format!("only frames {} to {} are used: {faults}", range.start, range.end));
    }
    let clip = Conformed::open(path, &conform_options(options))?;
    (meta.width, meta.height) = (size.0 as u32, size.1 as u32);
    match keep(clip, range, mask.as_ref(), meta.clone(), target, options, observer) {
        // The frames are sound, but they cannot serve.
        Err(error) if error.kind() == Kind::Unusable => refuse(error.to_string(), meta, target, options),
        other => other.map(|()| Analysed::Segment),
    }
}

/// Analyses a stretch of a clip and writes its segment.
fn keep(
    mut clip: Conformed,
    range: Range<usize>,
    mask: Option<&Plane>,
    mut meta: SegmentMeta,
    target: &Path,
    options: &Options,
    observer: &dyn Observer,
) -> Result<()> {
    let size = clip.report().working;
    let file = BufWriter::with_capacity(1 << 20, AtomicFile::create(target)?);
    let mut writer = SegmentWriter::new(file, target, options.parameters(), size.0)?;
    let mut number = 0;
    let mut frames = || {
        while number < range.start && clip.next_frame()?.is_some() {
            number += 1;
        }
        number += 1;
        if number > range.end { Ok(None) } else { clip.next_frame() }
    };
    let analysis = observe::stage(observer, DECODE, range.len() as u64, || {
        analyse(&mut frames, size, mask, observer, &mut |frame| {
            writer.push(frame)?;
            observer.advance(DECODE, 1);
            Ok(())
        })
    })?;
    meta.frames = writer.frames() as u32;
    commit(writer.finish(&meta, &analysis.average.planes, &analysis.grids)?, target)
}

/// Keeps the reason why a clip cannot serve, so that the next run need not look again.
fn refuse(reason: String, meta: SegmentMeta, target: &Path, options: &Options) -> Result<Analysed> {
    let meta = SegmentMeta { width: 0, height: 0, refusal: Some(reason.clone()), ..meta };
    let file = BufWriter::new(AtomicFile::create(target)?);
    commit(write_refusal(file, target, options.parameters(), &meta)?, target)?;
    Ok(Analysed::Refused(reason))
}

fn commit(file: BufWriter<AtomicFile>, target: &Path) -> Result<()> {
    file.into_inner().map_err(|e| Error::io(target, "write", e.into_error()))?.commit()
}

/// What was done to a clip, for people.
fn notes(report: &ConformReport) -> Vec<String> {
    let mut notes = vec![format!("{}, {:.2} frames/s, read by {}", report.codec, report.source_rate, report.decoder)];
    if let Some(crop) = report.black_bars {
        notes.push(format!("black bars cut off, {} × {} px left", crop.width, crop.height));
    }
    if report.variable_rate {
        notes.push("variable frame rate".to_owned());
    }
    if report.duplicates_removed > 0 {
        notes.push(format!("{} duplicate frames removed", report.duplicates_removed));
    }
    if report.frames_dropped > 0 {
        notes.push(format!("{} frames left out to come near {RATE} frames/s", report.frames_dropped));
    }
    if (report.speed - 1.0).abs() > 0.005 {
        notes.push(format!("plays {:.2} times as fast as filmed", report.speed));
    }
    notes
}

/// A clip's mask at working size: 1 where its motion counts.
fn read_mask(path: &Path, report: &ConformReport) -> Result<Plane> {
    let mask = picture_io::read_matte(path)?;
    let (w, h) = report.source;
    let turned_size = if matches!(report.turn, Turn::Left | Turn::Right) { (h, w) } else { (w, h) };
    if (mask.width, mask.height) != turned_size {
        let problem = format!("the mask has {} × {} pixels", mask.width, mask.height);
        let (w, h) = turned_size;
        return Err(Error::file(Kind::Unusable, path, problem)
            .allowed(format!("{w} × {h}, as its clip"))
            .remedy("save the mask in the size of the clip"));
    }
    let stored = turn(&mask, back(report.turn));
    let cropped = match report.black_bars {
        Some(crop) => Plane::from_fn(crop.width, crop.height, |x, y| stored.at(crop.x + x, crop.y + y)),
        None => stored,
    };
    let shown = turn(&cropped, report.turn);
    Ok(resample::resize(&shown, report.working.0, report.working.1).map(|v| f32::from(u8::from(v > 0.5))))
}

fn back(turn: Turn) -> Turn {
    match turn {
        Turn::Right => Turn::Left,
        Turn::Left => Turn::Right,
        same => same,
    }
}

/// A plane turned for display.
fn turn(plane: &Plane, turn: Turn) -> Plane {
    let (w, h) = (plane.width, plane.height);
    match turn {
        Turn::None => plane.clone(),
        Turn::Half => Plane::from_fn(w, h, |x, y| plane.at(w - 1 - x, h - 1 - y)),
        Turn::Right => Plane::from_fn(h, w, |x, y| plane.at(y, h - 1 - x)),
        Turn::Left => Plane::from_fn(h, w, |x, y| plane.at(w - 1 - y, x)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_and_turning_back_changes_nothing() {
        let plane = Plane::from_fn(5, 3, |x, y| (x + 10 * y) as f32);
        for way in [Turn::None, Turn::Right, Turn::Half, Turn::Left] {
            assert_eq!(turn(&turn(&plane, way), back(way)), plane, "{way:?}");
        }
        // Clockwise: the top left corner comes to the top right.
        let right = turn(&plane, Turn::Right);
        assert_eq!((right.width, right.height, right.at(2, 0)), (3, 5, 0.0));
    }
}
