//! Fusion moves: of two labellings, each node takes the label of one or the other so that the energy falls (Lempitsky
//! et al. 2010). Which one is found by cuts (Boykov, Veksler & Zabih 2001).
//!
//! Costs of pairs are no metric, so one cut need not be the best move. Then the nodes are settled first that can be, and
//! for the others terms are truncated ([`super::binary`]). A move is made only when the true energy falls.

use super::binary::{Binary, Pair};
use super::energy::{Links, Problem};

/// A move must gain more than this, so that rounding can neither raise the energy nor make it cycle.
pub(super) const LEAST_GAIN: f64 = 1e-9;
/// The largest term is this much in whole numbers.
const RESOLUTION: f64 = (1u64 << 40) as f64;
const OUTSIDE: u32 = u32::MAX;

/// A node and the label that is proposed for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Proposal {
    /// The node.
    pub node: u32,
    /// The label.
    pub label: u32,
}

/// Makes moves on one problem.
pub struct Fusion<'a> {
    problem: &'a Problem<'a>,
    links: Links,
    binary: Binary,
    /// Whole numbers per unit of energy.
    scale: f64,
    /// Per node: its place in the move.
    place: Vec<u32>,
    members: Vec<Proposal>,
}

impl<'a> Fusion<'a> {
    /// For moves on `problem`.
    pub fn new(problem: &'a Problem<'a>) -> Self {
        let largest = |values: &[f32]| values.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        let most =
            f64::from(largest(problem.data)) + f64::from(problem.lambda) * f64::from(largest(&problem.pairs.costs));
        Self {
            problem,
            links: problem.links(),
            binary: Binary::default(),
            scale: RESOLUTION / most.max(f64::MIN_POSITIVE),
            place: vec![OUTSIDE; problem.nodes()],
            members: Vec::new(),
        }
    }

    /// Takes over those of the proposed labels that together lower the energy; at most one label may be proposed for a
    /// node. Gives what the energy lost, ≥ 0.
    pub fn fuse(&mut self, labels: &mut [u32], proposals: impl Iterator<Item = Proposal>) -> f64 {
        self.members.clear();
        self.members.extend(proposals.filter(|p| labels[p.node as usize] != p.label));
        if self.members.is_empty() {
            return 0.0;
        }
        self.build(labels);
        let mut gain = 0.0;
        if !self.binary.cut_is_exact() {
            let value = self.binary.persistent();
            let open = numbered(&self.members).filter(|m| value(m.0).is_none()).map(|m| m.1).collect();
            let taken = numbered(&self.members).filter(|m| value(m.0) == Some(true)).map(|m| m.1).collect();
            drop(value);
            gain += self.apply(labels, taken);
            self.members = open;
            self.build(labels);
        }
        let value = self.binary.truncated();
        let taken = numbered(&self.members).filter(|m| value(m.0)).map(|m| m.1).collect();
        drop(value);
        gain + self.apply(labels, taken)
    }

    /// The move as an energy of one variable per member: 1 takes the proposed label.
    fn build(&mut self, labels: &[u32]) {
        let (problem, scale) = (self.problem, self.scale);
        let lambda = f64::from(problem.lambda);
        let whole = |cost: f64| (scale * cost).round() as i64;
        numbered(&self.members).for_each(|(i, p)| self.place[p.node as usize] = i);
        self.binary.clear();
        for (i, p) in numbered(&self.members) {
            let (node, old) = (p.node as usize, labels[p.node as usize]);
            let data = problem.data_of(node);
            let mut change = f64::from(data[p.label as usize]) - f64::from(data[old as usize]);
            for link in self.links.of(node) {
                let other = labels[link.other];
                let pair = |own: u32, other: u32| {
                    let (a, b) = if link.first { (own, other) } else { (other, own) };
                    lambda * f64::from(problem.pair(link.edge, a, b))
                };
                match self.place[link.other] {
                    OUTSIDE => change += pair(p.label, other) - pair(old, other),
                    j if link.first => {
                        let new = self.members[j as usize].label;
                        let costs = [pair(old, other), pair(old, new), pair(p.label, other), pair(p.label, new)];
                        self.binary.pairs.push(Pair { variables: [i, j], costs: costs.map(whole) });
                    }
                    _ => {}
                }
            }
            self.binary.single.push(whole(change));
        }
        self.members.iter().for_each(|p| self.place[p.node as usize] = OUTSIDE);
    }

    /// Changes labels if that lowers the energy. Gives what it lost.
    fn apply(&mut self, labels: &mut [u32], mut changes: Vec<Proposal>) -> f64 {
        let before = self.energy_around(labels, &changes);
        swap(labels, &mut changes);
        let gain = before - self.energy_around(labels, &changes);
        if gain > LEAST_GAIN {
            return gain;
        }
        swap(labels, &mut changes);
        0.0
    }

