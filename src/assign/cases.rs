//! Random problems for tests, and their least energy by trying every labelling.

use super::energy::Problem;
use super::pair_costs::PairCosts;
use crate::base::rng;

pub(crate) struct Case {
    pub(crate) offsets: Vec<usize>,
    pub(crate) data: Vec<f32>,
    pub(crate) pairs: PairCosts,
}

impl Case {
    /// A grid of `columns` × `rows` nodes with 1 to `most` candidates each.
    pub(crate) fn grid(columns: usize, rows: usize, most: u64, seed: u64) -> Self {
        let n = columns * rows;
        let right = (0..n).filter(|i| i % columns + 1 < columns).map(|i| [i as u32, i as u32 + 1]);
        let down = (0..n - columns).map(|i| [i as u32, (i + columns) as u32]);
        Self::new(n, right.chain(down).collect(), most, seed)
    }

    /// A tree of `n` nodes, whose edges run either way.
    pub(crate) fn tree(n: usize, most: u64, seed: u64) -> Self {
        let parent = |i: usize| rng::below(rng::hash(seed, &[7, i as u64]), i as u64) as u32;
        let edge = |i: usize| if i.is_multiple_of(3) { [i as u32, parent(i)] } else { [parent(i), i as u32] };
        Self::new(n, (1..n).map(edge).collect(), most, seed)
    }

    fn new(n: usize, edges: Vec<[u32; 2]>, most: u64, seed: u64) -> Self {
        let counts: Vec<usize> = (0..n).map(|i| 1 + rng::below(rng::hash(seed, &[i as u64]), most) as usize).collect();
        let offsets: Vec<usize> = (0..=n).map(|i| counts[..i].iter().sum()).collect();
        let random = |k: u64, i: usize| rng::unit(rng::hash(seed, &[k, i as u64]));
        let mut end = 0;
        let table = |&[a, b]: &[u32; 2]| {
            end += counts[a as usize] * counts[b as usize];
            end - counts[a as usize] * counts[b as usize]..end
        };
        let tables = edges.iter().map(table).collect();
        let costs = (0..end).map(|i| 5.0 * random(3, i).powi(3)).collect();
        Self {
            data: (0..offsets[n]).map(|i| random(2, i)).collect(),
            offsets,
            pairs: PairCosts { edges, tables, costs },
        }
    }

    pub(crate) fn problem(&self, lambda: f32) -> Problem<'_> {
        Problem { offsets: &self.offsets, data: &self.data, pairs: &self.pairs, lambda }
    }

    /// Some labels.
    pub(crate) fn labels(&self, seed: u64) -> Vec<u32> {
        let label = |n: &[usize]| rng::below(rng::hash(seed, &[9, n[0] as u64]), (n[1] - n[0]) as u64) as u32;
        self.offsets.windows(2).map(label).collect()
    }
}

/// The least energy of all labellings.
pub(crate) fn brute_force(problem: &Problem) -> f64 {
    let mut labels = vec![0; problem.nodes()];
    let mut best = f64::INFINITY;
    loop {
        best = best.min(problem.energy(&labels));
        let more = |&i: &usize| labels[i] as usize + 1 < problem.labels_of(i);
        let Some(place) = (0..labels.len()).find(more) else { return best };
        labels[place] += 1;
        labels[..place].fill(0);
    }
}
