//! Bidirectional similarity (Simakov et al. 2008; Wei et al. 2008): every source patch should be found in the target too.

use super::constraint::Constraint;
use super::plain::Plain;
use crate::base::rng;
use crate::patch::data::field::Nnf;
use crate::patch::data::pose::Upright;
use crate::patch::level::Level;
use crate::patch::patch_match::{Search, Steps, Sweep};
use crate::patch::vote::Votes;

/// Source patches vote too, each at the target patch nearest to it.
#[derive(Debug)]
pub(super) struct Bidirectional {
    sweeps: usize,
    /// For every source patch the target patch nearest to it (LazyFluids, Eq. 4), kept from round to round.
    completeness: Option<Nnf>,
    votes: Option<Votes>,
}

impl Bidirectional {
    /// With so many sweeps a round, in each direction.
    pub fn new(sweeps: usize) -> Self {
        Self { sweeps, completeness: None, votes: None }
    }

    /// Searches from source to target for the present state of the target.
    fn complete(&mut self, level: &Level, round: usize) -> &Nnf {
        let steps = level.steps.as_deref().map_or(Steps::Full, Steps::To);
        let search = Search { steps, ..Search::plain(level.layout, &*level.source, &level.target) };
        let reach = level.target.stack.width.max(level.target.stack.height);
        let by_chance = || Nnf::random(&level.source, &level.target, rng::hash(level.seed, &[1]));
        let found = self.completeness.get_or_insert_with(by_chance);
        search.evaluate(found);
        for number in 0..self.sweeps {
            let seed = rng::hash(level.seed, &[2, round as u64, number as u64]);
            search.sweep(found, Sweep { number, reach, seed });
        }
        found
    }
}

impl Constraint<Upright> for Bidirectional {
    fn search(&mut self, level: &Level, nnf: &mut Nnf, round: usize) {
        Plain { sweeps: self.sweeps, near: None }.search(level, nnf, round);
        let votes = Votes::new(self.complete(level, round), nnf.cells.len());
        self.votes = Some(votes);
    }

    fn votes(&self) -> Option<&Votes> {
        self.votes.as_ref()
    }
}
