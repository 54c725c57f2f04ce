//! What a build will take, told before it starts.

use std::path::{Path, PathBuf};

use super::options::{Options, RATE};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::par;
use crate::base::text::{counted, rough_bytes, rough_duration};
use crate::video::read::source;

/// Core seconds per million working pixels and frame: reading, analysing at three scales.
const SECONDS_PER_MEGAPIXEL: f64 = 0.45;
/// Bytes of a compressed frame per pixel (3 bytes, compressed 2.8 ×).
const BYTES_PER_PIXEL: f64 = 3.0 / 2.8;
/// Frames assumed of a clip that does not say how long it is.
const FRAMES_UNKNOWN: f64 = 250.0;

/// Expected cost of a build.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// Clips that could be opened.
    pub clips: usize,
    /// Core seconds.
    pub core_seconds: f64,
    /// Bytes of the pack.
    pub bytes: f64,
}

impl Estimate {
    /// From what the files say of themselves; those that cannot be opened are left out here and named by the build.
    pub fn of(files: &[PathBuf], options: &Options) -> Self {
        files.iter().filter_map(|f| Self::of_clip(f, options)).fold(Self::default(), |sum, one| Self {
            clips: sum.clips + one.clips,
            core_seconds: sum.core_seconds + one.core_seconds,
            bytes: sum.bytes + one.bytes,
        })
    }

    fn of_clip(path: &Path, options: &Options) -> Option<Self> {
        let source = source::open(path).ok()?;
        let info = source.info();
        let seconds = info.duration_ns.map(|ns| ns as f64 * 1e-9);
        let frames = seconds.map(|s| s * f64::from(RATE)).or(info.frames.map(|n| n as f64)).unwrap_or(FRAMES_UNKNOWN);
        let (width, height) = (info.width as f64, info.height as f64);
        let shrink = (f64::from(options.working) / width.max(height)).min(1.0);
        let pixels = width * height * shrink * shrink * frames;
        Some(Self { clips: 1, core_seconds: pixels * 1e-6 * SECONDS_PER_MEGAPIXEL, bytes: pixels * BYTES_PER_PIXEL })
    }

    /// Tells the user, and refuses when the disk clearly cannot hold it.
    ///
    /// # Errors
    /// [`Kind::Limit`] when less than half of what is needed is free.
    pub fn tell(&self, output: &Path, observer: &dyn Observer) -> Result<()> {
        // The segments and the pack exist side by side for a moment.
        let disk = 2.0 * self.bytes;
        let seconds = self.core_seconds / par::threads().max(1) as f64;
        if self.clips == 0 {
            return Ok(());
        }
        observer.note(&format!(
            "{}: about {} on {}; a pack of about {}, and twice that on the disk while building",
            counted(self.clips as u64, "clip"),
            rough_duration(seconds),
            counted(par::threads() as u64, "thread"),
            rough_bytes(self.bytes)
        ));
        match free_space(output) {
            Some(free) if free < 0.5 * disk => {
                let problem = format!("about {} are needed and {} are free", rough_bytes(disk), rough_bytes(free));
                Err(Error::file(Kind::Limit, output, problem).remedy("free some space, or write to another disk"))
            }
            Some(free) if free < disk => {
                observer.note(&format!("the disk may not suffice: {} are free", rough_bytes(free)));
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

/// Bytes free for the user where `path` will lie, where the system tells.
fn free_space(path: &Path) -> Option<f64> {
    #[cfg(unix)]
    {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let info = rustix::fs::statvfs(folder).ok()?;
        Some(info.f_bavail as f64 * info.f_frsize as f64)
    }
    #[cfg(not(unix))]
    {
        let _ = path;
        None
    }
}
