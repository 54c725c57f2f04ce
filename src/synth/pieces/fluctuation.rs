//! The time-varying part of the pieces' motion, over the picture: what a carried picture sways by.

use std::collections::BTreeMap;

use super::footage::Playing;
use super::placing::Placed;
use crate::flow::field::Field;
use crate::library::variant::{CELL, PIECE_CELLS};
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::render::layout::tent;
use crate::render::sway::Sway;

/// Smoothing, cells: motion wants larger coherent areas than colour, or unrelated neighbours make swirls.
const SMOOTH: f32 = 1.5;
/// Weight of cells that do not move significantly.
const STILL_WEIGHT: f32 = 0.03;

/// One cell of a piece: where it is read, how its motion is turned, and where it goes.
struct Sample {
    /// Place in the clip's flow, cells of it.
    place: (f32, f32),
    cell: usize,
    weight: f32,
}

/// All cells that show the same footage in the same pose.
struct Footage {
    source: usize,
    /// Motion to the right and down on the picture of a motion to the right, and of one down, in the clip.
    turn: [(f32, f32); 2],
    samples: Vec<Sample>,
}

/// Integrates the fluctuation of the placed pieces over the loop of `frames` frames, times `gain`, see
/// [`Sway::integrate`]; `memory` in frames.
pub fn sway(placed: &Placed, playing: &[Playing], frames: usize, gain: f32, memory: f32) -> Sway {
    let size = (placed.layout.canvas.0.div_ceil(CELL), placed.layout.canvas.1.div_ceil(CELL));
    let footage = footage(placed, size);
    Sway::integrate(frames, memory, CELL as f32, |t| {
        let flows: Vec<Field> = playing.iter().map(|playing| playing.fluctuation(t).unwrap_or_default()).collect();
        let mut sum = Field::zeros(size.0, size.1);
        for Footage { source, turn: [right, down], samples } in &footage {
            let flow = &flows[*source];
            for Sample { place, cell, weight } in samples {
                let (u, v) = (flow.u.bilinear(place.0, place.1), flow.v.bilinear(place.0, place.1));
                sum.u.data[*cell] += gain * weight * (right.0 * u + down.0 * v);
                sum.v.data[*cell] += gain * weight * (right.1 * u + down.1 * v);
            }
        }
        Field { u: gaussian(&sum.u, SMOOTH), v: gaussian(&sum.v, SMOOTH) }
    })
}

/// The cells of all pieces with their weights. Within continuous footage weights add up to 1; between unrelated footage
/// their squares do, so that the sum fluctuates as much as its parts.
fn footage(placed: &Placed, (width, height): (usize, usize)) -> Vec<Footage> {
    let layout = &placed.layout;
    let mut all: BTreeMap<usize, Footage> = BTreeMap::new();
    for (placement, group) in layout.placements.iter().zip(layout.groups()) {
        let geometry = layout.geometry(placement);
        let factor = placement.variant.scale_factor();
        let turned = |u: f32, v: f32| geometry.vector_from_level(factor * u, factor * v);
        let footage = all.entry(group).or_insert_with(|| Footage {
            source: placement.source,
            turn: [turned(1.0, 0.0), turned(0.0, 1.0)],
            samples: Vec::new(),
        });
        for (k, own) in placement.cells.iter().enumerate() {
            let (cx, cy) = (k % PIECE_CELLS, k / PIECE_CELLS);
            let (x, y) = (placement.node.0 / CELL + cx, placement.node.1 / CELL + cy);
            if x < width && y < height {
                let centre = |corner: usize, cell: usize| (corner + cell * CELL) as f32 + 0.5 * CELL as f32;
                let (px, py) = geometry.to_level(centre(placement.piece.0, cx), centre(placement.piece.1, cy));
                let scale = 1.0 / (factor * CELL as f32);
                let weight = tent(cx) * tent(cy) * own.significant.max(STILL_WEIGHT);
                footage.samples.push(Sample { place: (px * scale, py * scale), cell: y * width + x, weight });
            }
        }
    }
    let mut all: Vec<Footage> = all.into_values().collect();
    let mut squares = Plane::zeros(width, height);
    let mut sums = Plane::zeros(width, height);
    for Footage { samples, .. } in &all {
        samples.iter().for_each(|s| sums.data[s.cell] += s.weight);
        samples.iter().for_each(|s| squares.data[s.cell] += std::mem::take(&mut sums.data[s.cell]).powi(2));
    }
    let samples = all.iter_mut().flat_map(|footage| &mut footage.samples);
    samples.for_each(|s| s.weight /= squares.data[s.cell].sqrt().max(1e-6));
    all
}
