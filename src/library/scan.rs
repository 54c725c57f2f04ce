//! Judging clips without analysing them: what `enliven-db scan` tells, and what a build asks first.

use std::path::{Path, PathBuf};

use super::acceptance::{self, Report};
use super::inputs;
use super::options::{Options, RATE};
use crate::base::error::{Error, Result};
use crate::base::observe::{self, Observer};
use crate::video::conform::{ConformOptions, ConformReport, Conformed};

/// Name of the stage; one step is a clip.
pub const SCAN: &str = "scan";

/// What is known of a clip after reading it once.
#[derive(Debug, Clone)]
pub struct Judged {
    /// How it was read, and what was done to bring it to the library's rate and size.
    pub conform: ConformReport,
    /// Whether it can serve, and why not.
    pub report: Report,
}

/// A clip and its judgement, or why it cannot be read.
pub type Scanned = (PathBuf, Result<Judged>);

/// How a build with these options reads its clips.
pub fn conform_options(options: &Options) -> ConformOptions {
    ConformOptions { rate: f64::from(RATE), long_side: options.working as usize, ..ConformOptions::default() }
}

/// Reads one clip and judges it.
///
/// # Errors
/// When it cannot be read, or after a cancel.
pub fn judge(path: &Path, options: &Options, observer: &dyn Observer) -> Result<Judged> {
    let mut clip = Conformed::open(path, &conform_options(options))?;
    let size = clip.report().working;
    let report = acceptance::inspect(&mut || clip.next_frame(), size, observer)?;
    let conform = clip.report().clone();
    let different = 1.0 - conform.duplicates_removed as f64 / conform.frames_read.max(1) as f64;
    Ok(Judged { report: report.at_source_rate((conform.source_rate * different) as f32), conform })
}

/// Judges every clip of `paths` (files, or folders of them) as a build with `options` would, handing each to `tell` as
/// soon as it is known.
///
/// # Errors
/// Bad options, a path that does not exist, a cancel. A clip that cannot be read is a result, not an error.
pub fn scan(
    paths: &[PathBuf],
    options: &Options,
    observer: &dyn Observer,
    tell: &mut dyn FnMut(&Scanned),
) -> Result<Vec<Scanned>> {
    options.check()?;
    let files = inputs::expand(paths)?;
    observe::stage(observer, SCAN, files.len() as u64, || {
        let mut scanned = Vec::new();
        for path in files {
            let judged = judge(&path, options, observer);
            observe::check(observer)?;
            let entry = (path, judged);
            tell(&entry);
            scanned.push(entry);
            observer.advance(SCAN, 1);
        }
        Ok(scanned)
    })
}

/// The error's words without its subject, which the reader sees already.
pub fn reason(error: &Error) -> String {
    let text = error.to_string();
    text.strip_prefix(error.subject()).and_then(|t| t.strip_prefix(": ")).map_or(text.clone(), str::to_owned)
}
