//! Videos from files, as they are measured.

use std::path::Path;

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::text::counted;
use crate::raster::image::Rgb8;
use crate::raster::resample::{resize_rgb8, shrunk};
use crate::video::clip::Pixels;
use crate::video::conform::scale::to_rgb8;
use crate::video::conform::{ConformOptions, Conformed};
use crate::video::read::source;

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
    /// Frames per second, by the mean time between them; pauses of more than two frames do not count.
    pub fps: f32,
    /// Whether some pixels let the backdrop through.
    pub see_through: bool,
}

/// Every frame of a video as it is in the file, shrunk to a long side of at most `long_side` pixels. Where frames have
/// opacity, they are laid over `backdrop`, brought to their size, or else over middle grey.
///
/// # Errors
/// A file that cannot be read to its end; fewer than [`MIN_FRAMES`] or more than [`MAX_FRAMES`] frames; a cancel.
pub fn video(path: &Path, long_side: usize, backdrop: Option<&Rgb8>, observer: &dyn Observer) -> Result<Video> {
    let mut source = source::open(path)?;
    let (mut frames, mut times) = (Vec::new(), Vec::new());
    let mut size = (0, 0);
    let mut behind = None;
    while let Some(frame) = source.next_frame()? {
        observe::check(observer)?;
        if frames.len() == MAX_FRAMES {
            return Err(Error::file(Kind::Limit, path, format!("it has more than {MAX_FRAMES} frames"))
                .remedy("cut a part of it to measure"));
        }
        size = (frame.width, frame.height);
        let (width, height) = shrunk(size, long_side);
        let seen = match &frame.pixels {
            Pixels::Rgba(pixels) if pixels.chunks_exact(4).any(|p| p[3] < 255) => {
                over(pixels, behind.get_or_insert_with(|| sized(backdrop, size)))
            }
            _ => to_rgb8(&frame),
        };
        frames.push(resize_rgb8(&seen, width, height));
        times.push(frame.time_ns);
    }
    if frames.len() < MIN_FRAMES {
        return Err(Error::file(
            Kind::Unusable,
            path,
            format!("it has {}, too few to measure", counted(frames.len() as u64, "frame")),
        )
        .allowed(format!("at least {MIN_FRAMES}"))
        .remedy("make a longer video"));
    }
    Ok(Video { frames, size, fps: rate(&times), see_through: behind.is_some() })
}

/// Frames per second of frames shown at `times`, nanoseconds. Formats round times, so single gaps are not exact.
fn rate(times: &[u64]) -> f32 {
    let mut gaps: Vec<u64> = times.windows(2).map(|t| t[1].saturating_sub(t[0])).collect();
    gaps.sort_unstable();
    let usual = gaps[gaps.len() / 2];
    gaps.retain(|gap| *gap <= 2 * usual);
    (1e9 * gaps.len() as f64 / gaps.iter().sum::<u64>().max(1) as f64) as f32
}

/// What is behind frames of `size`.
fn sized(backdrop: Option<&Rgb8>, (width, height): (usize, usize)) -> Rgb8 {
    let grey = || Rgb8 { width, height, data: vec![128; width * height * 3] };
    backdrop.map_or_else(grey, |backdrop| resize_rgb8(backdrop, width, height))
}

/// Pixels with opacity, red, green, blue and alpha, over a picture of their size.
fn over(pixels: &[u8], behind: &Rgb8) -> Rgb8 {
    let mut out = behind.clone();
    for (out, pixel) in out.data.chunks_exact_mut(3).zip(pixels.chunks_exact(4)) {
        let alpha = u32::from(pixel[3]);
        let mixed = |(b, p): (u8, u8)| ((u32::from(p) * alpha + u32::from(b) * (255 - alpha) + 127) / 255) as u8;
        out.iter_mut().zip(pixel).for_each(|(o, &p)| *o = mixed((*o, p)));
    }
    out
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
        let problem =
            format!("it has {} at {fps} a second, too few for a reference", counted(frames.len() as u64, "frame"));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_right_although_times_are_rounded_and_a_frame_is_held() {
        let times = |fps: f64, unit: f64| -> Vec<u64> {
            (0..60).map(|i| ((f64::from(i) / fps / unit).round() * unit * 1e9) as u64).collect()
        };
        assert!((rate(&times(30.0, 0.01)) - 30.0).abs() < 0.1, "{}", rate(&times(30.0, 0.01)));
        let mut held = times(25.0, 0.01);
        held.iter_mut().skip(30).for_each(|t| *t += 2_000_000_000);
        assert!((rate(&held) - 25.0).abs() < 0.01, "{}", rate(&held));
        assert!(rate(&[0; 9]) > 0.0);
    }

    #[test]
    fn opacity_lets_the_backdrop_through() {
        let behind = sized(Some(&Rgb8 { width: 1, height: 1, data: vec![10, 20, 30] }), (3, 1));
        let seen = over(&[200, 200, 200, 255, 0, 0, 0, 0, 210, 220, 230, 51], &behind);
        assert_eq!(seen.data, [200, 200, 200, 10, 20, 30, 50, 60, 70]);
        assert_eq!(sized(None, (1, 1)).data, [128; 3]);
    }
}
