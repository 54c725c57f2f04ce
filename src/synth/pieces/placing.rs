//! The chosen pieces in their places on the picture, and the clips they come from.

use std::collections::BTreeSet;

use super::choice::Choice;
use super::playback::{self, RATES};
use super::run::Run;
use crate::assign::nodes::NodeGrid;
use crate::base::error::Result;
use crate::base::{par, rng};
use crate::library::grid::Cell;
use crate::library::tile::Tile;
use crate::render::layout::{Layout, PlacedCell, Placement};
use crate::scene::asked::Wish;

/// Pieces in their places, and where they come from.
pub struct Placed {
    /// The pieces, each with its source.
    pub layout: Layout,
    /// Per placement: the piece.
    pub choices: Vec<Choice>,
    /// What is asked of each.
    pub wishes: Vec<Wish>,
    /// Every clip that is used, at every rate it is used at.
    pub clips: Vec<PlayedClip>,
    /// Per source of the layout: its clip, as a number within `clips`, and its phase.
    pub sources: Vec<(usize, usize)>,
}

/// A clip at a rate of playback.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct PlayedClip {
    /// Number of its library.
    pub pack: usize,
    /// Number of the clip within its library.
    pub clip: u32,
    /// Number of the rate in [`RATES`].
    pub rate: usize,
}

/// Puts the chosen pieces, one per node, onto their nodes, played as fast as is asked.
///
/// # Errors
/// Damaged packs.
pub fn place(run: &Run, grid: &NodeGrid, choices: &[Choice], wishes: Vec<Wish>) -> Result<Placed> {
    let output = run.scene.settings().output;
    let pack = |c: &Choice| &run.sources.packs[c.pack].1;
    let pieces = choices.iter().map(|c| pack(c).piece(c.piece)).collect::<Result<Vec<_>>>()?;
    let tiles = par::try_map(choices.len(), |i| pack(&choices[i]).tile(choices[i].piece))?;
    let owners: Vec<(usize, u32)> = choices.iter().zip(&pieces).map(|(c, p)| (c.pack, p.clip)).collect();
    let clips: Vec<(usize, u32)> = BTreeSet::from_iter(owners.iter().copied()).into_iter().collect();
    let size = |&(pack, clip): &(usize, u32)| {
        let meta = &run.sources.packs[pack].1.clips()[clip as usize];
        (meta.width as usize, meta.height as usize)
    };
    let placement = |i: usize| Placement {
        node: (grid.nodes[i].x as usize, grid.nodes[i].y as usize),
        source: clips.partition_point(|c| *c < owners[i]),
        variant: pieces[i].variant(),
        piece: (pieces[i].x as usize, pieces[i].y as usize),
        cells: placed_cells(&tiles[i]),
    };
    let mut layout = Layout {
        canvas: run.still.map.working,
        sources: clips.iter().map(size).collect(),
        placements: (0..choices.len()).map(placement).collect(),
    };
    let pace = |i: usize| pack(&choices[i]).parameters().rate as f32 / output.fps;
    let rates = playback::choose(&layout, &wishes, |i| pace(i) * layout.placements[i].motion().1);
    let clips = play_at(&mut layout, &rates, &clips);
    let sources = spread_phases(&mut layout, run.options.phases, output.seed);
    Ok(Placed { layout, choices: choices.to_vec(), wishes, clips, sources })
}

fn placed_cells(tile: &Tile) -> Vec<PlacedCell> {
    let cell = |c: &Cell| PlacedCell {
        mean: (c.mean[0].to_f32(), c.mean[1].to_f32()),
        activity: c.activity.to_f32(),
        significant: c.significant.to_f32(),
    };
    tile.cells.iter().map(cell).collect()
}

/// Plays every placement at its rate: its motion grows with it, and the layout's sources become clips at rates.
fn play_at(layout: &mut Layout, rates: &[usize], clips: &[(usize, u32)]) -> Vec<PlayedClip> {
    for (placement, &rate) in layout.placements.iter_mut().zip(rates) {
        for cell in &mut placement.cells {
            cell.mean = (RATES[rate] * cell.mean.0, RATES[rate] * cell.mean.1);
            cell.activity *= RATES[rate];
        }
    }
    let sources = split_sources(layout, rates.to_vec());
    sources.iter().map(|&(source, rate)| PlayedClip { pack: clips[source].0, clip: clips[source].1, rate }).collect()
}

/// Splits the sources of a layout by a property of the placements; the new sources, in order, as (old source, property).
fn split_sources(layout: &mut Layout, property: Vec<usize>) -> Vec<(usize, usize)> {
    let keys: Vec<_> = layout.placements.iter().map(|p| p.source).zip(property).collect();
    let sources: Vec<_> = BTreeSet::from_iter(keys.iter().copied()).into_iter().collect();
    layout.sources = sources.iter().map(|&(source, _)| layout.sources[source]).collect();
    for (placement, key) in layout.placements.iter_mut().zip(&keys) {
        placement.source = sources.partition_point(|s| s < key);
    }
    sources
}

/// Gives every stretch of continuous footage one of `phases` phases of its clip's loop, so that two copies of a place
/// do not move in unison; the layout's sources become clips at phases, which are returned as (clip, phase).
fn spread_phases(layout: &mut Layout, phases: usize, seed: u64) -> Vec<(usize, usize)> {
    let groups = layout.groups();
    let phase = |group: usize| rng::below(rng::hash(seed, &[group as u64]), phases as u64) as usize;
    let chosen = groups.iter().map(|&group| phase(group)).collect();
    split_sources(layout, chosen)
}
