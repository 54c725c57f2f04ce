//! Builds a library from clips: analyse each, learn the vocabulary, write the pack.
//!
//! A build can be cut off anywhere. What is finished of it lies in the folder `L.pack.build` and is used by the next
//! one; under the final name there is nothing, or the whole pack.

use std::io::BufWriter;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::analyse_clip::{self, Analysed};
use super::assemble::{Tables, assemble};
use super::estimate::Estimate;
use super::features;
use super::inputs;
use super::names::Names;
use super::options::Options;
use super::piece::ClipId;
use super::reader::Pack;
use super::scan::reason;
use super::segment::Segment;
use super::workshop::Workshop;
use crate::base::atomic_file::AtomicFile;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};

/// An accepted clip of a build.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Accepted {
    /// Where it was read.
    pub path: PathBuf,
    /// Start of its identity.
    pub id: String,
    /// Width in working pixels.
    pub width: u32,
    /// Height in working pixels.
    pub height: u32,
    /// Frames at the library rate.
    pub frames: u32,
    /// Pieces kept.
    pub pieces: u64,
    /// Places dropped because too little moves there.
    pub still: u64,
    /// What was noticed (black bars, duplicate frames…).
    pub notes: Vec<String>,
    /// Taken from an interrupted build.
    pub resumed: bool,
}

/// A clip that was left out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Refused {
    /// Where it was read.
    pub path: PathBuf,
    /// Why.
    pub reason: String,
}

/// What a build did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BuildReport {
    /// Clips in the pack, in its order.
    pub accepted: Vec<Accepted>,
    /// Clips left out, in the order given.
    pub refused: Vec<Refused>,
    /// Clips given more than once.
    pub duplicates: Vec<PathBuf>,
    /// Pieces in the pack.
    pub pieces: u64,
    /// Visual words learnt.
    pub words: u32,
    /// Bytes of the pack.
    pub bytes: u64,
    /// Seconds: reading and analysing, features, writing.
    pub seconds: [f64; 3],
}

/// Builds the pack `output` from `clips` (files, or folders of them). Clips that cannot be used are refused by name, and
/// the build goes on. The names of their files go into a sidecar ([`Names`]). Stages: "clips" (in clips), "analyse" and "decode" (in frames of one clip), "features", "words",
/// "write" (in bytes), "sync" and "rename".
///
/// # Errors
/// When no clip can be used, another build works on the same output, the disk is too small or fails, or the run was
/// cancelled. Nothing is left under the final name then; what was finished serves the next run.
pub fn build(clips: &[PathBuf], output: &Path, options: &Options, observer: &dyn Observer) -> Result<BuildReport> {
    options.check()?;
    let files = inputs::expand(clips)?;
    let workshop = Workshop::open(output)?;
    Estimate::of(&files, options).tell(output, observer)?;
    let mut report = BuildReport {
        accepted: Vec::new(),
        refused: Vec::new(),
        duplicates: Vec::new(),
        pieces: 0,
        words: 0,
        bytes: 0,
        seconds: [0.0; 3],
    };
    let clips = timed(&mut report.seconds[0], || analyse_all(&files, &workshop, options, observer));
    let clips = clips.map_err(|error| match error.kind() {
        Kind::Interrupted => error.remedy("run the same command again to go on"),
        _ => error,
    })?;
    if clips.none_used() {
        let error = clips.none_can_be_used();
        workshop.remove()?;
        return Err(error);
    }
    let (sources, segments) = clips.sort_out(&mut report);
    if !options.replace {
        nothing_lost(output, &segments)?;
    }
    let tables = timed(&mut report.seconds[1], || features::compute(&segments, options, observer))?;
    report.bytes = timed(&mut report.seconds[2], || write(output, &tables, &segments, observer))?;
    let files = tables.metadata.clips.iter().zip(&sources).map(|(clip, (path, _))| (clip.id, path.as_path()));
    if let Err(error) = Names::of_files(files).write(output) {
        observer.note(&format!("{error}; reports will name the clips by their hashes"));
    }
    report.complete(sources, &segments, &tables);
    drop(segments);
    workshop.remove()?;
    Ok(report)
}

/// Refuses to replace a pack that holds clips which the new one lacks.
fn nothing_lost(output: &Path, segments: &[Segment]) -> Result<()> {
    // What is no sound pack has no clips to lose; that it is a pack at all was checked before.
    let Ok(old) = Pack::open(output) else { return Ok(()) };
    let lost = old.clips().iter().filter(|clip| segments.iter().all(|s| s.meta.id != clip.id)).count();
    if lost == 0 {
        return Ok(());
    }
    let problem =
        format!("this library holds {lost} of its {} clips that are not among those given", old.clips().len());
    Err(Error::file(Kind::Unusable, output, problem)
        .remedy("give all its clips again, write to another name, or say --replace; what was analysed is kept"))
}

fn timed<T>(seconds: &mut f64, work: impl FnOnce() -> Result<T>) -> Result<T> {
    let start = std::time::Instant::now();
    let result = work();
    *seconds = start.elapsed().as_secs_f64();
    result
}

/// What became of each clip given; used ones may come from an interrupted build.
enum Outcome {
    Used(Box<Segment>, bool),
    Refused(String),
    Duplicate,
}

/// Outcomes in the order given.
struct Outcomes(Vec<(PathBuf, Outcome)>);

/// Where the clips of the pack came from, in its order: path, resumed.
type Sources = Vec<(PathBuf, bool)>;

