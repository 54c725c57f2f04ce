//! A bound that no energy is below, and labels close to it: sequential tree-reweighted message passing
//! (Kolmogorov 2006, TRW-S) for nodes that each have labels of their own.
//!
//! Messages move cost between nodes and edges without changing any energy. Where every term's least value is taken by
//! itself, their sum is a bound; each pass over the nodes shares costs out so that this sum does not fall. A node's
//! cost is shared equally by the chains that run through it, one for each of its edges on the fuller side.

use macro_rules_attribute::apply;

use super::energy::{Link, Links, Problem};
use crate::base::instructions::kernel;

/// Messages, and the best bound they gave.
pub struct Dual<'a> {
    problem: &'a Problem<'a>,
    links: Links,
    /// Per edge: where the message to its first node begins, and that to its second.
    starts: Vec<[usize; 2]>,
    messages: Vec<f32>,
    scratch: Scratch,
}

#[derive(Default)]
struct Scratch {
    sum: Vec<f32>,
    sent: Vec<f32>,
}

/// Which way a pass goes over the nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pass {
    /// By rising number.
    Forward,
    /// By falling number.
    Backward,
}

impl Pass {
    fn ahead(self, node: usize, link: &Link) -> bool {
        (link.other > node) == (self == Self::Forward)
    }
}

impl<'a> Dual<'a> {
    /// No messages yet.
    pub fn new(problem: &'a Problem<'a>) -> Self {
        let mut length = 0;
        let mut place = |node: u32| {
            length += problem.labels_of(node as usize);
            length - problem.labels_of(node as usize)
        };
        let starts = problem.pairs.edges.iter().map(|&[a, b]| [place(a), place(b)]).collect();
        Self { problem, links: problem.links(), starts, messages: vec![0.0; length], scratch: Scratch::default() }
    }

    /// One pass over the nodes. Gives the bound, up to rounding, and labels: every node's best while the nodes before it
    /// keep theirs and messages speak for those after it.
    pub fn pass(&mut self, pass: Pass) -> (f64, Vec<u32>) {
        let nodes = self.problem.nodes();
        let mut labels = vec![0; nodes];
        let mut bound = 0.0;
        for i in 0..nodes {
            let node = if pass == Pass::Forward { i } else { nodes - 1 - i };
            labels[node] = self.best_label(node, pass, &labels);
            bound += self.send(node, pass);
        }
        (bound, labels)
    }

    fn best_label(&mut self, node: usize, pass: Pass, labels: &[u32]) -> u32 {
        let costs = &mut self.scratch.sum;
        costs.clear();
        costs.extend_from_slice(self.problem.data_of(node));
        for link in self.links.of(node) {
            if pass.ahead(node, link) {
                let start = self.starts[link.edge][usize::from(!link.first)];
                costs.iter_mut().zip(&self.messages[start..]).for_each(|(c, m)| *c += m);
            } else {
                add_conditional(self.problem, link, labels[link.other], costs);
            }
        }
        let best = costs.iter().enumerate().fold((0, f32::INFINITY), |b, (i, &c)| if c < b.1 { (i, c) } else { b });
        best.0 as u32
    }

    /// Shares a node's cost out to the edges ahead, and sends what follows to the nodes at their other ends. Gives what
    /// the bound gains.
    fn send(&mut self, node: usize, pass: Pass) -> f64 {
        let Self { problem, links, starts, messages, scratch: Scratch { sum, sent } } = self;
        let links = links.of(node);
        let incoming = |link: &Link| starts[link.edge][usize::from(!link.first)];
        sum.clear();
        sum.extend_from_slice(problem.data_of(node));
        for link in links {
            sum.iter_mut().zip(&messages[incoming(link)..]).for_each(|(s, m)| *s += m);
        }
        let least = subtract_least(sum);
        let mut gain = f64::from(least);
        let share = share(links, node) as f32;
        for link in links.iter().filter(|link| pass.ahead(node, link)) {
            sent.clear();
            sent.extend(sum.iter().zip(&messages[incoming(link)..]).map(|(s, m)| share * s - m));
            let start = starts[link.edge][usize::from(link.first)];
            let out = &mut messages[start..start + problem.labels_of(link.other)];
            let table = problem.pairs.of(link.edge);
            if link.first {
                over_rows(sent, table, problem.lambda, out);
            } else {
                over_columns(sent, table, problem.lambda, out);
            }
            gain += f64::from(subtract_least(out));
        }
        gain
    }

