//! What looks are borrowed from: a picture, a clip, or the picture's own fluid.

use std::borrow::Cow;
use std::path::Path;

use super::files::{self, Frames, Packed};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::par;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::raster::premultiplied::Premultiplied;
use crate::render::fade::mixed;
use crate::scene::file::LUMINANCE;
use crate::scene::scene::{Scene, Still};
use crate::scene::target::Target;
use crate::synth::memory;
use crate::video::looping::{Distances, LoopPlan, plan_loop, thumbnail};
use crate::video::steps::isolated_steps;

/// Alpha below which nothing is seen.
const UNSEEN: f32 = 0.5 / 255.0;
/// Most frames of the cross-fade where a clip's loop closes.
pub const FADE: usize = 20;
/// Frames of the target that are looked at for how much fluid it has.
const SAMPLES: usize = 8;
/// An exemplar is not shrunk below this long side, pixels.
const LEAST: usize = 48;

/// Frames to borrow from.
#[derive(Debug, Clone, PartialEq)]
pub struct Exemplar {
    content: Content,
    /// Whether it is the picture's own fluid.
    pub own: bool,
    /// A still one at a size for outputs larger than the working image.
    pub fine: Option<Premultiplied>,
}

#[derive(Debug, Clone, PartialEq)]
enum Content {
    Still(Premultiplied),
    /// Frames, and how they are looped where there are too few.
    Clip(Vec<Packed>, Option<LoopPlan>),
}

/// What an exemplar is wanted for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Its long side in pixels; 0: so that it has no more fluid than the target.
    pub long_side: usize,
    /// How many turned copies of it are used.
    pub turns: usize,
    /// Side of a patch in pixels.
    pub side: usize,
    /// Pixels of the output per pixel of the working image.
    pub enlarged: f32,
}

impl Exemplar {
    /// The exemplar of a scene. It is shrunk as is wanted, never enlarged; a clip gives one frame per output frame, and is
    /// looped seamlessly where the target is, or is longer.
    ///
    /// # Errors
    /// A designed target without an exemplar; a file that cannot be read; opacity of another size, or none anywhere; an
    /// exemplar smaller than a patch; a clip larger than the memory that is allowed; a cancel.
    pub fn of(scene: &Scene, still: &Still, target: &Target, wanted: &Wanted, observer: &dyn Observer) -> Result<Self> {
        let settings = scene.settings();
        let Some(path) = &settings.exemplar else {
            if scene.designed().is_some() {
                return Err(Error::new(Kind::Usage, "exemplar", "a designed target has no fluid of its own")
                    .remedy("name a picture or a clip whose looks are borrowed, with --exemplar"));
            }
            let own = Premultiplied::new(&still.working, &still.working_matte);
            let fine = (wanted.enlarged > 1.0).then(|| Premultiplied::new(&still.picture.to_color(), &still.matte));
            return Ok(Self { content: Content::Still(own), own: true, fine });
        };
        let (frames, fps) = (target.frames(), settings.output.fps);
        // A loop is looked for in twice the frames it needs.
        let limit = (if target.loops() { 2 * frames } else { frames }).max(4 * FADE);
        let long_side = if wanted.long_side == 0 { target.size().0.max(target.size().1) } else { wanted.long_side };
        let finer = |side: usize| (side as f32 * wanted.enlarged.max(1.0)).round() as usize;
        let (picture_side, room) = (finer(long_side), memory::room(scene, 0)?);
        let reading = files::Reading { long_side, picture_side, limit, fps, fade: FADE, room };
        let read = files::read(path, settings.exemplar_alpha.as_deref(), &reading, observer)?;
        let large = read.size();
        let fine = match &read {
            Frames::Still(frame) if wanted.enlarged > 1.0 => Some(frame.clone()),
            _ => None,
        };
        let read = read.shrunk(long_side);
        let read = if wanted.long_side == 0 { fitted(read, fluid_of(target)? / wanted.turns as f64) } else { read };
        let finest = finer(read.size().0.max(read.size().1)).min(large.0.max(large.1));
        let fine = fine.map(|fine| files::shrunk(fine, finest));
        let content = match read {
            Frames::Still(frame) => Content::Still(frame),
            Frames::Clip(clip) => {
                let looped = target.loops() || clip.len() < frames;
                let plan = looped.then(|| plan(&clip, frames)).transpose()?;
                Content::Clip(clip, plan)
            }
        };
        let exemplar = Self { content, own: false, fine };
        let (width, height) = exemplar.at(0).size();
        let shrunk = (width, height) != large || large.0.max(large.1) == picture_side;
        exemplar.check(path, settings.exemplar_alpha.as_deref(), shrunk, wanted.side)?;
        if (width, height) != large && wanted.long_side == 0 {
            let name = path.display();
            observer.note(&format!("{name}: used at {width} × {height} pixels, to have no more fluid than the target"));
        }
        Ok(exemplar)
    }

