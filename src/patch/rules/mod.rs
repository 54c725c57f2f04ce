//! How the nearest-neighbour field is constrained: a file a rule, behind one trait. [`Rule`] names those that LazyFluids
//! compares in its Figure 2.

mod bidirectional;
mod bounded;
mod chains;
mod coherence;
mod constraint;
mod exchange;
mod holder;
mod leftovers;
mod occurrence;
mod plain;
mod usage;

pub use constraint::Constraint;
pub use occurrence::{Occurrence, Penalty};
pub use plain::Plain;

use super::data::pose::Upright;
use crate::base::options::Words;
use bidirectional::Bidirectional;
use bounded::Bounded;
use coherence::Coherent;
use usage::Bounds;

/// A rule for the nearest-neighbour field of upright patches.
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

impl Rule {
    /// The rule with so many sweeps a round.
    pub(super) fn constraint(self, sweeps: usize) -> Box<dyn Constraint<Upright>> {
        match self {
            Self::Plain => Box::new(Plain { sweeps, near: None }),
            Self::Coherent => Box::new(Coherent::new(sweeps)),
            Self::Bidirectional => Box::new(Bidirectional::new(sweeps)),
            Self::Occurrence => Box::new(Bounded::new(sweeps, Bounds::occurrence)),
            Self::Uniform => Box::new(Bounded::new(sweeps, Bounds::uniform)),
        }
    }

    /// Bytes that it takes beside the field, for so many pixels of the target and of the source.
    pub fn bytes(self, targets: usize, sources: usize) -> usize {
        match self {
            Self::Plain => 0,
            Self::Coherent => size_of::<super::data::field::Cell>() * sources,
            Self::Bidirectional => (size_of::<super::data::field::Cell>() + size_of::<u32>()) * sources + 4 * targets,
            Self::Occurrence | Self::Uniform => exchange::Exchange::bytes(targets, sources),
        }
    }
}
