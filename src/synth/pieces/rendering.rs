//! What all frames of a run share: weights, gains, the recovered picture, the outline before the first frame.

use std::borrow::Cow;

use super::choice::Choice;
use super::footage::Clip;
use super::options::Options;
use super::outline::{self, Outline};
use super::phases::playing;
use super::placing::Placed;
use super::run::{Carrying, Run};
use super::{base_flow, fluctuation};
use crate::base::error::Result;
use crate::base::observe::Observer;
use crate::raster::image::{Color, Plane, Rgb8};
use crate::render::appearance::{Matching, Sample, spread};
use crate::render::blend::Blender;
use crate::render::boundary::Boundary;
use crate::render::composite::{Compositor, Stays};
use crate::render::contrast::{Contrast, FINE, Match, Strength, match_contrast};
use crate::render::drift::Travel;
use crate::render::layout::{BANDS, LevelKey};
use crate::render::recover::{AssignedMotion, Recovery, assigned_motion, make_room, recover};
use crate::synth::separation::{self, Separation, compositor};

/// Everything about the frames that does not change with time.
pub struct Rendering {
    /// The pieces' motion over the picture.
    pub motion: AssignedMotion,
    /// Integrates the pieces.
    pub blender: Blender,
    /// What frames are matched to.
    pub target: Target,
    /// Puts frames together.
    pub compositor: Compositor,
    /// The outline before the first frame.
    pub outline: Outline,
    /// How many frames before the first one the outline has to be followed from.
    pub run_in: usize,
    /// The background that was made for this picture.
    pub background: Option<Rgb8>,
}

impl Rendering {
    /// Luma of frame `t` of the loop, which has these differences.
    pub fn sample(&self, t: usize, differences: Plane) -> Sample<'_> {
        let base = self.compositor.carried_luma(t).map_or(Cow::Borrowed(&self.target.base), Cow::Owned);
        Sample { base, differences }
    }
}

/// What frames should look like, and what they start from; planes at working size.
pub struct Target {
    /// How far frames are brought to the picture.
    pub matching: Matching,
    /// Luma of the picture's fluid.
    pub picture: Plane,
    /// Luma of the recovered average, spread outwards outside the matte.
    pub base: Plane,
    /// The picture's matte.
    pub matte: Plane,
}

/// Takes the picture apart where the outline moves or the fluid is wanted alone.
///
/// # Errors
/// A background that shows the same as the picture, a damaged pack, a cancel.
pub fn separate(run: &Run, placed: &Placed) -> Result<Option<Separation>> {
    let Run { still, observer, .. } = *run;
    let tag = |choice: &Choice| {
        let pack = &run.sources.packs[choice.pack].1;
        Ok(pack.clips()[pack.piece(choice.piece)?.clip as usize].tag.as_str())
    };
    let tags = placed.choices.iter().map(tag).collect::<Result<Vec<_>>>()?;
    let output = run.scene.settings().output;
    // The option is meant for the library's rate: an outline must not stray farther where frames are fewer.
    let tau = outline::looseness(run, &tags).powf(25.0 / output.fps);
    if tau > 0.0 || output.alpha {
        let (layers, made) = separation::separate(still, observer)?;
        return Ok(Some(Separation { layers, made, tau }));
    }
    if still.background.is_some() {
        observer.note(&format!("the outline does not move, so the background is not seen ({}.tau = 0)", run.name));
    }
    Ok(None)
}

