//! Pictures and clips with opacity from files.

use std::path::Path;

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::base::text::megabytes;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::picture_io::{Picture, read_grey, read_picture};
use crate::raster::premultiplied::Premultiplied;
use crate::raster::resample;
use crate::scene::file::LUMINANCE;
use crate::video::clip::{Pixels, RawFrame, Source};
use crate::video::conform::scale::to_rgb8;
use crate::video::conform::turned;
use crate::video::read::source;

/// Brightness below which footage on black is taken for its noise, in [0, 1].
const DARK: f32 = 0.03;
/// Brightness from which it is opaque: flames are bright long before they are white.
const BRIGHT: f32 = 0.5;
/// Frames from whose times the rate of a clip is told.
const TIMED: usize = 12;
/// How much faster or slower than filmed a clip may play without a note.
const SAME_SPEED: f64 = 0.05;

/// How a file is read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Longest side of a clip's frames, pixels; they are never enlarged.
    pub long_side: usize,
    /// That of a picture.
    pub picture_side: usize,
    /// Most frames of a clip that are read.
    pub limit: usize,
    /// Frames per second at which they are played.
    pub fps: f32,
    /// Frames that a clip needs besides.
    pub fade: usize,
    /// Bytes that all frames may take; none: any.
    pub room: Option<u64>,
}

/// What a file holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Frames {
    /// A picture.
    Still(Premultiplied),
    /// Frames of a clip, two at least.
    Clip(Vec<Packed>),
}

/// A frame as bytes: red, green and blue times alpha, and alpha.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packed {
    width: usize,
    height: usize,
    /// The pixels, row by row.
    pub data: Vec<[u8; 4]>,
}

impl Packed {
    fn new(frame: &Premultiplied) -> Self {
        let (width, height) = frame.size();
        let byte = |i: usize| frame.planes.each_ref().map(|p| (p.data[i].clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
        Self { width, height, data: (0..width * height).map(byte).collect() }
    }

    /// As planes.
    pub fn unpacked(&self) -> Premultiplied {
        let plane = |c: usize| self.data.iter().map(|p| f32::from(p[c]) / 255.0).collect();
        Premultiplied { planes: std::array::from_fn(|c| Plane::from_vec(self.width, self.height, plane(c))) }
    }

    /// Luma over black.
    pub fn luma(&self) -> Plane {
        let data = self.data.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
        Rgb8 { width: self.width, height: self.height, data }.luma()
    }

    /// Memory it takes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.data[..])
    }

    /// How much fluid it has, in opaque pixels.
    pub fn fluid(&self) -> f64 {
        self.data.iter().map(|p| f64::from(p[3]) / 255.0).sum()
    }
}

impl Frames {
    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Still(frame) => frame.size(),
            Self::Clip(frames) => (frames[0].width, frames[0].height),
        }
    }

    /// With a long side of at most `long_side` pixels.
    pub fn shrunk(self, long_side: usize) -> Self {
        if self.size().0.max(self.size().1) <= long_side {
            return self;
        }
        match self {
            Self::Still(frame) => Self::Still(shrunk(frame, long_side)),
            Self::Clip(frames) => {
                Self::Clip(par::map(frames.len(), |i| Packed::new(&shrunk(frames[i].unpacked(), long_side))))
            }
        }
    }
}

/// Reads a picture or a clip with its opacity: that of the file named `alpha`, a picture for all frames; with the word for
/// it, from its brightness; else its own.
///
/// # Errors
/// Files that cannot be read; opacity of another size; a cancel.
pub fn read(path: &Path, alpha: Option<&Path>, reading: &Reading, observer: &dyn Observer) -> Result<Frames> {
    let opacity = match alpha {
        None => Opacity::Own,
        Some(word) if word.as_os_str() == LUMINANCE => Opacity::Bright,
        Some(path) => Opacity::Painted(path, read_grey(path)?),
    };
    let mut clip = match source::open(path) {
        Ok(clip) => clip,
        // What does not move is no clip.
        Err(error) if error.kind() == Kind::Unusable && !path.is_dir() => return still(path, &opacity, reading),
        Err(error) => return Err(error),
    };
    let frames = frames(&mut *clip, path, &opacity, reading, observer)?;
    match &frames[..] {
        [] => Err(Error::file(Kind::Data, path, "the clip has no frame").remedy("check that it plays")),
        [only] => Ok(Frames::Still(only.unpacked())),
        _ => Ok(Frames::Clip(frames)),
    }
}

/// Where opacity comes from.
enum Opacity<'a> {
    Own,
    Bright,
    Painted(&'a Path, Plane),
}

impl Opacity<'_> {
    /// A frame from its colours and the alpha that it has itself; `multiplied` tells whether the former are by the latter.
    fn frame(&self, rgb: &Rgb8, own: Option<&Plane>, multiplied: bool) -> Result<Premultiplied> {
        let colour = rgb.to_color();
        Ok(match self {
            Self::Own => match own {
                Some(alpha) if multiplied => {
                    let [red, green, blue] = colour.planes;
                    Premultiplied::from_planes([red, green, blue, alpha.clone()])
                }
                Some(alpha) => Premultiplied::new(&colour, alpha),
                None => Premultiplied::new(&colour, &Plane::filled(rgb.width, rgb.height, 1.0)),
            },
            Self::Bright => on_black(rgb),
            Self::Painted(path, plane) => {
                if (plane.width, plane.height) != (rgb.width, rgb.height) {
                    let (found, size) = ((plane.width, plane.height), (rgb.width, rgb.height));
                    let problem = format!("is {} × {} pixels, the exemplar {} × {}", found.0, found.1, size.0, size.1);
                    return Err(Error::file(Kind::Unusable, path, problem).remedy("make it the exemplar's size"));
                }
                Premultiplied::new(&colour, plane)
            }
        })
    }
}

