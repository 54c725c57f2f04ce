//! Frames in memory, of one size, with what several measures need of them.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::sliced::Sorted;
use crate::base::error::{Error, Kind, Result};
use crate::base::par;
use crate::flow::field::Field;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::resample::{resize, resize_rgb8, shrunk};
use crate::video::clip::Sink;

/// Long side that videos are measured at unless the caller says otherwise: that of a library clip.
pub const LONG_SIDE: usize = 640;

/// Frames of one size, and which of their pixels count.
#[derive(Debug, Default)]
pub struct Footage {
    frames: Vec<Rgb8>,
    fps: f32,
    loops: bool,
    inside: Vec<bool>,
    luma: OnceLock<Vec<Plane>>,
    mean: OnceLock<Plane>,
    /// Motion between consecutive frames, see [`super::motion`].
    pub(super) pairs: OnceLock<Vec<Pair>>,
    /// Differences of consecutive frames, see [`super::continuity`].
    pub(super) differences: OnceLock<Vec<f64>>,
    /// Contrasts of the moving part, see [`super::continuity`].
    pub(super) contrasts: OnceLock<Vec<f64>>,
    /// Colour patches, see [`super::patches`].
    pub(super) colours: PerSeed<Sorted>,
    /// Space-time patches, see [`super::patches`].
    pub(super) dynamics: PerSeed<Sorted>,
    /// Powers per band, see [`super::spectrum`].
    pub(super) levels: PerSeed<Vec<Vec<f32>>>,
    /// How long forms last, see [`super::renewal`].
    pub(super) kept: PerSeed<[f64; 2]>,
    halves: OnceLock<Option<Box<[Footage; 2]>>>,
}

/// Motion between two consecutive frames, in pixels per frame of the small frames it was estimated on.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    /// The two frames' numbers.
    pub(super) frames: (usize, usize),
    /// From the first frame to the second.
    pub(super) forward: Field,
    /// What the motion does not explain: see [`super::motion`].
    pub(super) unexplained: (f64, usize),
}

/// What random samples of some seed gave; those of another seed take its place.
#[derive(Debug)]
pub(super) struct PerSeed<T>(Mutex<Option<(u64, Option<Arc<T>>)>>);

impl<T> Default for PerSeed<T> {
    fn default() -> Self {
        Self(Mutex::new(None))
    }
}

impl<T> PerSeed<T> {
    /// What `make` gives for `seed`, made once.
    pub(super) fn get(&self, seed: u64, make: impl FnOnce() -> Option<T>) -> Option<Arc<T>> {
        // What a panic left behind is whole or not there.
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match &*kept {
            Some((of, value)) if *of == seed => value.clone(),
            _ => kept.insert((seed, make().map(Arc::new))).1.clone(),
        }
    }
}

impl Footage {
    /// Frames at `fps` frames per second; with `loops` the first follows the last. Pixels count where `matte`, which is
    /// resized to the frames, is at least ½; without a matte all count.
    ///
    /// # Errors
    /// No frames, frames of different sizes, a matte with no pixel inside.
    pub fn new(frames: Vec<Rgb8>, fps: f32, loops: bool, matte: Option<&Plane>) -> Result<Self> {
        let Some(first) = frames.first() else {
            return Err(Error::new(Kind::Unusable, "video", "it has no frames").remedy("check that it plays"));
        };
        let size = (first.width, first.height);
        if let Some(at) = frames.iter().position(|f| (f.width, f.height) != size) {
            let problem = format!("frame {at} has {} × {} pixels", frames[at].width, frames[at].height);
            return Err(Error::new(Kind::Unusable, "video", problem).allowed(format!("{} × {}", size.0, size.1)));
        }
        let inside: Vec<bool> = match matte {
            Some(matte) => resize(matte, size.0, size.1).data.iter().map(|&m| m >= 0.5).collect(),
            None => vec![true; size.0 * size.1],
        };
        if !inside.contains(&true) {
            return Err(Error::new(Kind::Unusable, "matte", "no pixel is at least half white: nothing to measure")
                .remedy("paint white where the fluid is"));
        }
        Ok(Self { frames, fps, loops, inside, ..Self::default() })
    }

    /// A picture as footage of one frame.
    ///
    /// # Errors
    /// Those of [`Footage::new`].
    pub fn still(picture: Rgb8, matte: Option<&Plane>) -> Result<Self> {
        Self::new(vec![picture], 1.0, false, matte)
    }

    /// The frames.
    pub fn frames(&self) -> &[Rgb8] {
        &self.frames
    }

    /// Frames per second.
    pub fn fps(&self) -> f32 {
        self.fps
    }

