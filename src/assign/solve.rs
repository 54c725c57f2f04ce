//! Labels of little energy, with a bound to judge them by (Okabe et al. 2011, §5.3).

use super::dual_bound::{Dual, Pass};
use super::energy::Problem;
use super::expansion::Moves;
use super::fusion::{Fusion, LEAST_GAIN, Proposal};
use crate::base::error::Result;
use crate::base::observe::{self, Observer};
use crate::base::options::Words;

/// How labels are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Solver {
    /// Messages of the dual first, then expansion moves from its labels until none helps.
    Dual,
    /// Sequential tree-reweighted message passing alone (Kolmogorov 2006).
    Trws,
    /// Expansion moves alone, from the best data terms (Boykov, Veksler & Zabih 2001), as the paper has it.
    Expansion,
}

impl Words for Solver {
    const ALL: &'static [(&'static str, Self)] =
        &[("dual", Self::Dual), ("trws", Self::Trws), ("expansion", Self::Expansion)];
}

/// How labels are found, and for how long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// The solver.
    pub solver: Solver,
    /// Sweeps of messages at most, and rounds of moves at most; either ends sooner when nothing changes.
    pub sweeps: usize,
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
    /// Energy of the best data terms, and after each sweep or round; never rises.
    pub history: Vec<f64>,
    /// Bound after each sweep of messages; never falls.
    pub bounds: Vec<f64>,
}

impl Solution {
    /// What is left to gain at most, as a share of what the best data terms alone left: `(E − bound) / (E₀ − bound)`.
    /// 0 is proven least.
    pub fn gap(&self) -> f64 {
        let start = self.history.first().copied().unwrap_or(self.energy);
        (self.energy - self.bound).max(0.0) / (start - self.bound).max(f64::MIN_POSITIVE)
    }
}

/// Sweeps over which the messages must gain something to go on.
const PATIENCE: usize = 10;
/// This share of what lies between energy and bound.
const LEAST_PROGRESS: f64 = 0.05;

/// Finds labels. Entries with the same number in `groups` (one per candidate; may be empty) are proposed together.
///
/// # Errors
/// After a cancel.
pub fn solve(problem: &Problem, groups: &[u32], options: &Options, observer: &dyn Observer) -> Result<Solution> {
    let mut dual = Dual::new(problem);
    let mut search = Search::new(problem, observer);
    if options.solver != Solver::Expansion {
        search.send_messages(&mut dual, options.sweeps)?;
    }
    if options.solver != Solver::Trws {
        search.move_until_fixed(&Moves::new(problem, groups), options.sweeps)?;
    }
    let bound = dual.certificate();
    let Search { labels, history, mut bounds, .. } = search;
    bounds.push(bound.max(bounds.last().copied().unwrap_or(bound)));
    let energy = problem.energy(&labels);
    Ok(Solution { labels, energy, bound: bound.min(energy), history, bounds })
}

/// The best labels so far.
struct Search<'a> {
    problem: &'a Problem<'a>,
    fusion: Fusion<'a>,
    observer: &'a dyn Observer,
    labels: Vec<u32>,
    history: Vec<f64>,
    bounds: Vec<f64>,
}

impl<'a> Search<'a> {
    fn new(problem: &'a Problem<'a>, observer: &'a dyn Observer) -> Self {
        let labels = problem.data_only();
        let history = vec![problem.energy(&labels)];
        Self { problem, fusion: Fusion::new(problem), observer, labels, history, bounds: Vec::new() }
    }

    /// Sweeps of messages, forward and back; the labels of each are fused with the best so far.
    fn send_messages(&mut self, dual: &mut Dual, sweeps: usize) -> Result<()> {
        for sweep in 0..sweeps {
            let mut bound = f64::NEG_INFINITY;
            for pass in [Pass::Forward, Pass::Backward] {
                observe::check(self.observer)?;
                let (found, labels) = dual.pass(pass);
                bound = bound.max(found);
                let proposals = (0..).zip(&labels).map(|(node, &label)| Proposal { node, label });
                self.fusion.fuse(&mut self.labels, proposals);
            }
            self.bounds.push(bound.max(self.bounds.last().copied().unwrap_or(bound)));
            self.end_round();
            if self.settled(sweep) {
                break;
            }
        }
        Ok(())
    }

    /// Rounds of moves until none of a round helps.
    fn move_until_fixed(&mut self, moves: &Moves, rounds: usize) -> Result<()> {
        for _ in 0..rounds {
            if moves.round(&mut self.fusion, &mut self.labels, self.observer)? == 0.0 {
                break;
            }
            self.end_round();
        }
        Ok(())
    }

    fn end_round(&mut self) {
        let least = self.history.last().copied().unwrap_or(f64::INFINITY);
        self.history.push(self.problem.energy(&self.labels).min(least));
        self.observer.advance("labels", 1);
    }

