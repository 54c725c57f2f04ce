//! k-coherence search (Tong et al. 2002, as Han et al. 2006 use it): what neighbours suggest, and what resembles that.

use super::atlas::Place;
use super::distance::Candidate;
use super::level::Level;
use super::nnf::{Cell, Nnf};
use super::patch_match::{Search, Steps, Sweep};
use crate::base::{par, rng};

/// Places that a neighbour suggests: its own moved by a pixel, the source patch that resembles it most, and so on.
const K: usize = 3;
/// Sweeps in which resembling patches are searched.
const SWEEPS: usize = 6;
/// Tries to find one by chance to begin with.
const TRIES: u64 = 16;
/// Pixels that one thread goes through at a time.
const CHUNK: usize = 4096;

/// For every source patch the one that resembles it most and does not overlap it.
#[derive(Debug)]
pub(super) struct Similar(Nnf);

impl Similar {
    /// Searches the source in itself.
    pub fn new(level: &Level) -> Self {
        let patches = &level.atlas.patches;
        let search =
            Search { layout: level.layout, from: patches, to: patches, steps: Steps::Full, apart: level.layout.side() };
        let apart = |i: usize, segment: u8| {
            let chance = |n| patches.any(segment, rng::hash(level.seed, &[i as u64, n]));
            (0..TRIES).filter_map(chance).find(|&place| search.is_apart(i, place as usize)).map(Place)
        };
        let mut nnf = Nnf::from_fn(patches, apart);
        search.evaluate(&mut nnf);
        for number in 0..SWEEPS {
            search
                .sweep(&mut nnf, Sweep { number, reach: level.reach(), seed: rng::hash(level.seed, &[number as u64]) });
        }
        Self(nnf)
    }

    /// Gives every patch the nearest of what its neighbours and itself suggest.
    pub fn sweep(&self, level: &Level, nnf: &mut Nnf) {
        let before = nnf.cells.clone();
        par::for_each_chunk(&mut nnf.cells, CHUNK, |chunk, cells| {
            let mut candidates = Vec::new();
            for (i, cell) in cells.iter_mut().enumerate().filter(|(_, cell)| cell.place != Place::NONE) {
                let target = chunk * CHUNK + i;
                self.suggested(level, &before, target, &mut candidates);
                if let Some((n, distance)) = level.search().nearest(target, &candidates, cell.distance) {
                    *cell = Cell { place: Place(candidates[n].centre), distance };
                }
            }
        });
    }

    fn suggested(&self, level: &Level, before: &[Cell], target: usize, out: &mut Vec<Candidate>) {
        out.clear();
        let (from, to) = (level.target.stack.width as isize, level.atlas.patches.stack.width as isize);
        let segment = level.target.labels()[target];
        for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
            let neighbour = usize::try_from(target as isize + dy * from + dx).ok().and_then(|i| before.get(i));
            let place = neighbour.map_or(Place::NONE, |cell| cell.place);
            if place == Place::NONE {
                continue;
            }
            let mut next = level.atlas.patches.in_segment(place.0 as isize - dy * to - dx, segment);
            for _ in 0..K {
                let Some(centre) = next else { break };
                out.push(Candidate { centre, base: 0, step: level.search().step(target, centre) });
                let similar = self.0.cells[centre as usize].place;
                next = (similar != Place::NONE).then_some(similar.0);
            }
        }
    }
}
