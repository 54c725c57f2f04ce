//! How fast the pieces' texture travels, where optical flow sees next to nothing: in whitewater.

use std::collections::BTreeSet;

use super::placing::Placed;
use super::playback::RATES;
use super::run::Run;
use crate::base::error::Result;
use crate::base::observe::{self, stage};
use crate::base::par;
use crate::flow::ensemble::shift;
use crate::flow::field::Field;
use crate::library::reader::Pack;
use crate::library::variant::PIECE;
use crate::raster::image::Plane;
use crate::raster::pyramid::{collapse, laplacian, reduce};
use crate::render::recover::AssignedMotion;

/// Frames of a clip that are looked at.
const FRAMES: usize = 25;
/// Window that is followed and how far, pixels of the halved frame.
const SIDE: usize = 32;
const REACH: usize = 8;
/// Bands of the halved frame that are followed: coarser forms are light and shade.
const BANDS: usize = 3;
/// Less resemblance than this is chance; the piece's optical flow holds then.
const SURE: f32 = 0.2;

/// The motion of all pieces as their texture travels, over the working image: pixels per library frame, on cells.
///
/// # Errors
/// A damaged pack, a cancel.
pub fn measure(run: &Run, placed: &Placed) -> Result<AssignedMotion> {
    let clips: BTreeSet<(usize, u32)> = placed.clips.iter().map(|f| (f.pack, f.clip)).collect();
    let clips: Vec<(usize, u32)> = clips.into_iter().collect();
    let frames = stage(run.observer, "speeds", clips.len() as u64, || {
        par::try_map(clips.len(), |i| {
            observe::check(run.observer)?;
            changes(&run.sources.packs[clips[i].0].1, clips[i].1)
        })
    })?;
    let motions = par::map(placed.choices.len(), |i| {
        let footage = &placed.clips[placed.sources[placed.layout.placements[i].source].0];
        let place = clips.partition_point(|c| *c < (footage.pack, footage.clip));
        motion(placed, i, &frames[place], RATES[footage.rate])
    });
    let spread = |of: fn((f32, f32)) -> f32| placed.layout.spread(|i| of(motions[i]));
    Ok(AssignedMotion { mean: Field { u: spread(|m| m.0), v: spread(|m| m.1) }, activity: spread(|m| m.0.hypot(m.1)) })
}

/// What changes in a clip, at half its size: its first frames without their average and without coarse forms.
fn changes(pack: &Pack, clip: u32) -> Result<Vec<Plane>> {
    let count = (pack.clips()[clip as usize].frames as usize).min(FRAMES);
    let mut reader = pack.frames(clip)?;
    let mut frames = Vec::with_capacity(count);
    for t in 0..count {
        frames.push(collapse(&laplacian(&reduce(&reader.luma_at(t)?), BANDS).0, None));
    }
    let mut mean = Plane::zeros(frames[0].width, frames[0].height);
    let share = 1.0 / count as f32;
    frames.iter().for_each(|f| mean.data.iter_mut().zip(&f.data).for_each(|(m, v)| *m += share * v));
    frames.iter_mut().for_each(|f| f.data.iter_mut().zip(&mean.data).for_each(|(v, m)| *v -= m));
    Ok(frames)
}

/// Motion of piece `i` on the working image, played at `rate`.
fn motion(placed: &Placed, i: usize, frames: &[Plane], rate: f32) -> (f32, f32) {
    let placement = &placed.layout.placements[i];
    let geometry = placed.layout.geometry(placement);
    let centre = |v: usize| v as f32 + 0.5 * PIECE as f32;
    let (x, y) = geometry.to_level(centre(placement.piece.0), centre(placement.piece.1));
    let factor = placement.variant.scale_factor();
    match shift(frames, (0.5 * x / factor, 0.5 * y / factor), SIDE, REACH) {
        Some(shift) if shift.correlation >= SURE => {
            let scale = 2.0 * factor * rate;
            geometry.vector_from_level(scale * shift.motion.0, scale * shift.motion.1)
        }
        _ => placement.motion().0,
    }
}