    /// The bound of the messages as they are, in double precision: no energy is below it by more than the rounding of
    /// the energy itself. It is the bound of one more pass forward.
    pub fn certificate(&self) -> f64 {
        let problem = self.problem;
        let lambda = f64::from(problem.lambda);
        let mut costs: Vec<f64> = problem.data.iter().map(|&v| f64::from(v)).collect();
        let mut bound = 0.0;
        for node in 0..problem.nodes() {
            let (done, later) = costs.split_at_mut(problem.offsets[node + 1]);
            let own = &mut done[problem.offsets[node]..];
            let ahead = || self.links.of(node).iter().filter(|link| Pass::Forward.ahead(node, link));
            let incoming = |link: &Link| &self.messages[self.starts[link.edge][usize::from(!link.first)]..];
            for link in ahead() {
                own.iter_mut().zip(incoming(link)).for_each(|(c, &m)| *c += f64::from(m));
            }
            let least = own.iter().copied().fold(f64::INFINITY, f64::min);
            bound += least;
            let share = share(self.links.of(node), node);
            for link in ahead() {
                let sent: Vec<f64> =
                    own.iter().zip(incoming(link)).map(|(c, &m)| share * (c - least) - f64::from(m)).collect();
                let (table, columns) = (problem.pairs.of(link.edge), problem.labels_of(link.other));
                let (row, column) = if link.first { (columns, 1) } else { (1, sent.len()) };
                let at = |i: usize, j: usize| lambda * f64::from(table[i * row + j * column]);
                let out = |j: usize| sent.iter().enumerate().map(|(i, s)| s + at(i, j)).fold(f64::INFINITY, f64::min);
                let received = &mut later[problem.offsets[link.other] - problem.offsets[node + 1]..];
                received[..columns].iter_mut().enumerate().for_each(|(j, c)| *c += out(j));
            }
        }
        bound
    }
}

/// Adds λ W of every label of a node when the node at the other end of `link` has `label`.
pub(super) fn add_conditional(problem: &Problem, link: &Link, label: u32, costs: &mut [f32]) {
    let table = problem.pairs.of(link.edge);
    if link.first {
        let columns = problem.labels_of(link.other);
        let pairs = table[label as usize..].iter().step_by(columns);
        costs.iter_mut().zip(pairs).for_each(|(c, w)| *c += problem.lambda * w);
    } else {
        let row = label as usize * costs.len();
        costs.iter_mut().zip(&table[row..]).for_each(|(c, w)| *c += problem.lambda * w);
    }
}

/// The share of a node's cost that each of its chains has.
fn share(links: &[Link], node: usize) -> f64 {
    let later = links.iter().filter(|link| link.other > node).count();
    1.0 / later.max(links.len() - later).max(1) as f64
}

fn subtract_least(values: &mut [f32]) -> f32 {
    let least = values.iter().copied().fold(f32::INFINITY, lesser);
    values.iter_mut().for_each(|v| *v -= least);
    least
}

/// The lesser of two numbers, as one instruction.
#[inline(always)]
fn lesser(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}

/// `out[j] = min_i (h[i] + λ table[i][j])`; there is a row for every element of `h`.
#[apply(kernel)]
fn over_rows(h: &[f32], table: &[f32], lambda: f32, out: &mut [f32]) {
    let n = out.len();
    out.fill(f32::INFINITY);
    let (quads, rest) = h.as_chunks::<4>();
    let (tables, rows) = table.split_at(4 * n * quads.len());
    for (h, quad) in quads.iter().zip(tables.chunks_exact(4 * n)) {
        let row: [&[f32]; 4] = std::array::from_fn(|k| &quad[k * n..(k + 1) * n]);
        for j in 0..n {
            let cost: [f32; 4] = std::array::from_fn(|k| h[k] + lambda * row[k][j]);
            out[j] = lesser(out[j], lesser(lesser(cost[0], cost[1]), lesser(cost[2], cost[3])));
        }
    }
    for (h, row) in rest.iter().zip(rows.chunks_exact(n)) {
        out.iter_mut().zip(row).for_each(|(o, w)| *o = lesser(*o, h + lambda * w));
    }
}

