//! How the nearest-neighbour field is constrained: the methods that LazyFluids compares in its Figure 2, on one engine.

use super::engine::Level;
use super::nnf::Nnf;
use super::patch_match::Sweep;
use crate::base::options::Words;
use crate::base::rng;

/// A rule for the nearest-neighbour field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Every target patch takes its nearest source patch (Kwatra et al. 2005; LazyFluids, Eq. 2).
    Plain,
}

impl Words for Rule {
    const ALL: &'static [(&'static str, Self)] = &[("plain", Self::Plain)];
}

/// A rule at work on one level.
#[derive(Debug)]
pub(super) struct Rules {
    rule: Rule,
    sweeps: usize,
}

impl Rules {
    pub fn new(rule: Rule, sweeps: usize) -> Self {
        Self { rule, sweeps }
    }

    /// Improves the field for the present state of the target.
    pub fn search(&mut self, level: &Level, nnf: &mut Nnf, round: usize) {
        match self.rule {
            Rule::Plain => self.plain(level, nnf, round),
        }
    }

    fn plain(&self, level: &Level, nnf: &mut Nnf, round: usize) {
        let search = level.search();
        search.evaluate(nnf);
        for number in 0..self.sweeps {
            let seed = rng::hash(level.seed, &[round as u64, number as u64]);
            search.sweep(nnf, Sweep { number, reach: level.reach(), seed });
        }
    }
}
