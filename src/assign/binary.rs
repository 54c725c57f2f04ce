//! Energies of variables that are 0 or 1, minimised by cuts.
//!
//! A cut can express a term of two variables when `E(0,0) + E(1,1) ≤ E(0,1) + E(1,0)`. Where all terms are so, the cut is
//! the optimum. Otherwise a cut of the doubled graph still tells which variables have the same value in an optimum (roof
//! duality: Hammer, Hansen & Simeone 1984; Kolmogorov & Rother 2007), and leaves the others open; or terms are truncated
//! until a cut can express them (Rother et al. 2005).

use super::max_flow::Graph;

/// A term of two variables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pair {
    /// First and second variable.
    pub variables: [u32; 2],
    /// Costs of (0, 0), (0, 1), (1, 0) and (1, 1).
    pub costs: [i64; 4],
}

/// An energy.
#[derive(Debug, Clone, Default)]
pub struct Binary {
    /// Per variable: the cost of 1, less that of 0.
    pub single: Vec<i64>,
    /// The terms of two variables.
    pub pairs: Vec<Pair>,
    graph: Graph,
}

impl Pair {
    fn cut_can_express(&self) -> bool {
        let [c00, c01, c10, c11] = self.costs;
        c00 + c11 <= c01 + c10
    }
}

impl Binary {
    /// Back to no variables.
    pub fn clear(&mut self) {
        self.single.clear();
        self.pairs.clear();
    }

    /// Whether [`Binary::truncated`] gives the optimum.
    pub fn cut_is_exact(&self) -> bool {
        self.pairs.iter().all(Pair::cut_can_express)
    }

    /// For every variable its value in a labelling that is no dearer than all zeros: the optimum where a cut can express
    /// every term. Elsewhere the cost of (0, 0) is lowered until it can.
    pub fn truncated(&mut self) -> impl Fn(u32) -> bool + '_ {
        self.graph.reset(self.single.len());
        (0..).zip(&self.single).for_each(|(i, &cost)| self.graph.add_terminal(i, -cost));
        for &Pair { variables: [i, j], costs: [c00, c01, c10, c11] } in &self.pairs {
            add_pair(&mut self.graph, [i, j], [c00.min(c01 + c10 - c11), c01, c10, c11]);
        }
        self.graph.cut();
        |i| self.graph.from_source(i)
    }

    /// For every variable the value it has in an optimum, if that could be found out. Setting these and leaving the rest
    /// as it is never raises the energy.
    pub fn persistent(&mut self) -> impl Fn(u32) -> Option<bool> + '_ {
        // Node i is the variable, node n + i its complement.
        let n = self.single.len() as u32;
        self.graph.reset(2 * self.single.len());
        for (i, &cost) in (0..).zip(&self.single) {
            self.graph.add_terminal(i, -cost);
            self.graph.add_terminal(n + i, cost);
        }
        for pair in &self.pairs {
            let ([i, j], [c00, c01, c10, c11]) = (pair.variables, pair.costs);
            if pair.cut_can_express() {
                add_pair(&mut self.graph, [i, j], [c00, c01, c10, c11]);
                add_pair(&mut self.graph, [n + i, n + j], [c11, c10, c01, c00]);
            } else {
                add_pair(&mut self.graph, [i, n + j], [c01, c00, c11, c10]);
                add_pair(&mut self.graph, [n + i, j], [c10, c11, c00, c01]);
            }
        }
        self.graph.cut();
        move |i| match (self.graph.from_source(i), self.graph.from_source(n + i)) {
            (true, false) => Some(true),
            (false, true) => Some(false),
            _ => None,
        }
    }
}

/// Adds a term that a cut can express; a node with the source is 1.
fn add_pair(graph: &mut Graph, [i, j]: [u32; 2], [c00, c01, c10, c11]: [i64; 4]) {
    graph.add_terminal(i, c00 - c10);
    graph.add_terminal(j, c10 - c11);
    graph.add_arc(j, i, c01 + c10 - c00 - c11, 0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    /// An energy of `n` variables; `frustration` is the share, in tenths, of terms with arbitrary costs.
    fn sample(n: u64, frustration: u64, seed: u64) -> Binary {
        let random = |k: u64, i: u64, n: u64| rng::below(rng::hash(seed, &[k, i]), n);
        let pair = |e: u64| {
            let i = random(1, e, n);
            let mut costs = std::array::from_fn(|c| random(10 + c as u64, e, 20) as i64);
            if random(2, e, 10) >= frustration {
                costs[0] = costs[0].min(costs[1] + costs[2] - costs[3]);
            }
            Pair { variables: [i as u32, ((i + 1 + random(3, e, n - 1)) % n) as u32], costs }
        };
        Binary {
            single: (0..n).map(|i| random(0, i, 31) as i64 - 15).collect(),
            pairs: (0..2 * n).map(pair).collect(),
            ..Binary::default()
        }
    }

    fn energy(binary: &Binary, values: u32) -> i64 {
        let value = |i: u32| (values >> i & 1) as usize;
        let single = (0..).zip(&binary.single).map(|(i, &cost)| value(i) as i64 * cost).sum::<i64>();
        let pair = |p: &Pair| p.costs[2 * value(p.variables[0]) + value(p.variables[1])];
        single + binary.pairs.iter().map(pair).sum::<i64>()
    }

    #[test]
    fn cuts_find_the_optimum_or_at_least_no_worse_than_zeros() {
        for seed in 0..300 {
            let n = 2 + seed % 8;
            let mut binary = sample(n, seed % 3 * 4, seed);
            let best = (0..1 << n).map(|values| energy(&binary, values)).min().unwrap();
            let found = binary.truncated();
            let values = (0..n as u32).fold(0, |v, i| v | u32::from(found(i)) << i);
            drop(found);
            assert!(energy(&binary, values) <= energy(&binary, 0));
            assert!(!binary.cut_is_exact() || energy(&binary, values) == best, "seed {seed}");
        }
    }

    #[test]
    fn persistent_values_belong_to_an_optimum_and_never_harm() {
        let mut known = 0;
        for seed in 0..300 {
            let n = 2 + seed % 8;
            let mut binary = sample(n, seed % 5 * 2, seed);
            let exact = binary.cut_is_exact();
            let found = binary.persistent();
            let values: Vec<Option<bool>> = (0..n as u32).map(found).collect();
            known += values.iter().flatten().count();
            let mask = (0..).zip(&values).fold(0u32, |m, (i, v)| m | u32::from(v.is_some()) << i);
            let set = (0..).zip(&values).fold(0u32, |m, (i, v)| m | u32::from(*v == Some(true)) << i);
            let least = |of: &dyn Fn(u32) -> bool| (0..1 << n).filter(|&v| of(v)).map(|v| energy(&binary, v)).min();
            assert_eq!(least(&|v| v & mask == set), least(&|_| true), "seed {seed}");
            assert!((0..1u32 << n).all(|v| energy(&binary, v & !mask | set) <= energy(&binary, v)));
            assert!(!exact || mask != 0 || energy(&binary, 0) == least(&|_| true).unwrap());
        }
        assert!(known > 800, "{known}");
    }
}
