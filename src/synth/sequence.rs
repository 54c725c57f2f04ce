//! The frames of an exemplar method: made one after the other, closed to a loop, laid over the picture and written.

use std::collections::VecDeque;

use super::chain::{Chain, Recipe, State};
use super::detail::Detail;
use super::exemplar::{Exemplar, Wanted};
use super::record::{FrameRecord, RunRecord, SynthesisRecord, Timed};
use super::{Outcome, memory};
use crate::base::error::Result;
use crate::base::observe::{self, Observer, Once, stage};
use crate::flow::draw;
use crate::flow::field::Field;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::premultiplied::Premultiplied;
use crate::raster::resample::resize;
use crate::render::fade::mixed;
use crate::render::overlay::Overlay;
use crate::render::streaks::streaked;
use crate::scene::scene::{Scene, Still};
use crate::scene::target::Target;
use crate::video::clip::Sink;

/// Memory of a frame that waits for the end of the loop, bytes per working pixel: colours, opacity, owed motion, field.
const LEAD_BYTES: usize = 32;

/// What every stage of a run looks at.
#[derive(Clone, Copy)]
struct Run<'a> {
    /// What is asked for.
    scene: &'a Scene,
    /// The picture and its matte.
    still: &'a Still,
    /// What the fluid does.
    target: &'a Target,
    /// What looks are borrowed from.
    exemplar: &'a Exemplar,
    /// Who is told.
    observer: &'a Timed<'a>,
}

/// How frames are shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Showing {
    /// The last frames of a loop, which are faded into what leads to its first.
    pub fade: usize,
    /// Frames of exposure.
    pub shutter: f32,
}

/// A method on the patch engine, as its options say.
pub trait PatchMethod {
    /// What the exemplar is wanted for.
    fn wanted(&self, still: &Still) -> Wanted;
    /// How the engine is used, for the picture's `own` fluid or another exemplar.
    fn recipe(&self, own: bool, seed: u64) -> Recipe;
    /// How frames are shown.
    fn showing(&self) -> Showing;
}

/// Reads picture, target and exemplar, makes all frames and writes them.
///
/// # Errors
/// A target or exemplar that does not serve, unreadable files, a sink that fails, a cancel.
pub fn synthesize(method: &impl PatchMethod, scene: &Scene, sink: &mut dyn Sink, observer: &Timed) -> Result<Outcome> {
    let still = stage(observer, "read picture", 0, || scene.still(observer))?;
    let target = Target::of(scene, &still)?;
    target.note(observer);
    let wanted = method.wanted(&still);
    let exemplar = stage(observer, "exemplar", 0, || Exemplar::of(scene, &still, &target, &wanted, observer))?;
    let run = Run { scene, still: &still, target: &target, exemplar: &exemplar, observer };
    animate(&run, &method.recipe(exemplar.own, scene.settings().output.seed), &method.showing(), sink)
}

fn animate(run: &Run, recipe: &Recipe, showing: &Showing, sink: &mut dyn Sink) -> Result<Outcome> {
    let Run { scene, target, exemplar, observer, .. } = *run;
    let frames = target.frames();
    let fade = if target.loops() { showing.fade.min(frames / 2) } else { 0 };
    let (width, height) = target.size();
    memory::room(scene, exemplar.clip_bytes() + (fade * width * height * LEAD_BYTES) as u64)?;
    let (output, wanted) = (scene.settings().output, scene.wanted_frames());
    let overlay = overlay(run)?;
    let once = Once::new(observer);
    let chain = stage(observer, "patches", 0, || Chain::new(recipe, run.exemplar, target, &once))?;
    let first = stage(observer, "first frame", 0, || chain.first())?;
    let mut made = vec![first.record.clone()];
    // What leads to the first frame is made backwards from it, so that the loop begins with the picture itself.
    let lead = match wanted.end > frames - fade {
        true => lead(&chain, &first, fade, observer)?,
        false => VecDeque::new(),
    };
    made.extend(lead.iter().rev().map(|state| state.record.clone()));
    let detail = if showing.shutter > 0.0 { None } else { detail(run, recipe) };
    let show = Show { target, chain: &chain, shutter: showing.shutter, detail };
    let mut state = first;
    stage(observer, "frames", wanted.len() as u64, || {
        for t in 0..wanted.end {
            observe::check(observer)?;
            if t > 0 {
                state = chain.next(&state, false)?;
                made.push(state.record.clone());
            }
            if t < wanted.start {
                continue;
            }
            let coming = (t + fade).checked_sub(frames).and_then(|k| Some((lead.get(k)?, k)));
            let coming = coming.map(|(state, k)| (state, (k + 1) as f32 / (fade + 1) as f32));
            let shown = show.frame(&state, coming)?;
            if output.alpha {
                let (colours, opacity) = overlay.alone(&shown.fluid, shown.detail.as_ref());
                sink.push_with_alpha(&colours, &opacity)?;
            } else {
                sink.push(&overlay.frame(&shown.fluid, shown.detail.as_ref()))?;
            }
            observer.advance("frames", 1);
        }
        Ok(())
    })?;
    outcome(run, made)
}