fn still(path: &Path, opacity: &Opacity, reading: &Reading) -> Result<Frames> {
    let Picture { rgb, alpha } = read_picture(path)?;
    let alpha = alpha.map(|a| plane_of(&a, rgb.width));
    Ok(Frames::Still(shrunk(opacity.frame(&rgb, alpha.as_ref(), false)?, reading.picture_side)))
}

/// The frames of a clip, all of them or evenly one in several, so that they play about as fast as filmed.
fn frames(
    clip: &mut dyn Source,
    path: &Path,
    opacity: &Opacity,
    reading: &Reading,
    observer: &dyn Observer,
) -> Result<Vec<Packed>> {
    let turn = clip.info().turn;
    let mut first = Vec::new();
    while first.len() < TIMED {
        match clip.next_frame()? {
            Some(frame) => first.push(frame),
            None => break,
        }
    }
    let every = every(&first, reading.fps, path, observer);
    let mut rest = first.into_iter();
    let (mut frames, mut number): (Vec<Packed>, usize) = (Vec::new(), 0);
    while frames.len() < reading.limit + reading.fade {
        observe::check(observer)?;
        let Some(frame) = rest.next().map_or_else(|| clip.next_frame(), |frame| Ok(Some(frame)))? else { break };
        number += 1;
        if !usize::is_multiple_of(number - 1, every) {
            continue;
        }
        let own = match &frame.pixels {
            Pixels::Rgba(pixels) if pixels.chunks_exact(4).any(|p| p[3] < 255) => {
                Some(Plane::from_vec(frame.width, frame.height, pixels.iter().skip(3).step_by(4).map(unit).collect()))
            }
            _ => None,
        };
        // The only frames with opacity are of animations, which have no turn.
        let rgb = if own.is_some() { to_rgb8(&frame) } else { turned(to_rgb8(&frame), turn) };
        frames.push(Packed::new(&shrunk(opacity.frame(&rgb, own.as_ref(), true)?, reading.long_side)));
        let taken = (frames.len() * frames[0].bytes()) as u64;
        if let Some(room) = reading.room.filter(|&room| taken > room) {
            return Err(no_room(path, room));
        }
    }
    Ok(frames)
}

fn no_room(path: &Path, room: u64) -> Error {
    let problem = format!("its frames do not fit into the {} that are left of --max-memory", megabytes(room));
    Error::file(Kind::Limit, path, problem).remedy("allow more, or name a shorter or smaller clip")
}

/// One frame in how many is kept.
fn every(first: &[RawFrame], fps: f32, path: &Path, observer: &dyn Observer) -> usize {
    let span = first.last().map_or(0, |last| last.time_ns - first[0].time_ns);
    if span == 0 {
        return 1;
    }
    let rate = (first.len() - 1) as f64 * 1e9 / span as f64 / f64::from(fps);
    let every = rate.round().max(1.0);
    let speed = every / rate;
    if (speed - 1.0).abs() > SAME_SPEED {
        observer
            .note(&format!("{}: plays {speed:.2} times as fast as filmed, at {fps} frames a second", path.display()));
    }
    every as usize
}

fn unit(byte: &u8) -> f32 {
    f32::from(*byte) / 255.0
}

fn plane_of(bytes: &[u8], width: usize) -> Plane {
    Plane::from_vec(width, bytes.len() / width.max(1), bytes.iter().map(unit).collect())
}

/// With a long side of at most `long_side` pixels.
pub fn shrunk(frame: Premultiplied, long_side: usize) -> Premultiplied {
    let (width, height) = resample::shrunk(frame.size(), long_side);
    if (width, height) == frame.size() { frame } else { frame.resized(width, height) }
}

/// Footage on black: opaque where its brightest channel is bright. What the camera saw is colour times opacity already.
fn on_black(rgb: &Rgb8) -> Premultiplied {
    let [red, green, blue] = rgb.to_color().planes;
    let brightest = |i: usize| red.data[i].max(green.data[i]).max(blue.data[i]);
    let alpha = (0..red.data.len()).map(|i| ((brightest(i) - DARK) / (BRIGHT - DARK)).clamp(0.0, 1.0));
    let alpha = Plane::from_vec(red.width, red.height, alpha.collect());
    Premultiplied::from_planes([red, green, blue, alpha])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::observe::Silent;
    use crate::raster::picture_io::write_png;

    #[test]
    fn a_clip_is_read_as_far_as_memory_goes() {
        let folder = tempfile::tempdir().unwrap();
        for t in 0..6u8 {
            let frame = Rgb8 { width: 20, height: 10, data: vec![40 * t; 600] };
            write_png(&folder.path().join(format!("{t}.png")), &frame).unwrap();
        }
        let reading =
            Reading { long_side: 10, picture_side: 20, limit: 4, fps: 25.0, fade: 1, room: Some(5 * 10 * 5 * 4) };
        let Frames::Clip(frames) = read(folder.path(), None, &reading, &Silent).unwrap() else { panic!("a picture") };
        assert_eq!((frames.len(), frames[0].width, frames[0].bytes()), (5, 10, 200));
        let error = read(folder.path(), None, &Reading { room: Some(999), ..reading }, &Silent).unwrap_err();
        assert!(error.kind() == Kind::Limit && error.to_string().contains("--max-memory"), "{error}");
    }
}
