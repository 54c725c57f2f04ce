//! Every target patch takes its nearest source patch (Kwatra et al. 2005; LazyFluids 2015, Eq. 2).

use super::constraint::Constraint;
use crate::base::rng;
use crate::patch::data::field::Nnf;
use crate::patch::data::pose::Pose;
use crate::patch::level::Level;
use crate::patch::patch_match::Sweep;

/// The rule that binds nothing.
#[derive(Debug, Clone, Copy)]
pub struct Plain {
    /// Sweeps of the search in a round.
    pub sweeps: usize,
    /// Half the first window of random places on levels that start from a coarser one, pixels; the whole source without it.
    pub near: Option<usize>,
}

impl<P: Pose> Constraint<P> for Plain {
    fn search(&mut self, level: &Level<P>, nnf: &mut Nnf<P>, round: usize) {
        let search = level.search();
        search.evaluate(nnf);
        let reach = self.near.filter(|_| !level.coarsest).unwrap_or_else(|| level.reach());
        for number in 0..self.sweeps {
            let seed = rng::hash(level.seed, &[round as u64, number as u64]);
            search.sweep(nnf, Sweep { number, reach, seed });
        }
    }
}
