//! The frames of an exemplar method: made one after the other, closed to a loop, laid over the picture and written.

use std::collections::VecDeque;

use super::chain::{Chain, Recipe, State};
use super::detail::Detail;
use crate::base::error::Result;
use crate::base::observe::{self, Observer, Once, stage};
use crate::flow::draw;
use crate::flow::field::Field;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::premultiplied::Premultiplied;
use crate::raster::resample::{resize, resize_rgb8};
use crate::render::fade::mixed;
use crate::render::overlay::Overlay;
use crate::render::recover::AssignedMotion;
use crate::render::streaks::streaked;
use crate::scene::scene::{Scene, Still};
use crate::scene::target::Target;
use crate::synth::exemplar::exemplar::{Exemplar, Wanted};
use crate::synth::maps::{self, maps};
use crate::synth::method::Outcome;
use crate::synth::record::{FrameRecord, RunRecord, SynthesisRecord, Timed};
use crate::synth::{memory, separation};
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
/// A target without flow, a target or exemplar that does not serve, unreadable files, a sink that fails, a cancel.
pub fn synthesize(method: &impl PatchMethod, scene: &Scene, sink: &mut dyn Sink, observer: &Timed) -> Result<Outcome> {
    let still = stage(observer, "read picture", 0, || scene.still(observer))?;
    let target = Target::of(scene, &still)?;
    target.must_flow()?;
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
    let engine = recipe.bytes(width * height, exemplar.pixels())?;
    memory::room(scene, engine + exemplar.clip_bytes() + (fade * width * height * LEAD_BYTES) as u64)?;
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
    let soft = scene.designed().is_some() && exemplar.is_opaque();
    if soft {
        observer.note(
            "the exemplar is opaque all over, so the edges are the target's own; one with soft edges has more to lend",
        );
    }
    let show = Show { target, chain: &chain, shutter: showing.shutter, detail, soft };
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
    outcome(run, made_up(run, &overlay), made)
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
    /// Whether opacity is the target's: an opaque exemplar has no edges to lend.
    soft: bool,
}

/// A frame as it is seen.
struct FluidFrame {
    /// At working size.
    fluid: Premultiplied,
    /// What is finer, at output size.
    detail: Option<[Plane; 3]>,
}

impl Show<'_> {
    /// A frame; near the end of a loop it gives way to another by a share.
    fn frame(&self, state: &State, coming: Option<(&State, f32)>) -> Result<FluidFrame> {
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
        Ok(FluidFrame { fluid, detail: detail.map(|(a, b)| std::array::from_fn(|c| sum(&a[c], &b[c]))) })
    }

    fn alone(&self, state: &State) -> Result<FluidFrame> {
        let detail = self.detail.as_ref().zip(self.chain.patches()).map(|(detail, patches)| detail.of(state, patches));
        let mut fluid = state.shown();
        let place = state.t.clamp(0, self.target.frames() as i64 - 1) as usize;
        if self.soft {
            let alpha = self.target.alpha(place)?;
            let planes = fluid.planes.iter_mut();
            planes.for_each(|plane| plane.data.iter_mut().zip(&alpha.data).for_each(|(v, a)| *v *= a));
        }
        if self.shutter > 0.0 {
            fluid = streaked(&fluid, &self.target.flow(place)?, self.shutter);
        }
        Ok(FluidFrame { fluid, detail })
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
    let behind = match exemplar.own {
        true => {
            if still.background.is_some() {
                observer.note("the outline does not move, so the background is not seen");
            }
            None
        }
        false => Some(separation::background(still, observer)?),
    };
    let matte = scene.designed().is_none().then(|| still.matte.clone());
    Ok(Overlay { picture: still.picture.clone(), matte, behind })
}

fn outcome(run: &Run, background: Option<Rgb8>, frames: Vec<FrameRecord>) -> Result<Outcome> {
    let Run { scene, still, target, exemplar, .. } = *run;
    let (width, height) = still.map.working;
    let flow = target.flow(0)?;
    let field = Field { u: resize(&flow.u, width, height), v: resize(&flow.v, width, height) };
    let mut pictures = vec![("exemplar", exemplar.at(0).on_black()), ("motion", draw::colour(&field, 0.0))];
    pictures.extend(background.map(|background| ("background", background)));
    let arrays = maps::arrays(&field, still.asked.as_ref());
    let mut max_speed = None;
    if scene.designed().is_none() {
        let motion = AssignedMotion { activity: field.magnitude(), mean: field };
        let maps = maps(&motion, 1.0, still.asked.as_ref(), &still.working_matte, &still.map);
        pictures.extend(maps.pictures);
        max_speed = Some(maps.max_speed);
    }
    let synthesis = Some(SynthesisRecord { exemplar_size: exemplar.at(0).size(), frames });
    Ok(Outcome { record: RunRecord { synthesis, max_speed, ..RunRecord::default() }, pictures, arrays })
}

/// What was made up behind the fluid, at the picture's size, for a person to paint over.
fn made_up(run: &Run, overlay: &Overlay) -> Option<Rgb8> {
    let (width, height) = run.still.map.picture;
    let made = overlay.behind.as_ref().filter(|_| run.still.background.is_none())?;
    Some(resize_rgb8(made, width, height))
}
