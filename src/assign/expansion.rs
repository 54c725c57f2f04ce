//! Expansion moves (Boykov, Veksler & Zabih 2001) where every node has labels of its own.
//!
//! Label k means another piece at every node. So two kinds of moves are made: candidate k of every node, and one footage
//! at one offset wherever it is a candidate: its pieces continue each other at no cost.

use super::energy::Problem;
use super::fusion::{Fusion, Proposal};
use crate::base::error::Result;
use crate::base::observe::{self, Observer};

/// The moves of a round.
pub struct Moves {
    /// Most candidates that a node has.
    candidates: u32,
    /// Number of candidates of every node.
    counts: Vec<u32>,
    /// Proposals of group after group.
    grouped: Vec<Proposal>,
    /// Group `g` has `starts[g]..starts[g + 1]`.
    starts: Vec<usize>,
}

/// Group moves between two checks for a cancel.
const BATCH: usize = 256;

impl Moves {
    /// The moves for `problem`. Candidates with the same number in `groups` are proposed together; it may be empty.
    pub fn new(problem: &Problem, groups: &[u32]) -> Self {
        let counts: Vec<u32> = (0..problem.nodes()).map(|n| problem.labels_of(n) as u32).collect();
        let all = (0..).zip(&counts).flat_map(|(node, &n)| (0..n).map(move |label| Proposal { node, label }));
        let mut numbered: Vec<(u32, Proposal)> = groups.iter().copied().zip(all).collect();
        // Stable, so within a group nodes stay in order; a node's second entry of a group would not fit in one move.
        numbered.sort_by_key(|entry| entry.0);
        numbered.dedup_by_key(|entry| (entry.0, entry.1.node));
        let (mut grouped, mut starts) = (Vec::new(), vec![0]);
        // A single change of label is no move of its own: one of candidate k includes it.
        for group in numbered.chunk_by(|a, b| a.0 == b.0).filter(|group| group.len() > 1) {
            grouped.extend(group.iter().map(|entry| entry.1));
            starts.push(grouped.len());
        }
        Self { candidates: counts.iter().copied().max().unwrap_or(0), counts, grouped, starts }
    }

    /// Makes every move once. Gives what the energy lost.
    ///
    /// # Errors
    /// After a cancel.
    pub fn round(&self, fusion: &mut Fusion, labels: &mut [u32], observer: &dyn Observer) -> Result<f64> {
        let mut gain = 0.0;
        for (g, range) in self.starts.windows(2).enumerate() {
            if g % BATCH == 0 {
                observe::check(observer)?;
            }
            gain += fusion.fuse(labels, self.grouped[range[0]..range[1]].iter().copied());
        }
        for label in 0..self.candidates {
            observe::check(observer)?;
            let having = (0..).zip(&self.counts).filter(|(_, count)| label < **count);
            gain += fusion.fuse(labels, having.map(|(node, _)| Proposal { node, label }));
        }
        Ok(gain)
    }
}
