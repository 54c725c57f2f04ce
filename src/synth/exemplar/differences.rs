//! A clip as what changes in it: its average image, and a loop of differences from it.

use std::path::Path;

use super::exemplar::{FADE, plan};
use super::files::{self, Frames, Reading};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::par;
use crate::raster::image::Plane;
use crate::render::residuals::Packed;
use crate::scene::scene::Scene;
use crate::video::looping::{Blend, LoopPlan};

/// Fewest frames of a clip.
const FEWEST: usize = 12;
/// Mean change from frame to frame below which nothing is seen to move, luma.
const STILL: f32 = 1e-4;

/// Luma of a clip, in a loop.
pub struct Differences {
    /// The mean of its frames.
    pub average: Plane,
    /// Every frame less the mean.
    frames: Vec<Packed>,
    plan: LoopPlan,
    /// Per pair of frames that are mixed, how alike they are.
    alike: Vec<f32>,
    /// What the loop's frames differ from the mean on the whole: it stands still, and carried along a flow it would draw
    /// lines.
    rest: Plane,
}

impl Differences {
    /// Reads the exemplar of a scene, with a long side of at most `long_side` pixels and within `room` bytes, and finds a
    /// loop of `frames` frames.
    ///
    /// # Errors
    /// No exemplar, a picture, a clip that is too short or in which nothing moves, an unreadable file, a cancel.
    pub fn of(
        scene: &Scene,
        method: &str,
        (long_side, frames): (usize, usize),
        room: Option<u64>,
        observer: &dyn Observer,
    ) -> Result<Self> {
        let settings = scene.settings();
        let Some(exemplar) = settings.exemplars.first() else {
            return Err(Error::new(
                Kind::Usage,
                "exemplar",
                format!("{method} borrows from a clip, and none is named"),
            )
            .remedy("name a clip of a like fluid with --exemplar"));
        };
        let path = &exemplar.frames;
        // A loop is looked for in twice the frames it needs.
        let limit = (2 * frames).max(4 * FADE);
        let fps = settings.output.fps;
        let reading = Reading { long_side, picture_side: long_side, limit, fps, fade: FADE, room };
        let clip = match files::read(exemplar, &reading, observer)? {
            Frames::Clip(clip) => clip,
            Frames::Still(_) => return Err(still(path, method)),
        };
        if clip.len() < FEWEST {
            return Err(Error::file(Kind::Unusable, path, format!("has {} frames at {fps} a second", clip.len()))
                .allowed(format!("{FEWEST} at least"))
                .remedy("give a longer clip"));
        }
        let plan = plan(&clip, frames)?;
        Self::from_frames(clip.len(), |t| clip[t].luma(), plan).ok_or_else(|| motionless(path))
    }

    /// From the luma of every frame; none where nothing changes.
    fn from_frames(count: usize, luma: impl Fn(usize) -> Plane + Sync + Send, plan: LoopPlan) -> Option<Self> {
        let mut average = luma(0);
        for t in 1..count {
            average.data.iter_mut().zip(&luma(t).data).for_each(|(a, v)| *a += v);
        }
        average.data.iter_mut().for_each(|a| *a /= count as f32);
        let difference = |t: usize| {
            let mut plane = luma(t);
            plane.data.iter_mut().zip(&average.data).for_each(|(v, a)| *v -= a);
            Packed::new(&plane)
        };
        let frames = par::map(count, difference);
        let size = average.data.len().max(1) as f32;
        let change = |plane: Plane| plane.data.iter().map(|v| v.abs()).sum::<f32>() / size;
        if par::map(count, |t| change(frames[t].unpacked())).into_iter().sum::<f32>() / (count as f32) < STILL {
            return None;
        }
        let pairs = plan.mixed();
        let alike = par::map(pairs.len(), |i| correlation(&frames[pairs[i].0], &frames[pairs[i].1]));
        let rest = average.map(|_| 0.0);
        let mut out = Self { average, frames, plan, alike, rest };
        out.rest = out.mean();
        Some(out)
    }

