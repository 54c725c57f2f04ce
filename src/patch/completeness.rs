//! Bidirectional similarity (Simakov et al. 2008; Wei et al. 2008): every source patch should be found in the target too.

use super::atlas::Place;
use super::level::Level;
use super::nnf::Nnf;
use super::patch_match::{Search, Steps, Sweep};
use crate::base::rng;

/// For every source patch the target patch nearest to it (LazyFluids, Eq. 4), kept from round to round.
#[derive(Debug)]
pub(super) struct Completeness(Nnf);

impl Completeness {
    /// By chance to begin with.
    pub fn new(level: &Level) -> Self {
        Self(Nnf::random(&level.atlas.patches, &level.target, rng::hash(level.seed, &[1])))
    }

    /// Improves it for the present state of the target.
    pub fn search(&mut self, level: &Level, sweeps: usize, round: usize) {
        let steps = level.steps.as_deref().map_or(Steps::Full, Steps::To);
        let search = Search { layout: level.layout, from: &level.atlas.patches, to: &level.target, steps, apart: 0 };
        let reach = level.target.stack.width.max(level.target.stack.height);
        search.evaluate(&mut self.0);
        for number in 0..sweeps {
            let seed = rng::hash(level.seed, &[2, round as u64, number as u64]);
            search.sweep(&mut self.0, Sweep { number, reach, seed });
        }
    }

    /// What the source patches say to the target.
    pub fn votes(&self, targets: usize) -> Votes {
        let mut starts = vec![0u32; targets + 1];
        self.0.assigned().for_each(|(_, cell)| starts[cell.place.index() + 1] += 1);
        (0..targets).for_each(|i| starts[i + 1] += starts[i]);
        let mut next = starts.clone();
        let mut places = vec![Place::NONE; starts[targets] as usize];
        for (source, cell) in self.0.assigned() {
            let slot = &mut next[cell.place.index()];
            places[*slot as usize] = Place(source as u32);
            *slot += 1;
        }
        Votes { starts, places }
    }
}

/// Source patches that vote at a target patch besides its own match.
#[derive(Debug)]
pub(super) struct Votes {
    starts: Vec<u32>,
    places: Vec<Place>,
}

impl Votes {
    /// Those at target pixel `at`.
    pub fn at(&self, at: usize) -> &[Place] {
        &self.places[self.starts[at] as usize..self.starts[at + 1] as usize]
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.places.len()
    }
}
