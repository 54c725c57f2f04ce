//! How fast the places of clips change.
//!
//! A still does not tell how fast its fluid moves, and what matches it best are pieces that hardly change: their average
//! images, of which the words are taken, are the sharpest. In a real fall the picture at a place is another one a frame
//! later; on a quiet sea it takes seconds. Optical flow does not tell the two apart, for it underestimates whitewater.

use std::collections::{BTreeMap, BTreeSet};

use super::choice::Choice;
use crate::base::error::Result;
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::library::reader::Pack;
use crate::library::variant::PIECE;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::raster::pyramid::reduce;
use crate::synth::method::Sources;

/// Frames of a clip that are looked at.
const FRAMES: usize = 33;
/// Window over which change is measured, Gaussian, pixels of the halved frame: about a piece.
const WINDOW: f32 = 8.0;
/// Variance of luma below which there is nothing but noise.
const NOISE: f32 = 0.002 * 0.002;
/// Octaves from another picture in every frame (slowness 0) to the slowest that counts (1).
const OCTAVES: f32 = 6.0;

/// Slowness of the clips that candidates come from.
pub struct Slowness(BTreeMap<(usize, u32), Plane>);

impl Slowness {
    /// Reads some frames of every clip that `choices` come from.
    ///
    /// # Errors
    /// A damaged pack, a cancel.
    pub fn of(choices: &[Choice], sources: &Sources, observer: &dyn Observer) -> Result<Self> {
        let owner = |c: &Choice| Ok((c.pack, sources.packs[c.pack].1.piece(c.piece)?.clip));
        let clips: BTreeSet<(usize, u32)> = choices.iter().map(owner).collect::<Result<_>>()?;
        let clips: Vec<(usize, u32)> = clips.into_iter().collect();
        let planes = observe::stage(observer, "slowness", clips.len() as u64, || {
            par::try_map(clips.len(), |i| {
                observe::check(observer)?;
                slowness(&sources.packs[clips[i].0].1, clips[i].1)
            })
        })?;
        Ok(Self(clips.into_iter().zip(planes).collect()))
    }

    /// Slowness of a piece, 0 to 1.
    ///
    /// # Errors
    /// A damaged pack.
    pub fn slowness(&self, choice: &Choice, sources: &Sources) -> Result<f32> {
        let pack = &sources.packs[choice.pack].1;
        let piece = pack.piece(choice.piece)?;
        let meta = &pack.clips()[piece.clip as usize];
        let variant = piece.variant();
        let half = 0.5 * PIECE as f32;
        let geometry = variant.geometry(meta.width as usize, meta.height as usize);
        let (x, y) = geometry.to_level(f32::from(piece.x) + half, f32::from(piece.y) + half);
        let halved = 0.5 / variant.scale_factor();
        Ok(self.0.get(&(choice.pack, piece.clip)).map_or(0.0, |plane| plane.bilinear(x * halved, y * halved)))
    }
}

/// Slowness of a clip, see [`Change::slowness`], per pixel of the halved frame.
fn slowness(pack: &Pack, clip: u32) -> Result<Plane> {
    let count = (pack.clips()[clip as usize].frames as usize).min(FRAMES);
    let mut frames = pack.frames(clip)?;
    let mut change = Change::new(reduce(&frames.luma_at(0)?));
    for t in 1..count {
        change.add(reduce(&frames.luma_at(t)?));
    }
    Ok(change.slowness())
}

/// Sums over consecutive frames, per pixel: of luma, of its square, and of the squared steps from frame to frame.
struct Change {
    sum: Plane,
    squares: Plane,
    steps: Plane,
    before: Plane,
    count: usize,
}

impl Change {
    fn new(luma: Plane) -> Self {
        let (squares, steps) = (luma.map(|v| v * v), Plane::zeros(luma.width, luma.height));
        Self { sum: luma.clone(), squares, steps, before: luma, count: 1 }
    }

    fn add(&mut self, luma: Plane) {
        for (i, (&l, &b)) in luma.data.iter().zip(&self.before.data).enumerate() {
            self.sum.data[i] += l;
            self.squares.data[i] += l * l;
            self.steps.data[i] += (l - b) * (l - b);
        }
        self.before = luma;
        self.count += 1;
    }

    /// 0 where the picture is another one in every frame, 1 where that takes 2⁶ times as long. Measured is the mean
    /// squared difference of neighbouring frames over twice the variance, which is 1 without any memory.
    fn slowness(mut self) -> Plane {
        let share = 1.0 / self.count as f32;
        let pairs = self.squares.data.iter_mut().zip(&self.sum.data);
        pairs.for_each(|(q, s)| *q = (share * *q - (share * s).powi(2)).max(0.0));
        let (mut out, steps) = (gaussian(&self.squares, WINDOW), gaussian(&self.steps, WINDOW));
        for (v, s) in out.data.iter_mut().zip(&steps.data) {
            let turnover = s / (self.count - 1) as f32 / (2.0 * (*v + NOISE));
            *v = (-turnover.max(1e-6).log2() / OCTAVES).clamp(0.0, 1.0);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{hash, unit};

    /// Mean slowness of noise that is another one every `hold` frames.
    fn of_noise(hold: u64) -> f32 {
        let frame = |t: u64| Plane::from_fn(48, 48, |x, y| unit(hash(t / hold, &[x as u64, y as u64])));
        let mut change = Change::new(frame(0));
        (1..FRAMES as u64).for_each(|t| change.add(frame(t)));
        let slowness = change.slowness();
        slowness.data.iter().sum::<f32>() / slowness.data.len() as f32
    }

    #[test]
    fn slowness_counts_octaves_of_renewal() {
        assert!(of_noise(1) < 0.02, "{}", of_noise(1));
        // With a new picture every 4 frames, one step in 4 is a whole one: two octaves of six.
        assert!((of_noise(4) - 2.0 / 6.0).abs() < 0.04, "{}", of_noise(4));
        assert!(of_noise(4) < of_noise(8) && of_noise(8) < of_noise(16));
    }

    #[test]
    fn what_stands_still_is_slowest_and_two_halves_are_told_apart() {
        assert_eq!(of_noise(1000), 1.0);
        let frame = |t: u64| {
            let lively = |x: usize, y: usize| unit(hash(t, &[x as u64, y as u64]));
            Plane::from_fn(96, 48, |x, y| if x < 48 { lively(x, y) } else { 0.3 })
        };
        let mut change = Change::new(frame(0));
        (1..9).for_each(|t| change.add(frame(t)));
        let slowness = change.slowness();
        assert!(
            slowness.at(10, 24) < 0.05 && slowness.at(95, 24) > 0.5,
            "{} {}",
            slowness.at(10, 24),
            slowness.at(95, 24)
        );
    }
}
