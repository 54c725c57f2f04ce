//! `enliven-db scan`: which clips are fit for a library, and why not.

use std::path::PathBuf;

use enliven::base::error::{Error, Kind, Result};
use enliven::base::observe::Observer;
use enliven::library::acceptance::{Camera, Reason};
use enliven::library::options::Options;
use enliven::library::scan::{Judged, Scanned, reason, scan};
use enliven::say;
use serde_json::json;

/// Judge clips without building: steady camera, no cut or fade, something that moves, long enough.
#[derive(clap::Args)]
pub struct Scan {
    /// Video files, or folders of them
    #[arg(required = true)]
    clips: Vec<PathBuf>,
    /// Long side that clips are brought to, in pixels
    #[arg(long, default_value_t = Options::default().working)]
    working_size: u32,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

impl Scan {
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        let options = Options { working: self.working_size, ..Options::default() };
        let mut rows = 0;
        let mut tell = |entry: &Scanned| {
            if !self.json {
                if rows == 0 {
                    say!("{:28} {:>9} {:>7} {:>15} {:>7}  verdict", "clip", "size", "frames", "camera", "moving");
                }
                rows += 1;
                print(entry);
            }
        };
        let scanned = scan(&self.clips, &options, observer, &mut tell)?;
        if self.json {
            say!("{}", scanned.iter().map(as_json).collect::<serde_json::Value>());
        }
        let fit = scanned.iter().filter(|(_, j)| j.as_ref().is_ok_and(|j| j.report.usable.is_some())).count();
        if let ([(path, judged)], 0) = (&scanned[..], fit) {
            let why = judged.as_ref().map_or_else(reason, verdict);
            return Err(Error::file(Kind::Unusable, path, why));
        }
        if fit == 0 {
            return Err(Error::new(Kind::Unusable, "clips", format!("none of {} can be used", scanned.len()))
                .remedy("film with a fixed camera, two seconds or more"));
        }
        Ok(())
    }
}

fn camera(judged: &Judged) -> String {
    match judged.report.camera {
        Camera::Measured { pixels, .. } => format!("{pixels:.1} px"),
        Camera::NotMeasurable => "not measurable".to_owned(),
    }
}

fn verdict(judged: &Judged) -> String {
    let why = judged.report.reasons.iter().map(Reason::to_string).collect::<Vec<_>>().join("; ");
    match &judged.report.usable {
        Some(_) if judged.report.accepted() => "accepted".to_owned(),
        Some(part) => format!("frames {} to {} accepted; {why}", part.start, part.end),
        None => format!("refused: {why}"),
    }
}

fn print((path, judged): &Scanned) {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    match judged {
        Ok(judged) => {
            let (width, height) = judged.conform.working;
            say!(
                "{name:28} {:>9} {:>7} {:>15} {:>6.0}%  {}",
                format!("{width}x{height}"),
                judged.report.frames,
                camera(judged),
                100.0 * judged.report.moving,
                verdict(judged)
            );
        }
        Err(error) => say!("{name:28} unreadable: {}", reason(error)),
    }
}

fn as_json((path, judged): &Scanned) -> serde_json::Value {
    match judged {
        Ok(judged) => json!({
            "clip": path, "codec": judged.conform.codec, "decoder": judged.conform.decoder,
            "working_size": [judged.conform.working.0, judged.conform.working.1], "frames": judged.report.frames,
            "duplicates_removed": judged.conform.duplicates_removed, "speed": judged.conform.speed,
            "camera_pixels": match judged.report.camera {
                Camera::Measured { pixels, .. } => Some(pixels),
                Camera::NotMeasurable => None,
            },
            "moving": judged.report.moving, "accepted": judged.report.accepted(),
            "usable": judged.report.usable.as_ref().map(|r| [r.start, r.end]),
            "reasons": judged.report.reasons.iter().map(Reason::to_string).collect::<Vec<_>>(),
        }),
        Err(error) => json!({ "clip": path, "accepted": false, "reasons": [error.to_string()] }),
    }
}
