//! Pictures and clips with opacity from files.

use std::path::Path;

use super::opacity::{Opacity, Shot};
use super::shots::{Pair, Shots};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::base::text::megabytes;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::picture_io::read_picture;
use crate::raster::premultiplied::Premultiplied;
use crate::raster::resample;
use crate::scene::exemplar_file::ExemplarFile;

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

    /// Memory that the frames of a clip take, bytes.
    pub fn clip_bytes(&self) -> u64 {
        match self {
            Self::Still(_) => 0,
            Self::Clip(frames) => bytes(frames),
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

/// Memory that frames take, bytes.
pub fn bytes(frames: &[Packed]) -> u64 {
    frames.iter().map(|frame| frame.bytes() as u64).sum()
}

/// Reads an exemplar's picture or clip with its opacity.
///
/// # Errors
/// Files that cannot be read; opacity of another size, or of another number of frames as far as it is read; a cancel.
pub fn read(exemplar: &ExemplarFile, reading: &Reading, observer: &dyn Observer) -> Result<Frames> {
    let Some(mut shots) = Shots::open(exemplar)? else {
        let shot = Shot::of_picture(read_picture(&exemplar.frames)?);
        let frame = Opacity::of(exemplar)?.multiplied(&shot)?;
        return Ok(Frames::Still(shrunk(frame, reading.picture_side)));
    };
    let frames = frames(&mut shots, reading, observer)?;
    match &frames[..] {
        [] => Err(Error::file(Kind::Data, &exemplar.frames, "the clip has no frame").remedy("check that it plays")),
        [only] => Ok(Frames::Still(only.unpacked())),
        _ => Ok(Frames::Clip(frames)),
    }
}

/// The frames of a clip, all of them or evenly one in several, so that they play about as fast as filmed.
fn frames(shots: &mut Shots, reading: &Reading, observer: &dyn Observer) -> Result<Vec<Packed>> {
    let mut first = Vec::new();
    while first.len() < TIMED {
        match shots.next_pair()? {
            Some(pair) => first.push(pair),
            None => break,
        }
    }
    let every = every(&first, reading.fps, shots.path, observer);
    let mut rest = first.into_iter();
    let (mut frames, mut number): (Vec<Packed>, usize) = (Vec::new(), 0);
    while frames.len() < reading.limit + reading.fade {
        observe::check(observer)?;
        let Some(pair) = rest.next().map_or_else(|| shots.next_pair(), |pair| Ok(Some(pair)))? else { break };
        number += 1;
        if !usize::is_multiple_of(number - 1, every) {
            continue;
        }
        let frame = shots.opacity.multiplied(&shots.shot(&pair))?;
        frames.push(Packed::new(&shrunk(frame, reading.long_side)));
        let taken = (frames.len() * frames[0].bytes()) as u64;
        if let Some(room) = reading.room.filter(|&room| taken > room) {
            return Err(no_room(shots.path, room));
        }
    }
    Ok(frames)
}

/// The error of frames that take more memory than there is room for.
pub fn no_room(path: &Path, room: u64) -> Error {
    let problem = format!("its frames do not fit into the {} that are left of --max-memory", megabytes(room));
    Error::file(Kind::Limit, path, problem).remedy("allow more, or name a shorter or smaller clip")
}

/// One frame in how many is kept.
fn every(first: &[Pair], fps: f32, path: &Path, observer: &dyn Observer) -> usize {
    let span = first.last().map_or(0, |last| last.frame.time_ns - first[0].frame.time_ns);
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

/// With a long side of at most `long_side` pixels.
pub fn shrunk(frame: Premultiplied, long_side: usize) -> Premultiplied {
    let (width, height) = resample::shrunk(frame.size(), long_side);
    if (width, height) == frame.size() { frame } else { frame.resized(width, height) }
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
        let Frames::Clip(frames) = read(&ExemplarFile::new(folder.path()), &reading, &Silent).unwrap() else {
            panic!("a picture")
        };
        assert_eq!((frames.len(), frames[0].width, frames[0].bytes()), (5, 10, 200));
        let error =
            read(&ExemplarFile::new(folder.path()), &Reading { room: Some(999), ..reading }, &Silent).unwrap_err();
        assert!(error.kind() == Kind::Limit && error.to_string().contains("--max-memory"), "{error}");
    }
}
