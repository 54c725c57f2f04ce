//! How fast the pieces' texture travels, where optical flow sees next to nothing: in whitewater.

use std::collections::BTreeSet;

use super::placing::Placed;
use super::playback::RATES;
use super::run::Run;
use crate::base::error::Result;
use crate::base::observe::{self, stage};
use crate::base::par;
use crate::flow::field::Field;
use crate::library::texture_motion::TextureMotion;
use crate::library::variant::PIECE;
use crate::render::recover::AssignedMotion;

/// The motion of all pieces as their texture travels, over the working image: pixels per library frame, on cells.
///
/// # Errors
/// A damaged pack, a cancel.
pub fn measure(run: &Run, placed: &Placed) -> Result<AssignedMotion> {
    let clips: BTreeSet<(usize, u32)> = placed.clips.iter().map(|f| (f.pack, f.clip)).collect();
    let clips: Vec<(usize, u32)> = clips.into_iter().collect();
    let textures = stage(run.observer, "speeds", clips.len() as u64, || {
        par::try_map(clips.len(), |i| {
            observe::check(run.observer)?;
            TextureMotion::read(&run.sources.packs[clips[i].0].1, clips[i].1)
        })
    })?;
    let motions = par::map(placed.choices.len(), |i| {
        let footage = &placed.clips[placed.sources[placed.layout.placements[i].source].0];
        let place = clips.partition_point(|c| *c < (footage.pack, footage.clip));
        motion(placed, i, &textures[place], RATES[footage.rate])
    });
    let spread = |of: fn((f32, f32)) -> f32| placed.layout.spread(|i| of(motions[i]));
    Ok(AssignedMotion { mean: Field { u: spread(|m| m.0), v: spread(|m| m.1) }, activity: spread(|m| m.0.hypot(m.1)) })
}

/// Motion of piece `i` on the working image, played at `rate`.
fn motion(placed: &Placed, i: usize, texture: &TextureMotion, rate: f32) -> (f32, f32) {
    let placement = &placed.layout.placements[i];
    let geometry = placed.layout.geometry(placement);
    let centre = |v: usize| v as f32 + 0.5 * PIECE as f32;
    let (x, y) = geometry.to_level(centre(placement.piece.0), centre(placement.piece.1));
    let factor = placement.variant.scale_factor();
    match texture.at(x / factor, y / factor) {
        Some((u, v)) => geometry.vector_from_level(factor * rate * u, factor * rate * v),
        // Its optical flow holds then.
        None => placement.motion().0,
    }
}