    /// The mean over the loop.
    fn mean(&self) -> Plane {
        let mut sum = self.at(0);
        for t in 1..self.length() {
            sum.data.iter_mut().zip(&self.at(t).data).for_each(|(s, v)| *s += v);
        }
        sum.map(|v| v / self.length() as f32)
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.average.width, self.average.height)
    }

    /// Frames of the clip.
    pub fn count(&self) -> usize {
        self.frames.len()
    }

    /// Frames of the loop.
    pub fn length(&self) -> usize {
        self.plan.length()
    }

    /// Luma of frame `t` of the clip.
    pub fn frame(&self, t: usize) -> Plane {
        self.seen(self.frames[t].unpacked())
    }

    /// Luma that has these differences.
    pub fn seen(&self, mut differences: Plane) -> Plane {
        differences.data.iter_mut().zip(&self.average.data).for_each(|(d, a)| *d += a);
        differences
    }

    /// Differences of frame `t` of the loop, of mean 0 over it; those of two frames that are mixed have the contrast of one.
    pub fn at(&self, t: usize) -> Plane {
        let blend @ Blend { a, b, pair } = self.plan.at(t);
        let mut out = self.frames[a.frame].unpacked();
        if let Some(b) = b {
            let gain = blend.gain(self.alike[pair]);
            let other = self.frames[b.frame].unpacked();
            let (wa, wb) = (gain * a.weight, gain * b.weight);
            out.data.iter_mut().zip(&other.data).for_each(|(a, b)| *a = wa * *a + wb * b);
        }
        out.data.iter_mut().zip(&self.rest.data).for_each(|(d, r)| *d -= r);
        out
    }

    /// Bytes it takes.
    pub fn bytes(&self) -> u64 {
        (self.frames.len() * Packed::bytes(self.average.data.len())) as u64
    }
}

fn correlation(a: &Packed, b: &Packed) -> f32 {
    let (a, b) = (a.unpacked(), b.unpacked());
    let product = |a: &Plane, b: &Plane| a.data.iter().zip(&b.data).map(|(a, b)| f64::from(a * b)).sum::<f64>();
    (product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt().max(1e-12)) as f32
}

fn still(path: &Path, method: &str) -> Error {
    Error::file(Kind::Unusable, path, format!("does not move, and {method} borrows motion"))
        .remedy("name a clip, or take the looks of a picture with --method lazyfluids")
}

fn motionless(path: &Path) -> Error {
    Error::file(Kind::Unusable, path, "nothing moves in the clip").remedy("name another one")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{hash, unit};
    use crate::video::looping::{Distances, plan_loop};

    /// Noise over a slope, ever brighter on the left: what a loop of some frames shows is not what all show.
    fn differences(frames: usize) -> Differences {
        let luma = |t: usize| {
            let noise = move |x: usize, y: usize| unit(hash(t as u64, &[x as u64, y as u64]));
            Plane::from_fn(40, 30, |x, y| 0.2 * noise(x, y) + if x < 20 { 0.01 * t as f32 } else { 0.3 })
        };
        let lumas: Vec<Plane> = (0..50).map(luma).collect();
        let plan = plan_loop(&Distances::between(&lumas), &[], frames, 8).unwrap();
        Differences::from_frames(50, luma, plan).unwrap()
    }

    #[test]
    fn a_loop_has_no_difference_that_stands_still_and_keeps_its_contrast() {
        let clip = differences(24);
        assert_eq!((clip.length(), clip.count(), clip.size()), (24, 50, (40, 30)));
        assert!(clip.mean().data.iter().all(|v| v.abs() < 1e-5));
        // The deviation of even noise is its width over √12.
        let wanted = 0.2 / 12f32.sqrt();
        for t in 0..24 {
            let right: Vec<f32> = (0..30).flat_map(|y| clip.at(t).row(y)[20..].to_vec()).collect();
            let deviation = (right.iter().map(|v| v * v).sum::<f32>() / right.len() as f32).sqrt();
            assert!((deviation / wanted - 1.0).abs() < 0.2, "frame {t}: {deviation} of {wanted}");
        }
    }

    #[test]
    fn frames_are_the_average_and_their_differences() {
        let clip = differences(24);
        let wanted = 0.1 + 0.3;
        assert!((clip.average.data.iter().skip(20).step_by(40).sum::<f32>() / 30.0 - wanted).abs() < 0.01);
        let plan = plan_loop(&Distances::between(&vec![Plane::zeros(8, 8); 20]), &[], 12, 4).unwrap();
        assert!(Differences::from_frames(20, |_| Plane::filled(8, 8, 0.5), plan).is_none(), "nothing moves");
    }
}
