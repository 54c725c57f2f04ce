//! The frames of an exemplar method: made one after the other, closed to a loop, laid over the picture and written.

use std::collections::VecDeque;

use super::Outcome;
use super::chain::{Chain, Recipe, State};
use super::exemplar::Exemplar;
use super::record::{FrameRecord, RunRecord, SynthesisRecord, Timed};
use crate::base::error::Result;
use crate::base::observe::{self, Observer, Once, stage};
use crate::flow::draw;
use crate::flow::field::Field;
use crate::raster::image::Rgb8;
use crate::raster::premultiplied::Premultiplied;
use crate::raster::resample::resize;
use crate::render::fade::mixed;
use crate::render::overlay::Overlay;
use crate::scene::scene::{Scene, Still};
use crate::scene::target::Target;
use crate::video::clip::Sink;

/// What every stage of a run looks at.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// What is asked for.
    pub scene: &'a Scene,
    /// The picture and its matte.
    pub still: &'a Still,
    /// What the fluid does.
    pub target: &'a Target,
    /// What looks are borrowed from.
    pub exemplar: &'a Exemplar,
    /// Who is told.
    pub observer: &'a Timed<'a>,
}

/// Makes all frames and writes them; the last `fade` ones of a loop are faded into what leads to its first.
///
/// # Errors
/// An exemplar without patches, unreadable targets, a sink that fails, a cancel.
pub fn animate(run: &Run, recipe: &Recipe, fade: usize, sink: &mut dyn Sink) -> Result<Outcome> {
    let Run { scene, target, observer, .. } = *run;
    let (output, wanted) = (scene.settings().output, scene.wanted_frames());
    let overlay = overlay(run)?;
    let once = Once::new(observer);
    let chain = stage(observer, "patches", 0, || Chain::new(recipe, run.exemplar, target, &once))?;
    let first = stage(observer, "first frame", 0, || chain.first())?;
    let frames = target.frames();
    let fade = if target.loops() { fade.min(frames / 2) } else { 0 };
    // What leads to the first frame is made backwards from it, so that the loop begins with the picture itself.
    let mut made = vec![first.record.clone()];
    let lead =
        if wanted.end > frames - fade { lead(&chain, &first, fade, &mut made, observer)? } else { VecDeque::new() };
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
            let shown = closed(state.shown(), t, (frames, fade), &lead);
            if output.alpha {
                let (colours, opacity) = overlay.alone(&shown);
                sink.push_with_alpha(&colours, &opacity)?;
            } else {
                sink.push(&overlay.frame(&shown))?;
            }
            observer.advance("frames", 1);
        }
        Ok(())
    })?;
    outcome(run, made)
}

/// The `count` frames before the first, in order.
fn lead(
    chain: &Chain,
    first: &State,
    count: usize,
    made: &mut Vec<FrameRecord>,
    observer: &Timed,
) -> Result<VecDeque<Premultiplied>> {
    stage(observer, "frames before the first", count as u64, || {
        let (mut state, mut lead) = (first.clone(), VecDeque::with_capacity(count));
        for _ in 0..count {
            observe::check(observer)?;
            state = chain.next(&state, true)?;
            made.push(state.record.clone());
            lead.push_front(state.shown());
            observer.advance("frames before the first", 1);
        }
        Ok(lead)
    })
}

/// Frame `t` of a loop of `frames`, the last `fade` of which give way to what leads to the first.
fn closed(
    frame: Premultiplied,
    t: usize,
    (frames, fade): (usize, usize),
    lead: &VecDeque<Premultiplied>,
) -> Premultiplied {
    match (t + fade).checked_sub(frames).and_then(|k| Some((k, lead.get(k)?))) {
        Some((k, coming)) => mixed(coming, &frame, (k + 1) as f32 / (fade + 1) as f32),
        None => frame,
    }
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
