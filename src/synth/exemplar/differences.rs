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
        let Some(path) = &settings.exemplar else {
            return Err(Error::new(
                Kind::Usage,
                "exemplar",
                format!("{method} borrows from a clip, and none is named"),
            )
            .remedy("name a clip of a like fluid with --exemplar"));
        };
        // A loop is looked for in twice the frames it needs.
        let limit = (2 * frames).max(4 * FADE);
        let fps = settings.output.fps;
        let reading = Reading { long_side, picture_side: long_side, limit, fps, fade: FADE, room };
        let clip = match files::read(path, settings.exemplar_alpha.as_deref(), &reading, observer)? {
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
        Some(Self { average, frames, plan, alike })
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.average.width, self.average.height)
    }

    /// Frames of the clip.
    pub fn count(&self) -> usize {
        self.frames.len()
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

    /// Differences of frame `t` of the loop; those of two frames that are mixed have the contrast of one.
    pub fn at(&self, t: usize) -> Plane {
        let blend @ Blend { a, b, pair } = self.plan.at(t);
        let mut out = self.frames[a.frame].unpacked();
        if let Some(b) = b {
            let gain = blend.gain(self.alike[pair]);
            let other = self.frames[b.frame].unpacked();
            let (wa, wb) = (gain * a.weight, gain * b.weight);
            out.data.iter_mut().zip(&other.data).for_each(|(a, b)| *a = wa * *a + wb * b);
        }
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
