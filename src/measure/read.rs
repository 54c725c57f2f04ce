//! Videos from files, as they are measured.

use std::path::Path;

use super::footage::shrunk;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::raster::image::Rgb8;
use crate::raster::resample::resize_rgb8;
use crate::video::conform::{ConformOptions, Conformed};
use crate::video::scale::to_rgb8;
use crate::video::source;

/// Fewest frames of a video that is measured: one more than a space-time patch is long.
pub const MIN_FRAMES: usize = 8;
/// Most frames of a video that is measured: two minutes.
pub const MAX_FRAMES: usize = 3000;
/// Fewest frames of a reference: a window of the temporal spectrum.
pub const MIN_REFERENCE: usize = 32;
/// Frames of a reference that are used, its first: half a minute.
pub const MAX_REFERENCE: usize = 750;
/// How much faster or slower than filmed a reference may play without a note (24 frames a second play as 25).
const SAME_SPEED: f64 = 0.05;

/// Frames as they were read.
#[derive(Debug, Clone, PartialEq)]
pub struct Video {
    /// The frames, shrunk to the long side asked for.
    pub frames: Vec<Rgb8>,
    /// Their width and height in the file.
    pub size: (usize, usize),
    /// Frames per second, by the median time between them.
    pub fps: f32,
}

/// Every frame of a video as it is in the file, shrunk to a long side of at most `long_side` pixels.
///
/// # Errors
/// A file that cannot be read to its end; fewer than [`MIN_FRAMES`] or more than [`MAX_FRAMES`] frames; a cancel.
pub fn video(path: &Path, long_side: usize, observer: &dyn Observer) -> Result<Video> {
    let mut source = source::open(path)?;
    let (mut frames, mut times) = (Vec::new(), Vec::new());
    let mut size = (0, 0);
    while let Some(frame) = source.next_frame()? {
        observe::check(observer)?;
        if frames.len() == MAX_FRAMES {
            return Err(Error::file(Kind::Limit, path, format!("it has more than {MAX_FRAMES} frames"))
                .remedy("cut a part of it to measure"));
        }
        size = (frame.width, frame.height);
        let (width, height) = shrunk(size, long_side);
        frames.push(resize_rgb8(&to_rgb8(&frame), width, height));
        times.push(frame.time_ns);
    }
    if frames.len() < MIN_FRAMES {
        return Err(Error::file(Kind::Unusable, path, format!("{} are too few frames to measure", frames.len()))
            .allowed(format!("at least {MIN_FRAMES}"))
            .remedy("make a longer video"));
    }
    let mut gaps: Vec<u64> = times.windows(2).map(|t| t[1].saturating_sub(t[0])).collect();
    gaps.sort_unstable();
    let gap = gaps[gaps.len() / 2].max(1);
    Ok(Video { frames, size, fps: (1e9 / gap as f64) as f32 })
}

/// The first frames of a real clip, to be played at `fps` frames per second, and brought to a long side of at most
/// `long_side` pixels, as a clip of a library is: one frame in n, evenly, no bars, no duplicates, sides that are
/// multiples of 16. At the library's rate it is then just what an animation of this clip shows.
///
/// # Errors
/// A file that cannot be read, fewer than [`MIN_REFERENCE`] frames, a cancel.
pub fn reference(path: &Path, fps: f32, long_side: usize, observer: &dyn Observer) -> Result<Vec<Rgb8>> {
    let options = ConformOptions { rate: f64::from(fps), long_side, ..ConformOptions::default() };
    let mut clip = Conformed::open(path, &options)?;
    let mut frames = Vec::new();
    while let Some(frame) = clip.next_frame()? {
        observe::check(observer)?;
        if frames.len() == MAX_REFERENCE {
            observer.note(&format!("{}: only its first {MAX_REFERENCE} frames are measured", path.display()));
            break;
        }
        frames.push(frame);
    }
    if frames.len() < MIN_REFERENCE {
        let problem = format!("{} frames at {fps} a second are too few for a reference", frames.len());
        return Err(Error::file(Kind::Unusable, path, problem)
            .allowed(format!("at least {MIN_REFERENCE}"))
            .remedy("name a longer clip"));
    }
    let speed = clip.report().speed;
    if (speed - 1.0).abs() > SAME_SPEED {
        observer
            .note(&format!("{}: plays {speed:.2} times as fast as filmed, at {fps} frames a second", path.display()));
    }
    Ok(frames)
}
