//! How the nearest-neighbour field is constrained: the methods that LazyFluids compares in its Figure 2, on one engine.

use super::coherence::Similar;
use super::completeness::{Completeness, Votes};
use super::exchange::Exchange;
use super::level::Level;
use super::nnf::Nnf;
use super::patch_match::Sweep;
use super::usage::{Bounds, Constraint};
use super::vote::{Manner, Vote};
use crate::base::options::Words;
use crate::base::rng;

/// Half the first window of random places on levels that start from a coarser one, in pixels.
const NEAR: usize = 2;

/// A rule for the nearest-neighbour field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Every target patch takes its nearest source patch (Kwatra et al. 2005; LazyFluids, Eq. 2).
    Plain,
    /// Each takes the nearest of what its neighbours' patches and those that resemble them suggest, and pixels are copied
    /// instead of blended (the discrete solver of Han et al. 2006).
    Coherent,
    /// Source patches vote too, each at the target patch nearest to it (bidirectional similarity: Simakov et al. 2008).
    Bidirectional,
    /// No source patch is used more than twice as often as uniform use would (the occurrence map of Kaspar et al. 2015).
    Occurrence,
    /// Every source patch of a segment is used K or K + 1 times (LazyFluids, Eq. 5), exactly.
    Uniform,
}

impl Words for Rule {
    const ALL: &'static [(&'static str, Self)] = &[
        ("plain", Self::Plain),
        ("coherent", Self::Coherent),
        ("bidirectional", Self::Bidirectional),
        ("occurrence", Self::Occurrence),
        ("uniform", Self::Uniform),
    ];
}

/// A rule at work on one level.
#[derive(Debug)]
pub(super) struct Rules {
    rule: Rule,
    sweeps: usize,
    manner: Manner,
    exchange: Option<Exchange>,
    similar: Option<Similar>,
    completeness: Option<Completeness>,
    back: Option<Votes>,
}

impl Rules {
    /// `manner` is how the rules vote that blend.
    pub fn new(rule: Rule, sweeps: usize, manner: Manner) -> Self {
        let manner = if rule == Rule::Coherent { Manner::Discrete } else { manner };
        Self { rule, sweeps, manner, exchange: None, similar: None, completeness: None, back: None }
    }

    /// Improves the field for the present state of the target.
    pub fn search(&mut self, level: &Level, nnf: &mut Nnf, round: usize) {
        match self.rule {
            Rule::Plain => self.plain(level, nnf, round),
            Rule::Coherent => self.coherent(level, nnf),
            Rule::Bidirectional => {
                self.plain(level, nnf, round);
                let completeness = self.completeness.get_or_insert_with(|| Completeness::new(level));
                completeness.search(level, self.sweeps, round);
                self.back = Some(completeness.votes(nnf.cells.len()));
            }
            Rule::Occurrence => self.bounded(level, nnf, round, Bounds::occurrence),
            Rule::Uniform => self.bounded(level, nnf, round, Bounds::uniform),
        }
    }

    /// Whether pixels are means by weights that do not depend on how well patches fit.
    pub fn blends(&self) -> bool {
        matches!(self.manner, Manner::Mean | Manner::Centred | Manner::Median)
    }

    /// What is voted after a search; before the first one, the mean of the field.
    pub fn vote<'a>(&'a self, level: &'a Level, nnf: &'a Nnf) -> Vote<'a> {
        Vote {
            nnf,
            source: &level.colours,
            radius: level.layout.radius(),
            channels: level.layout.synthesised(),
            manner: self.manner,
            // |X| / |Z|: both directions count alike (Simakov et al. 2008).
            back: self.back.as_ref().map(|b| (b, nnf.assigned().count() as f32 / b.count().max(1) as f32)),
            anchor: level.anchor.as_ref(),
        }
    }

    fn coherent(&mut self, level: &Level, nnf: &mut Nnf) {
        level.search().evaluate(nnf);
        let similar = self.similar.get_or_insert_with(|| Similar::new(level));
        (0..self.sweeps).for_each(|_| similar.sweep(level, nnf));
    }

    fn plain(&self, level: &Level, nnf: &mut Nnf, round: usize) {
        let search = level.search();
        search.evaluate(nnf);
        for number in 0..self.sweeps {
            let seed = rng::hash(level.seed, &[round as u64, number as u64]);
            search.sweep(nnf, Sweep { number, reach: level.reach(), seed });
        }
    }

    /// Keeps the constraint from the first round on, and lowers the energy within it.
    fn bounded(&mut self, level: &Level, nnf: &mut Nnf, round: usize, constraint: Constraint) {
        level.search().evaluate(nnf);
        // Far places are found on the coarsest level; on the others they hardly ever help.
        let reach = if level.coarsest { level.reach() } else { NEAR };
        let exchange = self.exchange.get_or_insert_with(|| Exchange::new(level, nnf, constraint));
        exchange.evaluate(level);
        for number in 0..self.sweeps {
            let seed = rng::hash(level.seed, &[round as u64, number as u64]);
            exchange.sweep(level, nnf, Sweep { number: round * self.sweeps + number, reach, seed });
        }
    }
}