/// `out[i] = min_j (h[j] + λ table[i][j])`; a row has as many entries as `h`.
#[apply(kernel)]
fn over_columns(h: &[f32], table: &[f32], lambda: f32, out: &mut [f32]) {
    const LANES: usize = 16;
    let (chunks, tail) = h.as_chunks::<LANES>();
    for (o, row) in out.iter_mut().zip(table.chunks_exact(h.len())) {
        let (row, row_tail) = row.as_chunks::<LANES>();
        let mut least = [f32::INFINITY; LANES];
        for (h, w) in chunks.iter().zip(row) {
            for k in 0..LANES {
                least[k] = lesser(least[k], h[k] + lambda * w[k]);
            }
        }
        for (k, (h, w)) in tail.iter().zip(row_tail).enumerate() {
            least[k] = lesser(least[k], h + lambda * w);
        }
        let mut width = LANES / 2;
        while width > 0 {
            (0..width).for_each(|k| least[k] = lesser(least[k], least[k + width]));
            width /= 2;
        }
        *o = least[0];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assign::cases::{Case, brute_force};
    use crate::base::rng;

    const SWEEP: [Pass; 2] = [Pass::Forward, Pass::Backward];

    #[test]
    fn the_bound_rises_and_stays_below_the_least_energy() {
        for (seed, lambda) in (0..20).flat_map(|s| [0.0, 0.1, 1.0].map(|l| (s, l))) {
            let case = Case::grid(3, 3, 4, seed);
            let problem = case.problem(lambda);
            let best = brute_force(&problem);
            let mut dual = Dual::new(&problem);
            let mut last = dual.certificate();
            for pass in SWEEP.into_iter().cycle().take(40) {
                let (bound, labels) = dual.pass(pass);
                assert!(bound >= last - 1e-5 && bound <= best + 1e-5, "{last} {bound} {best}");
                let certified = dual.certificate();
                assert!(certified >= bound - 1e-5 && certified <= best + 1e-9, "{bound} {certified} {best}");
                assert!(problem.energy(&labels) >= best - 1e-9);
                last = bound;
            }
        }
    }

    #[test]
    fn trees_are_solved_exactly() {
        for seed in 0..40 {
            let case = Case::tree(9, 4, seed);
            let problem = case.problem(0.4);
            let best = brute_force(&problem);
            let mut dual = Dual::new(&problem);
            let least =
                SWEEP.into_iter().cycle().take(100).map(|p| problem.energy(&dual.pass(p).1)).fold(1e9, f64::min);
            assert!((dual.certificate() - best).abs() < 1e-4, "seed {seed}: {} {best}", dual.certificate());
            assert!((least - best).abs() < 1e-5, "seed {seed}: {least} {best}");
        }
    }

    #[test]
    fn products_take_the_least_sum() {
        for (rows, columns) in [(1, 1), (3, 5), (4, 16), (9, 17), (33, 100), (100, 33)] {
            let random =
                |k: u64, n: usize| -> Vec<f32> { (0..n).map(|i| rng::unit(rng::hash(k, &[i as u64])) - 0.5).collect() };
            let (table, a, b) = (random(1, rows * columns), random(2, rows), random(3, columns));
            let least = |costs: &mut dyn Iterator<Item = f32>| costs.fold(f32::INFINITY, f32::min);
            let (mut down, mut across) = (vec![0.0; columns], vec![0.0; rows]);
            over_rows(&a, &table, 0.7, &mut down);
            over_columns(&b, &table, 0.7, &mut across);
            for (j, found) in down.iter().enumerate() {
                assert_eq!(*found, least(&mut (0..rows).map(|i| a[i] + 0.7 * table[i * columns + j])));
            }
            for (i, found) in across.iter().enumerate() {
                assert_eq!(*found, least(&mut (0..columns).map(|j| b[j] + 0.7 * table[i * columns + j])));
            }
        }
    }
}
