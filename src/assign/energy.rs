//! The energy of an assignment, `E(l) = Σ_p V_p(l_p) + λ Σ_(p,q) W_pq(l_p, l_q)` (Okabe et al. 2011, §5.3).

use super::pair_costs::PairCosts;

/// What is minimised. A label is the number of a candidate within its node.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// Node `n` has candidates `offsets[n]..offsets[n + 1]`, at least one.
    pub offsets: &'a [usize],
    /// Data term V of every candidate.
    pub data: &'a [f32],
    /// Smoothness term W of every pair of neighbouring candidates.
    pub pairs: &'a PairCosts,
    /// Weight λ of the smoothness term, ≥ 0.
    pub lambda: f32,
}

/// Labels, and how good they are.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Solution {
    /// Per node: the number of its candidate, from 0.
    pub labels: Vec<u32>,
    /// Energy of the labels.
    pub energy: f64,
    /// No labels have less energy than this.
    pub bound: f64,
    /// Energy at the start and after each sweep; never rises.
    pub history: Vec<f64>,
}

impl Problem<'_> {
    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Data terms of the candidates of `node`.
    pub fn data_of(&self, node: usize) -> &[f32] {
        &self.data[self.offsets[node]..self.offsets[node + 1]]
    }

    /// Data terms of the labels, summed.
    pub fn data_energy(&self, labels: &[u32]) -> f64 {
        (0..self.nodes()).map(|n| f64::from(self.data_of(n)[labels[n] as usize])).sum()
    }

    /// Smoothness terms of the labels, summed, without λ.
    pub fn pair_energy(&self, labels: &[u32]) -> f64 {
        let cost = |(e, &[a, b]): (usize, &[u32; 2])| {
            let columns = self.data_of(b as usize).len();
            f64::from(self.pairs.of(e)[labels[a as usize] as usize * columns + labels[b as usize] as usize])
        };
        self.pairs.edges.iter().enumerate().map(cost).sum()
    }

    /// Energy of the labels.
    pub fn energy(&self, labels: &[u32]) -> f64 {
        self.data_energy(labels) + f64::from(self.lambda) * self.pair_energy(labels)
    }

    /// A bound below every energy: each term at its own minimum.
    pub fn bound(&self) -> f64 {
        let least = |values: &[f32]| f64::from(values.iter().copied().fold(f32::INFINITY, f32::min));
        let data: f64 = (0..self.nodes()).map(|n| least(self.data_of(n))).sum();
        let pairs: f64 = (0..self.pairs.edges.len()).map(|e| least(self.pairs.of(e))).sum();
        data + f64::from(self.lambda) * pairs
    }

    /// The labels of least data term; ties take the first.
    pub fn data_only(&self) -> Vec<u32> {
        (0..self.nodes()).map(|n| argmin(self.data_of(n).iter().map(|&v| f64::from(v))).0 as u32).collect()
    }
}

/// Place and value of the least element, the first of equals.
pub(super) fn argmin(values: impl Iterator<Item = f64>) -> (usize, f64) {
    values.enumerate().fold((0, f64::INFINITY), |best, (i, v)| if v < best.1 { (i, v) } else { best })
}