    /// Whether the first frame follows the last.
    pub fn loops(&self) -> bool {
        self.loops
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.frames[0].width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.frames[0].height
    }

    /// Per pixel, whether it counts.
    pub fn inside(&self) -> &[bool] {
        &self.inside
    }

    /// Its two halves, which tell how much two stretches of it differ; they do not loop. None of a single frame.
    pub(super) fn halves(&self) -> Option<[&Self; 2]> {
        let halves = self.halves.get_or_init(|| {
            let middle = self.frames.len() / 2;
            let half = |frames: &[Rgb8]| Self {
                frames: frames.to_vec(),
                fps: self.fps,
                inside: self.inside.clone(),
                ..Self::default()
            };
            (middle > 0).then(|| Box::new([half(&self.frames[..middle]), half(&self.frames[middle..])]))
        });
        halves.as_deref().map(|[a, b]| [a, b])
    }

    /// Indices of the pixels that count.
    pub(super) fn pixels(&self) -> Vec<usize> {
        (0..self.inside.len()).filter(|&i| self.inside[i]).collect()
    }

    /// Luma of every frame, in [0, 1].
    pub(super) fn luma(&self) -> &[Plane] {
        self.luma.get_or_init(|| par::map(self.frames.len(), |t| self.frames[t].luma()))
    }

    /// Mean luma of every pixel over time.
    pub(super) fn mean(&self) -> &Plane {
        self.mean.get_or_init(|| {
            let mut mean = Plane::zeros(self.width(), self.height());
            let luma = self.luma();
            let share = 1.0 / luma.len() as f32;
            par::for_each_chunk(&mut mean.data, self.width(), |y, row| {
                for frame in luma {
                    row.iter_mut().zip(frame.row(y)).for_each(|(m, l)| *m += share * l);
                }
            });
            mean
        })
    }

    /// Consecutive frames (t, t + 1), the last and the first among them when it loops.
    pub(super) fn steps(&self) -> Vec<(usize, usize)> {
        let count = self.frames.len();
        let closing = (self.loops && count > 1).then_some((count - 1, 0));
        (1..count).map(|t| (t - 1, t)).chain(closing).collect()
    }
}

/// At most `most` of `n` things, evenly spread.
pub(super) fn spread(n: usize, most: usize) -> Vec<usize> {
    let count = n.min(most);
    (0..count).map(|i| i * n / count).collect()
}

/// Keeps the frames it is given, shrunk to a long side: a [`Sink`] to measure what a method makes.
#[derive(Debug)]
pub struct Recorder {
    long_side: usize,
    frames: Vec<Rgb8>,
}

impl Recorder {
    /// Shrinks frames to a long side of `long_side` pixels; smaller ones stay as they are.
    pub fn new(long_side: usize) -> Self {
        Self { long_side, frames: Vec::new() }
    }

    /// The frames as footage, see [`Footage::new`].
    ///
    /// # Errors
    /// Those of [`Footage::new`].
    pub fn into_footage(self, fps: f32, loops: bool, matte: Option<&Plane>) -> Result<Footage> {
        Footage::new(self.frames, fps, loops, matte)
    }
}

impl Sink for Recorder {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        let (width, height) = shrunk((frame.width, frame.height), self.long_side);
        self.frames.push(resize_rgb8(frame, width, height));
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_and_mattes_that_cannot_be_measured_are_refused() {
        let frame = Rgb8::black;
        let says = |frames: Vec<Rgb8>, matte: Option<&Plane>, part: &str| {
            let error = Footage::new(frames, 25.0, false, matte).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        says(vec![], None, "it has no frames");
        says(vec![frame(8, 4), frame(8, 5)], None, "frame 1 has 8 × 5 pixels (allowed: 8 × 4)");
        says(vec![frame(8, 4)], Some(&Plane::filled(8, 4, 0.4)), "no pixel is at least half white");
    }

    #[test]
    fn a_recorder_shrinks_and_a_matte_is_brought_to_its_size() {
        let mut recorder = Recorder::new(32);
        for _ in 0..3 {
            recorder.push(&Rgb8::black(64, 40)).unwrap();
        }
        let matte = Plane::from_fn(64, 40, |x, _| if x < 32 { 1.0 } else { 0.0 });
        let footage = recorder.into_footage(25.0, true, Some(&matte)).unwrap();
        assert_eq!((footage.width(), footage.height(), footage.frames().len()), (32, 20, 3));
        assert_eq!(footage.pixels().len(), 16 * 20);
        assert_eq!(footage.steps(), [(0, 1), (1, 2), (2, 0)]);
        assert_eq!(spread(10, 4), [0, 2, 5, 7]);
    }
}