    /// Frame `t`; negative ones come before the first.
    pub fn at(&self, t: i64) -> Cow<'_, Premultiplied> {
        match &self.content {
            Content::Still(frame) => Cow::Borrowed(frame),
            Content::Clip(frames, Some(plan)) => {
                let blend = plan.at(t.rem_euclid(plan.length() as i64) as usize);
                let a = frames[blend.a.frame].unpacked();
                Cow::Owned(match blend.b {
                    Some(b) => mixed(&a, &frames[b.frame].unpacked(), blend.a.weight),
                    None => a,
                })
            }
            Content::Clip(frames, None) => Cow::Owned(frames[t.clamp(0, frames.len() as i64 - 1) as usize].unpacked()),
        }
    }

    /// Memory that the frames of a clip take, bytes.
    pub fn clip_bytes(&self) -> u64 {
        match &self.content {
            Content::Still(_) => 0,
            Content::Clip(frames, _) => frames.iter().map(|frame| frame.bytes() as u64).sum(),
        }
    }

    /// Whether all frames are the same.
    pub fn is_still(&self) -> bool {
        matches!(self.content, Content::Still(_))
    }

    /// Whether there is no outline to borrow.
    pub fn is_opaque(&self) -> bool {
        self.alphas_are(|a| a > 1.0 - UNSEEN)
    }

    fn alphas_are(&self, test: impl Fn(f32) -> bool + Sync + Send) -> bool {
        match &self.content {
            Content::Still(frame) => frame.alpha().data.iter().all(|&a| test(a)),
            Content::Clip(frames, _) => {
                let all = |i: usize| frames[i].data.iter().all(|p| test(f32::from(p[3]) / 255.0));
                par::map(frames.len(), all).into_iter().all(|fits| fits)
            }
        }
    }

    fn check(&self, path: &Path, alpha: Option<&Path>, shrunk: bool, side: usize) -> Result<()> {
        let (width, height) = self.at(0).size();
        if width.min(height) < side {
            let shrunk = if shrunk { ", shrunk from a larger one" } else { "" };
            let problem = format!("an exemplar of {width} × {height} pixels{shrunk}");
            return Err(Error::file(Kind::Unusable, path, problem)
                .allowed(format!("at least {side} × {side}, one patch"))
                .remedy("give a larger one, or a larger long side with option exemplar_size"));
        }
        if self.alphas_are(|a| a < UNSEEN) {
            let remedy = match alpha {
                None => "give its opacity with --exemplar-alpha: a grey picture, white where the fluid is".to_owned(),
                Some(word) if word.as_os_str() == LUMINANCE => {
                    "it is too dark for luminance: give a grey picture with --exemplar-alpha".to_owned()
                }
                Some(painted) => format!("paint {} white where the fluid is", painted.display()),
            };
            return Err(Error::file(Kind::Unusable, path, "the exemplar is transparent all over").remedy(remedy));
        }
        Ok(())
    }
}

/// A loop of `frames` frames out of a clip.
///
/// # Errors
/// A clip or a loop without frames.
pub fn plan(clip: &[Packed], frames: usize) -> Result<LoopPlan> {
    let lumas = par::map(clip.len(), |i| clip[i].luma());
    let thumbnails = par::map(lumas.len(), |i| thumbnail(&lumas[i]));
    let step = |i: usize| {
        let pairs = lumas[i].data.iter().zip(&lumas[i + 1].data);
        pairs.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / lumas[i].data.len() as f64
    };
    let steps = par::map(lumas.len().saturating_sub(1), step);
    plan_loop(&Distances::between(&thumbnails), &isolated_steps(&steps), frames, FADE)
}

/// Most fluid that a frame of the target has, in opaque pixels.
fn fluid_of(target: &Target) -> Result<f64> {
    let frames = target.frames();
    let fluid = |k: usize| Ok(fluid(&target.alpha(k * (frames - 1) / (SAMPLES - 1))?));
    let samples = if target.loops() { 1 } else { SAMPLES };
    Ok(par::try_map(samples, fluid)?.into_iter().fold(0.0, f64::max))
}

fn fluid(alpha: &Plane) -> f64 {
    alpha.data.iter().map(|&a| f64::from(a)).sum()
}

/// An exemplar shrunk until no frame has more than `most` opaque pixels: patches that are never used would be the ones with
/// detail (LazyFluids, §6).
fn fitted(frames: Frames, most: f64) -> Frames {
    let has = match &frames {
        Frames::Still(frame) => fluid(frame.alpha()),
        Frames::Clip(clip) => par::map(clip.len(), |i| clip[i].fluid()).into_iter().fold(0.0, f64::max),
    };
    let (width, height) = frames.size();
    let long = width.max(height);
    let side = (long as f64 * (most / has.max(1.0)).sqrt()).round() as usize;
    frames.shrunk(side.max(LEAST.min(long)))
}

/// Mean colour of the fluid around every pixel.
pub fn surroundings(frame: &Premultiplied, sigma: f32) -> [Plane; 3] {
    let blurred = par::map(4, |c| gaussian(&frame.planes[c], sigma));
    let weight = &blurred[3].data;
    std::array::from_fn(|c| {
        let mean = blurred[c].data.iter().zip(weight).map(|(m, w)| if *w > 1e-4 { *m / w } else { 0.0 });
        Plane::from_vec(blurred[c].width, blurred[c].height, mean.collect())
    })
}
