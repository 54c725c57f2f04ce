//! Iterated conditional modes (Besag 1986): node by node, the label that is best while its neighbours keep theirs.

use super::energy::{Problem, Solution, argmin};

/// A label changes only for a gain above this, so that rounding can neither raise the energy nor make it cycle.
const LEAST_GAIN: f64 = 1e-9;

/// Sweeps over the nodes, forwards and backwards in turn, until none changes or `sweeps` are done, from the labels of
/// least data term. The energy never rises; the order is fixed, so the result is too.
pub fn icm(problem: &Problem, sweeps: usize) -> Solution {
    improve(problem, problem.data_only(), sweeps)
}

/// [`icm`] from given labels.
pub fn improve(problem: &Problem, mut labels: Vec<u32>, sweeps: usize) -> Solution {
    let neighbours = neighbours(problem);
    let mut history = vec![problem.energy(&labels)];
    for sweep in 0..sweeps {
        let mut changed = false;
        for i in 0..labels.len() {
            let node = if sweep % 2 == 0 { i } else { labels.len() - 1 - i };
            let costs = conditional(problem, &neighbours[node], node, &labels);
            let (best, least) = argmin(costs.iter().copied());
            if least < costs[labels[node] as usize] - LEAST_GAIN {
                labels[node] = best as u32;
                changed = true;
            }
        }
        if !changed {
            break;
        }
        history.push(problem.energy(&labels));
    }
    let energy = problem.energy(&labels);
    Solution { labels, energy, bound: problem.bound(), history }
}

/// Edges of every node, and whether the node is their first.
fn neighbours(problem: &Problem) -> Vec<Vec<(usize, bool)>> {
    let mut out = vec![Vec::new(); problem.nodes()];
    for (e, &[a, b]) in problem.pairs.edges.iter().enumerate() {
        out[a as usize].push((e, true));
        out[b as usize].push((e, false));
    }
    out
}

/// Energy of every label of `node` while its neighbours keep theirs.
fn conditional(problem: &Problem, edges: &[(usize, bool)], node: usize, labels: &[u32]) -> Vec<f64> {
    let mut costs: Vec<f64> = problem.data_of(node).iter().map(|&v| f64::from(v)).collect();
    let lambda = f64::from(problem.lambda);
    for &(e, first) in edges {
        let ([a, b], table) = (problem.pairs.edges[e], problem.pairs.of(e));
        let columns = problem.data_of(b as usize).len();
        if first {
            let column = labels[b as usize] as usize;
            let pairs = table[column..].iter().step_by(columns);
            costs.iter_mut().zip(pairs).for_each(|(c, &w)| *c += lambda * f64::from(w));
        } else {
            let row = labels[a as usize] as usize * columns;
            costs.iter_mut().zip(&table[row..row + columns]).for_each(|(c, &w)| *c += lambda * f64::from(w));
        }
    }
    costs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assign::pair_costs::PairCosts;
    use crate::base::rng;

    struct Case {
        offsets: Vec<usize>,
        data: Vec<f32>,
        pairs: PairCosts,
    }

    /// A grid of `columns` × `rows` nodes with 1 to `most` candidates each and random costs.
    fn case(columns: usize, rows: usize, most: u64, seed: u64) -> Case {
        let n = columns * rows;
        let counts: Vec<usize> = (0..n).map(|i| 1 + rng::below(rng::hash(seed, &[i as u64]), most) as usize).collect();
        let offsets: Vec<usize> = (0..=n).map(|i| counts[..i].iter().sum()).collect();
        let random = |k: u64, i: usize| rng::unit(rng::hash(seed, &[k, i as u64]));
        let right = (0..n).filter(|i| i % columns + 1 < columns).map(|i| [i as u32, i as u32 + 1]);
        let down = (0..n - columns).map(|i| [i as u32, (i + columns) as u32]);
        let edges: Vec<[u32; 2]> = right.chain(down).collect();
        let sizes: Vec<usize> = edges.iter().map(|&[a, b]| counts[a as usize] * counts[b as usize]).collect();
        let pair_offsets: Vec<usize> = (0..=edges.len()).map(|e| sizes[..e].iter().sum()).collect();
        let costs = (0..pair_offsets[edges.len()]).map(|i| 5.0 * random(3, i).powi(3)).collect();
        Case {
            data: (0..offsets[n]).map(|i| random(2, i)).collect(),
            offsets,
            pairs: PairCosts { edges, offsets: pair_offsets, costs },
        }
    }

    fn problem(case: &Case, lambda: f32) -> Problem<'_> {
        Problem { offsets: &case.offsets, data: &case.data, pairs: &case.pairs, lambda }
    }

    /// The least energy of all labellings.
    fn brute_force(problem: &Problem) -> f64 {
        let counts: Vec<u32> = (0..problem.nodes()).map(|n| problem.data_of(n).len() as u32).collect();
        let mut labels = vec![0; counts.len()];
        let mut best = f64::INFINITY;
        loop {
            best = best.min(problem.energy(&labels));
            let Some(place) = (0..labels.len()).find(|&i| labels[i] + 1 < counts[i]) else { return best };
            labels[place] += 1;
            labels[..place].fill(0);
        }
    }

    #[test]
    fn the_energy_never_rises_and_ends_where_no_single_change_helps() {
        for (seed, lambda) in (0..20).flat_map(|s| [0.02, 0.3, 3.0].map(|l| (s, l))) {
            let case = case(7, 5, 9, seed);
            let problem = problem(&case, lambda);
            let solution = icm(&problem, 100);
            assert!(solution.history.windows(2).all(|w| w[1] < w[0]), "{:?}", solution.history);
            assert_eq!(solution.history[0], problem.energy(&problem.data_only()));
            assert_eq!(*solution.history.last().unwrap(), solution.energy);
            assert!(solution.bound <= solution.energy);
            let mut labels = solution.labels.clone();
            for node in 0..problem.nodes() {
                for label in 0..problem.data_of(node).len() as u32 {
                    labels[node] = label;
                    assert!(problem.energy(&labels) >= solution.energy - 1e-6);
                }
                labels[node] = solution.labels[node];
            }
            assert_eq!(icm(&problem, 100), solution);
        }
    }

    #[test]
    fn bounds_enclose_the_optimum_of_tiny_cases() {
        let (mut found, mut cases) = (0, 0);
        for seed in 0..30 {
            let case = case(3, 3, 3, seed);
            let problem = problem(&case, 0.1);
            let best = brute_force(&problem);
            let solution = icm(&problem, 100);
            assert!(solution.bound <= best + 1e-9 && best <= solution.energy + 1e-9);
            found += usize::from(solution.energy < best + 1e-9);
            cases += 1;
        }
        assert!(2 * found > cases, "the optimum in {found} of {cases}");
    }

    #[test]
    fn without_smoothness_the_data_term_decides() {
        let case = case(4, 3, 5, 1);
        let problem = problem(&case, 0.0);
        let solution = icm(&problem, 10);
        assert_eq!(solution.labels, problem.data_only());
        assert_eq!(solution.history.len(), 1);
        let empty = Problem { offsets: &[0], data: &[], pairs: &PairCosts::default(), lambda: 1.0 };
        assert_eq!(icm(&empty, 3).labels.len(), 0);
    }
}
