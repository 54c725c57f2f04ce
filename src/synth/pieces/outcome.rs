//! What is told of a run besides its frames.

use super::assignment_picture::{assignment_picture, colour};
use super::footage::Clip;
use super::legend::with_legend;
use super::pick::{Choices, Labels};
use super::placing::{Placed, PlayedClip};
use super::playback::RATES;
use super::rendering::Rendering;
use super::run::Run;
use crate::base::error::Result;
use crate::flow::draw;
use crate::flow::field::Field;
use crate::raster::image::Plane;
use crate::raster::resample::resize;
use crate::synth::maps::{self, Maps, maps};
use crate::synth::method::Outcome;
use crate::synth::record::{AssignmentRecord, ClipShare, NodeRecord, RunRecord};

/// What is told of a run, from everything it made.
///
/// # Errors
/// Damaged packs.
pub fn outcome(
    run: &Run,
    placed: &Placed,
    clips: &[Clip],
    rendering: &Rendering,
    candidates: &Choices,
    labels: &Labels,
) -> Result<Outcome> {
    let clip_of: Vec<usize> = placed.layout.placements.iter().map(|p| placed.sources[p.source].0).collect();
    let (still, motion) = (run.still, &rendering.motion);
    let shares = shares(run, placed, clips, &clip_of);
    let picture = assignment_picture(&still.working.luma(), &still.working_matte, &placed.layout, &clip_of);
    let picture = with_legend(&picture, &shares);
    let full = |plane: &Plane| resize(plane, still.map.working.0, still.map.working.1);
    let field = Field { u: full(&motion.mean.u), v: full(&motion.mean.v) };
    let Maps { mut pictures, max_speed } =
        maps(motion, run.pace(), still.asked.as_ref(), &still.working_matte, &still.map);
    pictures.extend(rendering.background.iter().map(|made| ("background", made.clone())));
    pictures.extend([("assignment", picture), ("motion", draw::colour(&field, 0.0))]);
    let solution = &labels.solution;
    let assignment = AssignmentRecord {
        energy: solution.energy,
        data_only_energy: solution.history[0],
        data_energy: labels.data_energy,
        bound: solution.bound,
        gap: solution.gap(),
        history: solution.history.clone(),
        bounds: solution.bounds.clone(),
        widened: candidates.widened,
        clips: shares,
        nodes: (0..placed.choices.len()).map(|i| node(run, placed, clip_of[i], i)).collect::<Result<_>>()?,
    };
    let record = RunRecord { assignment: Some(assignment), max_speed: Some(max_speed), ..RunRecord::default() };
    let played = Field { u: field.u.map(|u| run.pace() * u), v: field.v.map(|v| run.pace() * v) };
    Ok(Outcome { record, pictures, arrays: maps::arrays(&played, still.asked.as_ref()) })
}

/// How much of the picture each clip moves, the most first; `clip_of` holds the clip of every node.
fn shares(run: &Run, placed: &Placed, clips: &[Clip], clip_of: &[usize]) -> Vec<ClipShare> {
    let share = |(i, &PlayedClip { pack: library, clip, rate }): (usize, &PlayedClip)| {
        let meta = &run.sources.packs[library].1.clips()[clip as usize];
        let nodes = clip_of.iter().filter(|&&c| c == i).count();
        let segment = clips[i].plan.segments().into_iter().max().unwrap_or(0);
        ClipShare {
            library,
            clip: meta.id.to_string(),
            number: 0,
            name: None,
            tag: meta.tag.clone(),
            colour: colour(i),
            nodes,
            share: nodes as f64 / clip_of.len() as f64,
            rate: RATES[rate],
            loop_frames: (clips[i].plan.start(), clips[i].plan.start() + segment),
            loop_jump: clips[i].plan.worst_jump(),
        }
    };
    let mut shares: Vec<ClipShare> = placed.clips.iter().enumerate().map(share).collect();
    shares.sort_by(|a, b| b.nodes.cmp(&a.nodes).then_with(|| a.clip.cmp(&b.clip)));
    shares.iter_mut().enumerate().for_each(|(i, share)| share.number = i + 1);
    shares
}

/// Node `i`, whose piece comes from clip number `clip` of those that are used.
fn node(run: &Run, placed: &Placed, clip: usize, i: usize) -> Result<NodeRecord> {
    let (placement, choice, wish) = (&placed.layout.placements[i], &placed.choices[i], &placed.wishes[i]);
    let pack = &run.sources.packs[choice.pack].1;
    let pace = pack.parameters().rate as f32 / run.scene.settings().output.fps;
    let (mean, activity) = placement.motion();
    Ok(NodeRecord {
        x: placement.node.0,
        y: placement.node.1,
        library: choice.pack,
        piece: pack.piece_ref(choice.piece)?,
        motion: (pace * mean.0, pace * mean.1),
        activity: pace * activity,
        rate: RATES[placed.clips[clip].rate],
        asked: wish.direction,
        asked_speed: wish.speed,
    })
}
