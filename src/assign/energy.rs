//! The energy of an assignment, `E(l) = Σ_p V_p(l_p) + λ Σ_(p,q) W_pq(l_p, l_q)` (Okabe et al. 2011, §5.3).

use super::pair_costs::PairCosts;

/// What is minimised. A label is the number of a candidate within its node.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// Node `n` has candidates `offsets[n]..offsets[n + 1]`, at least one.
    pub offsets: &'a [usize],
    /// Data term V of every candidate, finite.
    pub data: &'a [f32],
    /// Smoothness term W of every pair of neighbouring candidates, finite.
    pub pairs: &'a PairCosts,
    /// Weight λ of the smoothness term, ≥ 0.
    pub lambda: f32,
}

/// An edge as one of its nodes sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Link {
    /// Number of the edge.
    pub edge: usize,
    /// The node at its other end.
    pub other: usize,
    /// True when the node is the edge's first, whose labels are the rows of its table.
    pub first: bool,
}

/// The edges of every node, by number of the edge.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Links {
    starts: Vec<usize>,
    links: Vec<Link>,
}

impl Links {
    /// Those of `node`.
    pub fn of(&self, node: usize) -> &[Link] {
        &self.links[self.starts[node]..self.starts[node + 1]]
    }
}

impl Problem<'_> {
    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Number of candidates of `node`.
    pub fn labels_of(&self, node: usize) -> usize {
        self.offsets[node + 1] - self.offsets[node]
    }

    /// Data terms of the candidates of `node`.
    pub fn data_of(&self, node: usize) -> &[f32] {
        &self.data[self.offsets[node]..self.offsets[node + 1]]
    }

    /// Smoothness term, without λ, of edge `e` for a label of its first node and one of its second.
    pub fn pair(&self, e: usize, first: u32, second: u32) -> f32 {
        let columns = self.labels_of(self.pairs.edges[e][1] as usize);
        self.pairs.of(e)[first as usize * columns + second as usize]
    }

    /// The edges of every node.
    pub fn links(&self) -> Links {
        let mut starts = vec![0; self.nodes() + 1];
        self.pairs.edges.iter().flatten().for_each(|&n| starts[n as usize + 1] += 1);
        (1..starts.len()).for_each(|n| starts[n] += starts[n - 1]);
        let mut next = starts.clone();
        let mut links = vec![Link { edge: 0, other: 0, first: false }; 2 * self.pairs.edges.len()];
        for (edge, &[a, b]) in self.pairs.edges.iter().enumerate() {
            for (node, other, first) in [(a, b, true), (b, a, false)] {
                links[next[node as usize]] = Link { edge, other: other as usize, first };
                next[node as usize] += 1;
            }
        }
        Links { starts, links }
    }

    /// Data terms of the labels, summed.
    pub fn data_energy(&self, labels: &[u32]) -> f64 {
        (0..self.nodes()).map(|n| f64::from(self.data_of(n)[labels[n] as usize])).sum()
    }

    /// Smoothness terms of the labels, summed, without λ.
    pub fn pair_energy(&self, labels: &[u32]) -> f64 {
        let cost = |(e, &[a, b]): (usize, &[u32; 2])| f64::from(self.pair(e, labels[a as usize], labels[b as usize]));
        self.pairs.edges.iter().enumerate().map(cost).sum()
    }

    /// Energy of the labels.
    pub fn energy(&self, labels: &[u32]) -> f64 {
        self.data_energy(labels) + f64::from(self.lambda) * self.pair_energy(labels)
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