    /// Every term that a changed node has a part in.
    fn energy_around(&mut self, labels: &[u32], changes: &[Proposal]) -> f64 {
        let problem = self.problem;
        let lambda = f64::from(problem.lambda);
        changes.iter().for_each(|p| self.place[p.node as usize] = 0);
        let mut energy = 0.0;
        for p in changes {
            let node = p.node as usize;
            energy += f64::from(problem.data_of(node)[labels[node] as usize]);
            // A term of two changed nodes counts half with each.
            for link in self.links.of(node) {
                let (a, b) = if link.first { (node, link.other) } else { (link.other, node) };
                let part = if self.place[link.other] == OUTSIDE { 1.0 } else { 0.5 };
                energy += part * lambda * f64::from(problem.pair(link.edge, labels[a], labels[b]));
            }
        }
        changes.iter().for_each(|p| self.place[p.node as usize] = OUTSIDE);
        energy
    }
}

fn swap(labels: &mut [u32], changes: &mut [Proposal]) {
    changes.iter_mut().for_each(|p| std::mem::swap(&mut labels[p.node as usize], &mut p.label));
}

fn numbered(members: &[Proposal]) -> impl Iterator<Item = (u32, Proposal)> + '_ {
    (0..).zip(members.iter().copied())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assign::cases::Case;

    fn proposals(labels: &[u32]) -> impl Iterator<Item = Proposal> + '_ {
        (0..).zip(labels).map(|(node, &label)| Proposal { node, label })
    }

    /// The least energy of all mixtures of two labellings.
    fn best_mixture(problem: &Problem, a: &[u32], b: &[u32]) -> f64 {
        let mixture =
            |bits: u32| -> Vec<u32> { (0..a.len()).map(|n| if bits >> n & 1 == 1 { b[n] } else { a[n] }).collect() };
        (0..1 << a.len()).map(|bits| problem.energy(&mixture(bits))).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn a_fusion_never_raises_the_energy_and_mostly_finds_the_best_mixture() {
        let mut found = 0;
        for seed in 0..200 {
            let case = Case::grid(4, 3, 4, seed);
            let problem = case.problem([0.0, 0.05, 0.3, 3.0][seed as usize % 4]);
            let (mut labels, other) = (case.labels(seed), case.labels(seed + 1000));
            let before = problem.energy(&labels);
            let best = best_mixture(&problem, &labels, &other);
            let gain = Fusion::new(&problem).fuse(&mut labels, proposals(&other));
            let after = problem.energy(&labels);
            assert!((before - after - gain).abs() < 1e-9 && gain >= 0.0 && after >= best - 1e-9);
            found += usize::from(after < best + 1e-9);
        }
        assert!(found > 150, "the best mixture in {found} of 200");
    }

    #[test]
    fn terms_that_a_cut_can_express_give_the_best_mixture() {
        for seed in 0..50 {
            let mut case = Case::grid(4, 3, 4, seed);
            // A metric on the labels: every term of every move can be expressed.
            for (e, table) in case.pairs.tables.iter().enumerate() {
                let b = case.pairs.edges[e][1] as usize;
                let columns = case.offsets[b + 1] - case.offsets[b];
                for (i, cost) in case.pairs.costs[table.clone()].iter_mut().enumerate() {
                    *cost = f32::from(u8::from(i / columns != i % columns));
                }
            }
            let problem = case.problem(0.4);
            let mut labels = case.labels(seed);
            // Label 0 is proposed everywhere: an expansion.
            let zeros = vec![0; labels.len()];
            let best = best_mixture(&problem, &labels, &zeros);
            Fusion::new(&problem).fuse(&mut labels, proposals(&zeros));
            assert!((problem.energy(&labels) - best).abs() < 1e-9);
        }
    }

    #[test]
    fn only_nodes_that_are_proposed_for_change() {
        for seed in 0..50 {
            let case = Case::grid(4, 3, 4, seed);
            let problem = case.problem(0.3);
            let (start, other) = (case.labels(seed), case.labels(seed + 1000));
            let mut labels = start.clone();
            let gain = Fusion::new(&problem).fuse(&mut labels, proposals(&other).filter(|p| p.node % 3 == 0));
            assert!((problem.energy(&start) - problem.energy(&labels) - gain).abs() < 1e-9);
            assert!((0..12).all(|n| labels[n] == start[n] || (n % 3 == 0 && labels[n] == other[n])));
        }
    }
}