/// The `count` frames before the first, in order.
fn lead(chain: &Chain, first: &State, count: usize, observer: &Timed) -> Result<VecDeque<State>> {
    stage(observer, "frames before the first", count as u64, || {
        let mut lead: VecDeque<State> = VecDeque::with_capacity(count);
        for _ in 0..count {
            observe::check(observer)?;
            lead.push_front(chain.next(lead.front().unwrap_or(first), true)?);
            observer.advance("frames before the first", 1);
        }
        Ok(lead)
    })
}

/// From what was synthesised to what is seen.
struct Show<'a> {
    target: &'a Target,
    chain: &'a Chain<'a>,
    shutter: f32,
    detail: Option<Detail>,
}

/// A frame as it is seen.
struct Shown {
    /// At working size.
    fluid: Premultiplied,
    /// What is finer, at output size.
    detail: Option<[Plane; 3]>,
}

impl Show<'_> {
    /// A frame; near the end of a loop it gives way to another by a share.
    fn frame(&self, state: &State, coming: Option<(&State, f32)>) -> Result<Shown> {
        let here = self.alone(state)?;
        let Some((other, share)) = coming else { return Ok(here) };
        let there = self.alone(other)?;
        let fluid = mixed(&there.fluid, &here.fluid, share);
        // Fine detail of two frames is unlike: their sum keeps the contrast of one.
        let norm = share.hypot(1.0 - share);
        let sum = |a: &Plane, b: &Plane| {
            let both = a.data.iter().zip(&b.data).map(|(a, b)| (share * a + (1.0 - share) * b) / norm);
            Plane::from_vec(a.width, a.height, both.collect())
        };
        let detail = there.detail.zip(here.detail);
        Ok(Shown { fluid, detail: detail.map(|(a, b)| std::array::from_fn(|c| sum(&a[c], &b[c]))) })
    }

    fn alone(&self, state: &State) -> Result<Shown> {
        let detail = self.detail.as_ref().zip(self.chain.atlas()).map(|(detail, atlas)| detail.of(state, atlas));
        let mut fluid = state.shown();
        if self.shutter > 0.0 {
            let place = state.t.clamp(0, self.target.frames() as i64 - 1) as usize;
            fluid = streaked(&fluid, &self.target.flow(place)?, self.shutter);
        }
        Ok(Shown { fluid, detail })
    }
}

/// Detail finer than a working pixel; a shutter that is open for long leaves none.
fn detail(run: &Run, recipe: &Recipe) -> Option<Detail> {
    let Run { still, exemplar, .. } = *run;
    let fine = exemplar.fine.as_ref()?;
    Detail::new(fine, &exemplar.at(0), recipe.turned, (still.map.working, still.map.output))
}

/// What the fluid is laid over.
fn overlay(run: &Run) -> Result<Overlay> {
    let Run { scene, still, exemplar, observer, .. } = *run;
    // The picture's own fluid fills its matte: nothing shows through that did not before.
    let behind = if exemplar.own && still.background.is_none() {
        None
    } else {
        Some(super::outline::background(still, observer)?)
    };
    let matte = scene.designed().is_none().then(|| still.matte.clone());
    Ok(Overlay { picture: still.picture.clone(), matte, behind })
}

fn outcome(run: &Run, frames: Vec<FrameRecord>) -> Result<Outcome> {
    let (width, height) = run.still.map.working;
    let flow = run.target.flow(0)?;
    let field = Field { u: resize(&flow.u, width, height), v: resize(&flow.v, width, height) };
    let exemplar: Rgb8 = run.exemplar.at(0).on_black();
    let pictures = vec![("exemplar", exemplar), ("motion", draw::colour(&field, 0.0))];
    let synthesis = SynthesisRecord { exemplar_size: run.exemplar.at(0).size(), frames };
    Ok(Outcome { record: RunRecord { synthesis: Some(synthesis), ..RunRecord::default() }, pictures })
}
