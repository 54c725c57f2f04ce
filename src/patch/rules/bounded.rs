//! Source patches are used no more and no less often than bounds say: uniform use (LazyFluids 2015, §4.1), or an occurrence
//! map (Kaspar et al. 2015).

use super::constraint::Constraint;
use super::exchange::Exchange;
use super::usage::BoundsOf;
use crate::base::rng;
use crate::patch::data::field::Nnf;
use crate::patch::data::pose::Upright;
use crate::patch::level::Level;
use crate::patch::patch_match::Sweep;

/// Half the first window of random places on levels that start from a coarser one, in pixels.
const NEAR: usize = 2;

/// Keeps bounds from the first round on, and lowers the energy within them.
#[derive(Debug)]
pub(super) struct Bounded {
    sweeps: usize,
    bounds: BoundsOf,
    exchange: Option<Exchange>,
}

impl Bounded {
    /// With the bounds of a segment by its sizes.
    pub fn new(sweeps: usize, bounds: BoundsOf) -> Self {
        Self { sweeps, bounds, exchange: None }
    }
}

impl Constraint<Upright> for Bounded {
    fn search(&mut self, level: &Level, nnf: &mut Nnf, round: usize) {
        level.search().evaluate(nnf);
        // Far places are found on the coarsest level; on the others they hardly ever help.
        let reach = if level.coarsest { level.reach() } else { NEAR };
        let exchange = self.exchange.get_or_insert_with(|| Exchange::new(level, nnf, self.bounds));
        exchange.evaluate(level);
        for number in 0..self.sweeps {
            let seed = rng::hash(level.seed, &[round as u64, number as u64]);
            exchange.sweep(level, nnf, Sweep { number: round * self.sweeps + number, reach, seed });
        }
    }
}