impl Outcomes {
    /// Notes refusals and duplicates in the report; gives the clips to use, ordered by content.
    fn sort_out(self, report: &mut BuildReport) -> (Sources, Vec<Segment>) {
        let mut used = Vec::new();
        for (path, outcome) in self.0 {
            match outcome {
                Outcome::Used(segment, resumed) => used.push((path, resumed, *segment)),
                Outcome::Refused(reason) => report.refused.push(Refused { path, reason }),
                Outcome::Duplicate => report.duplicates.push(path),
            }
        }
        used.sort_by_key(|(_, _, segment)| segment.meta.id);
        used.into_iter().map(|(path, resumed, segment)| ((path, resumed), segment)).unzip()
    }

    fn none_used(&self) -> bool {
        !self.0.iter().any(|(_, outcome)| matches!(outcome, Outcome::Used(..)))
    }

    /// The error when no clip can be used: of one clip with its reason, of several with the first one's.
    fn none_can_be_used(&self) -> Error {
        let reason = |(path, outcome): &(PathBuf, Outcome)| match outcome {
            Outcome::Refused(reason) => Some((path.clone(), reason.clone())),
            _ => None,
        };
        let refused: Vec<(PathBuf, String)> = self.0.iter().filter_map(reason).collect();
        match &refused[..] {
            [(path, reason)] => Error::file(Kind::Unusable, path, reason.clone()),
            [(path, reason), ..] => {
                let problem = format!("none of {} can be used; {}: {reason}", refused.len(), path.display());
                Error::new(Kind::Unusable, "clips", problem).remedy("`enliven-db scan` tells about each of the clips")
            }
            [] => Error::new(Kind::Unusable, "clips", "none given"),
        }
    }
}

/// One clip after the other: found finished, or analysed and kept.
fn analyse_all(files: &[PathBuf], workshop: &Workshop, options: &Options, observer: &dyn Observer) -> Result<Outcomes> {
    observe::stage(observer, "clips", files.len() as u64, || {
        let mut seen: Vec<ClipId> = Vec::new();
        let mut outcomes = Vec::new();
        for path in files {
            observe::check(observer)?;
            let outcome = one_clip(path, &mut seen, workshop, options, observer)?;
            if let (Outcome::Refused(reason), true) = (&outcome, files.len() > 1) {
                observer.note(&format!("{} is left out: {reason}", path.display()));
            }
            outcomes.push((path.clone(), outcome));
            observer.advance("clips", 1);
        }
        Ok(Outcomes(outcomes))
    })
}

fn one_clip(
    path: &Path,
    seen: &mut Vec<ClipId>,
    workshop: &Workshop,
    options: &Options,
    observer: &dyn Observer,
) -> Result<Outcome> {
    let identified = inputs::identify(path).and_then(|id| {
        let mask = inputs::mask_of(path);
        let hash = mask.as_deref().map(inputs::hash_file).transpose()?;
        Ok((id, mask, hash))
    });
    let (id, mask, mask_hash) = match identified {
        Ok(found) => found,
        Err(error) => return Ok(Outcome::Refused(reason(&error))),
    };
    if seen.contains(&id) {
        observer.note(&format!("{} is the same clip as one before; it is used once", path.display()));
        return Ok(Outcome::Duplicate);
    }
    seen.push(id);
    let target = workshop.segment_path(id, mask_hash, &options.parameters());
    if let Some(segment) = workshop.finished(&target, observer) {
        return Ok(from_segment(segment, true));
    }
    match analyse_clip::run(path, id, mask.as_deref(), &target, options, observer) {
        Ok(Analysed::Segment) => Ok(from_segment(Segment::open(&target)?, false)),
        Ok(Analysed::Refused(reason)) => Ok(Outcome::Refused(reason)),
        Err(error) if is_ours(&error, workshop) => Err(error),
        Err(error) => Ok(Outcome::Refused(reason(&error))),
    }
}

fn from_segment(segment: Segment, resumed: bool) -> Outcome {
    match &segment.meta.refusal {
        Some(reason) => Outcome::Refused(reason.clone()),
        None => Outcome::Used(Box::new(segment), resumed),
    }
}

/// True for failures of the build itself, rather than of a clip.
fn is_ours(error: &Error, workshop: &Workshop) -> bool {
    matches!(error.kind(), Kind::Interrupted | Kind::Limit) || workshop.concerns(error)
}

/// Writes the pack whole or not at all; gives its length.
fn write(output: &Path, tables: &Tables, segments: &[Segment], observer: &dyn Observer) -> Result<u64> {
    let file = AtomicFile::create(output)?;
    let total = segments.iter().map(Segment::blob_bytes).sum();
    let file = observe::stage(observer, "write", total, || {
        let buffered = assemble(BufWriter::with_capacity(1 << 20, file), output, tables, segments, observer)?;
        buffered.into_inner().map_err(|e| Error::io(output, "write", e.into_error()))
    })?;
    let bytes = file.file().metadata().map_err(|e| Error::io(output, "read", e))?.len();
    observe::stage(observer, "sync", 1, || file.sync())?;
    observe::check(observer)?;
    observe::stage(observer, "rename", 1, || file.commit())?;
    Ok(bytes)
}

impl BuildReport {
    /// Fills in what is known once the pack is written.
    fn complete(&mut self, sources: Sources, segments: &[Segment], tables: &Tables) {
        for (((path, resumed), segment), clip) in sources.into_iter().zip(segments).zip(&tables.metadata.clips) {
            self.accepted.push(Accepted {
                path,
                id: clip.id.to_string(),
                width: clip.width,
                height: clip.height,
                frames: clip.frames,
                pieces: clip.pieces(),
                still: clip.counts.iter().map(|c| u64::from(c.still)).sum(),
                notes: segment.meta.notes.clone(),
                resumed,
            });
        }
        self.pieces = tables.pieces.len() as u64;
        self.words = tables.parameters.words;
    }
}