/// Weights, gains, recovered image: what all frames share. The clips' contrasts serve here for the last time.
///
/// # Errors
/// A damaged pack, a cancel.
pub fn prepare(run: &Run, placed: &Placed, clips: &mut [Clip], apart: Option<Separation>) -> Result<Rendering> {
    let Run { still, .. } = *run;
    let matched = matched_contrast(run, placed, clips);
    clips.iter_mut().for_each(Clip::forget_contrast);
    let motion = assigned_motion(&placed.layout);
    let fluid = apart.as_ref().map_or(&still.working, Separation::fluid);
    let recovered = recovered(run, placed, apart.as_ref(), &motion, &matched);
    let luma = recovered.luma();
    let target = Target {
        matching: matching(run.options),
        picture: fluid.luma(),
        base: spread(&luma, &still.working_matte),
        matte: still.working_matte.clone(),
    };
    let compositor = compositor(still, apart.as_ref(), &recovered);
    let compositor = match run.carrying {
        None => drifting(run, compositor, &motion),
        Some(options) => {
            let flow = base_flow::of(run, placed, options.pace)?;
            let matte = apart.as_ref().map_or(&still.working_matte, Separation::matte);
            let carry = options.carry(&flow, &run.scene.settings().output);
            let carried = compositor.carrying(matte, &Stays::But(&restless(placed, apart.as_ref(), &matched)), &carry);
            match run.swaying() {
                None => carried,
                Some(&Carrying { sway, memory, .. }) => {
                    let output = run.scene.settings().output;
                    let playing = playing(placed, clips, output.length());
                    let memory = memory * output.fps / 25.0;
                    carried.swaying(fluctuation::sway(placed, &playing, output.length(), sway, memory))
                }
            }
        }
    };
    let blender = Blender::new(&placed.layout, &matched.gains);
    let (outline, run_in, background) = match apart {
        None => (Outline::fixed(&still.working_matte), 0, None),
        Some(Separation { layers, made, tau }) => {
            (Outline::new(&layers, &luma, tau, run.options.flicker), Boundary::run_in(tau), made)
        }
    };
    Ok(Rendering { motion, blender, target, compositor, outline, run_in, background })
}

/// The fluid without what the differences bring.
fn recovered(
    run: &Run,
    placed: &Placed,
    apart: Option<&Separation>,
    motion: &AssignedMotion,
    matched: &Match,
) -> Color {
    let Options { shutter, blur, recovery: amount, .. } = *run.options;
    // Before a background the fluid is recovered wherever it may come, from its own colours.
    let (fluid, matte) = match apart {
        Some(Separation { layers, .. }) => (&layers.fluid, &layers.reach),
        None => (&run.still.working, &run.still.working_matte),
    };
    let recovered = match run.carrying {
        None => recover(fluid, matte, motion, &Recovery { shutter, blur, amount }),
        // What is carried needs no blur: its detail moves.
        Some(_) => fluid.clone(),
    };
    let shares = std::array::from_fn(|band| placed.layout.spread(|i| matched.shares[i][band]));
    make_room(&recovered, fluid, matte, &shares)
}

/// How much of the picture travels, per band and on cells: as much as moves in the clips. Of a fluid whose outline lets
/// go nothing belongs to the place: it has no bed that lights and shades it.
fn restless(placed: &Placed, apart: Option<&Separation>, matched: &Match) -> [Plane; BANDS] {
    let loose = apart.is_some_and(|apart| apart.tau > 0.0);
    let of = |i: usize, band: usize| if loose { 1.0 } else { matched.restless[i][band] };
    std::array::from_fn(|band| placed.layout.spread(|i| of(i, band)))
}

fn matched_contrast(run: &Run, placed: &Placed, clips: &[Clip]) -> Match {
    let Run { still, .. } = *run;
    let Options { strength, max_gain, coarse, .. } = *run.options;
    let contrast = |key: &LevelKey| {
        let clip = &clips[placed.sources[key.source].0];
        clip.contrast(key.scale).expect("a clip is studied at every scale it is used at")
    };
    let contrasts: Vec<&Contrast> = placed.layout.levels().iter().map(contrast).collect();
    let bands = std::array::from_fn(|band| if band < FINE { 1.0 } else { coarse });
    let strength = Strength { strength, max_gain, bands };
    match_contrast(&placed.layout, &contrasts, &still.working.luma(), &still.working_matte, &strength)
}

fn matching(options: &Options) -> Matching {
    let &Options { appearance: amount, regions: region, appearance_gain: max_gain, .. } = options;
    Matching { amount, region, max_gain }
}

/// Lets detail finer than a working pixel travel, where that is wanted.
fn drifting(run: &Run, compositor: Compositor, motion: &AssignedMotion) -> Compositor {
    if !run.options.drift {
        return compositor;
    }
    let output = run.scene.settings().output;
    let travel = Travel { motion: &motion.mean, pace: run.pace(), frames: output.length(), fps: output.fps };
    compositor.drifting(&run.still.working, &travel)
}