    /// Whether energy and bound have met, or stopped to approach each other.
    fn settled(&self, sweep: usize) -> bool {
        let between = |sweep: usize| self.history[sweep + 1] - self.bounds[sweep];
        let stalled = sweep >= PATIENCE && between(sweep) >= (1.0 - LEAST_PROGRESS) * between(sweep - PATIENCE);
        stalled || between(sweep) <= LEAST_GAIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assign::cases::{Case, brute_force};
    use crate::assign::pair_costs::PairCosts;
    use crate::base::error::Kind;
    use crate::base::observe::Silent;
    use crate::base::par;

    const SOLVERS: [Solver; 3] = [Solver::Dual, Solver::Trws, Solver::Expansion];

    fn run(problem: &Problem, groups: &[u32], solver: Solver) -> Solution {
        solve(problem, groups, &Options { solver, sweeps: 100 }, &Silent).unwrap()
    }

    /// Every third candidate of a node belongs to a group with those of other nodes.
    fn groups(case: &Case) -> Vec<u32> {
        (0..case.data.len() as u32).map(|i| if i % 3 == 0 { i % 5 } else { 100 + i }).collect()
    }

    #[test]
    fn energies_fall_bounds_rise_and_the_optimum_lies_between() {
        let mut found = [0; 3];
        for (seed, lambda) in (0..20).flat_map(|s| [0.02, 0.3, 3.0].map(|l| (s, l))) {
            let case = Case::grid(3, 3, 4, seed);
            let problem = case.problem(lambda);
            let best = brute_force(&problem);
            for (solver, found) in SOLVERS.into_iter().zip(&mut found) {
                let solution = run(&problem, &groups(&case), solver);
                assert!(solution.history.windows(2).all(|w| w[1] <= w[0]), "{:?}", solution.history);
                assert!(solution.bounds.windows(2).all(|w| w[1] >= w[0]), "{:?}", solution.bounds);
                assert_eq!(solution.energy, problem.energy(&solution.labels));
                assert!(solution.bound <= best + 1e-9 && best <= solution.energy + 1e-9);
                assert!((solution.history.last().unwrap() - solution.energy).abs() < 1e-9);
                assert_eq!(solution.history[0], problem.energy(&problem.data_only()));
                assert!((0.0..=1.0).contains(&solution.gap()), "{}", solution.gap());
                *found += usize::from(solution.energy < best + 1e-9);
            }
        }
        assert!(found[0] >= found[1] && found[0] >= 55 && found[2] >= 35, "optima of 60: {found:?}");
    }

    #[test]
    fn larger_problems_end_near_their_bound() {
        let case = Case::grid(12, 9, 30, 5);
        for lambda in [0.02, 0.2, 2.0] {
            let solution = run(&case.problem(lambda), &groups(&case), Solver::Dual);
            assert!(solution.gap() < 0.05, "{lambda}: {}", solution.gap());
        }
    }

    #[test]
    fn results_do_not_depend_on_threads() {
        let case = Case::grid(9, 7, 12, 3);
        let problem = case.problem(0.3);
        for solver in SOLVERS {
            let alone = par::with_threads(1, || run(&problem, &groups(&case), solver)).unwrap();
            for threads in [2, 3] {
                assert_eq!(par::with_threads(threads, || run(&problem, &groups(&case), solver)).unwrap(), alone);
            }
        }
    }

    #[test]
    fn without_smoothness_or_choice_the_answer_is_plain() {
        let case = Case::grid(4, 3, 5, 1);
        let problem = case.problem(0.0);
        let one = Case::grid(5, 4, 1, 1);
        for solver in SOLVERS {
            let solution = run(&problem, &[], solver);
            assert_eq!(solution.labels, problem.data_only());
            assert!((solution.energy - solution.bound).abs() < 1e-9);
            let solution = run(&one.problem(0.5), &[], solver);
            assert_eq!(solution.labels, [0; 20]);
            assert!((solution.energy - solution.bound).abs() < 1e-6);
        }
    }

    #[test]
    fn nothing_and_lonely_nodes_are_problems_too() {
        let pairs = PairCosts::default();
        for solver in SOLVERS {
            for offsets in [&[][..], &[0][..]] {
                let empty = Problem { offsets, data: &[], pairs: &pairs, lambda: 1.0 };
                let solution = run(&empty, &[], solver);
                assert_eq!((solution.labels.len(), solution.energy, solution.gap()), (0, 0.0, 0.0));
            }
            let lonely = Problem { offsets: &[0, 2, 5], data: &[0.5, 0.25, 0.3, 0.1, 0.2], pairs: &pairs, lambda: 1.0 };
            let solution = run(&lonely, &[0, 1, 0, 1, 1], solver);
            assert_eq!(solution.labels, [1, 1]);
            assert!((solution.bound - solution.energy).abs() < 1e-12);
        }
    }

    #[test]
    fn a_cancel_ends_the_search() {
        struct Stop;
        impl Observer for Stop {
            fn cancelled(&self) -> bool {
                true
            }
        }
        let case = Case::grid(4, 3, 5, 1);
        for solver in SOLVERS {
            let result = solve(&case.problem(0.3), &[], &Options { solver, sweeps: 10 }, &Stop);
            assert_eq!(result.unwrap_err().kind(), Kind::Interrupted);
        }
    }
}
