//! k-coherence search (Tong et al. 2002, as Han et al. 2006 use it): what neighbours suggest, and what resembles that.

use super::constraint::Constraint;
use crate::base::{par, rng};
use crate::patch::data::field::{Cell, Nnf};
use crate::patch::data::patches::Place;
use crate::patch::data::pose::Upright;
use crate::patch::distance::Candidate;
use crate::patch::level::Level;
use crate::patch::patch_match::{Scratch, Search, Sweep};
use crate::patch::vote::Manner;

/// Places that a neighbour suggests: its own moved by a pixel, the source patch that resembles it most, and so on.
const K: usize = 3;
/// Sweeps in which resembling patches are searched.
const SWEEPS: usize = 6;
/// Tries to find one by chance to begin with.
const TRIES: u64 = 16;
/// Pixels that one thread goes through at a time.
const CHUNK: usize = 4096;

/// Each patch takes the nearest of what its neighbours and itself suggest.
#[derive(Debug)]
pub(super) struct Coherent {
    sweeps: usize,
    similar: Option<Similar>,
}

impl Coherent {
    /// With so many sweeps a round.
    pub fn new(sweeps: usize) -> Self {
        Self { sweeps, similar: None }
    }
}

impl Constraint<Upright> for Coherent {
    fn search(&mut self, level: &Level, nnf: &mut Nnf, _round: usize) {
        level.search().evaluate(nnf);
        let similar = self.similar.get_or_insert_with(|| Similar::new(level));
        (0..self.sweeps).for_each(|_| similar.sweep(level, nnf));
    }

    /// Nothing is blended, whatever is wished.
    fn manner(&self, _wished: Manner) -> Manner {
        Manner::Discrete
    }
}

/// For every source patch the one that resembles it most and does not overlap it.
#[derive(Debug)]
struct Similar(Nnf);

impl Similar {
    /// Searches the source in itself.
    fn new(level: &Level) -> Self {
        let patches = &*level.source;
        let search: Search = Search { apart: level.layout.side(), ..Search::plain(level.layout, patches, patches) };
        let apart = |i: usize, segment: u8| {
            let chance = |n| patches.any(segment, rng::hash(level.seed, &[i as u64, n]));
            (0..TRIES)
                .filter_map(chance)
                .find(|&place| search.is_apart(i, place as usize))
                .map(|place| (Place(place), Upright))
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
    fn sweep(&self, level: &Level, nnf: &mut Nnf) {
        let before = nnf.cells.clone();
        par::for_each_chunk(&mut nnf.cells, CHUNK, |chunk, cells| {
            let (mut candidates, mut scratch) = (Vec::new(), Scratch::default());
            for (i, cell) in cells.iter_mut().enumerate().filter(|(_, cell)| cell.place != Place::NONE) {
                let target = chunk * CHUNK + i;
                self.suggested(level, &before, target, &mut candidates);
                let found = level.search().nearest(target, &candidates, cell.distance, &mut scratch);
                if let Some((n, distance)) = found {
                    *cell = Cell::new(Place(candidates[n].centre), distance);
                }
            }
        });
    }

    fn suggested(&self, level: &Level, before: &[Cell], target: usize, out: &mut Vec<Candidate>) {
        out.clear();
        let segment = level.target.labels()[target];
        for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
            let neighbour = level.target.pixel_beside(target, (dx, dy)).map(|i| before[i]);
            let place = neighbour.map_or(Place::NONE, |cell| cell.place);
            if place == Place::NONE {
                continue;
            }
            let mut next = level.source.beside(place.0, (-dx, -dy), segment);
            for _ in 0..K {
                let Some(centre) = next else { break };
                out.push(Candidate { centre, base: 0, step: level.search().step(target, centre), pose: Upright });
                let similar = self.0.cells[centre as usize].place;
                next = (similar != Place::NONE).then_some(similar.0);
            }
        }
    }
}
