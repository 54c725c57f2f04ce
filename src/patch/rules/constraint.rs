//! What a rule is.

use crate::patch::data::field::Nnf;
use crate::patch::data::pose::Pose;
use crate::patch::level::Level;
use crate::patch::vote::{Manner, Votes, Voting};

/// A rule at work on one level of one frame.
pub trait Constraint<P: Pose>: Send {
    /// Improves the field for the present state of the target; `round` counts from 0 on every level.
    fn search(&mut self, level: &Level<P>, nnf: &mut Nnf<P>, round: usize);

    /// How patches are voted, where `wished` is what the settings say.
    fn manner(&self, wished: Manner) -> Manner {
        wished
    }

    /// Source patches that vote besides.
    fn votes(&self) -> Option<&Votes> {
        None
    }

    /// What it adds to the energy of the field, in units of squared values at weight 1.
    fn energy(&self, _level: &Level<P>, _nnf: &Nnf<P>) -> f64 {
        0.0
    }

    /// What it has to say on voting.
    fn voting(&self, level: &Level<P>) -> Voting<'_> {
        Voting { manner: self.manner(level.manner), back: self.votes() }
    }
}
