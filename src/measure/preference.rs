//! What people's choices between two videos tell: shares of wins, and one strength for each video that explains them.
//!
//! The model is that of Bradley & Terry (Biometrika 39, 1952): item i is preferred to item j with probability
//! 1 / (1 + exp(βⱼ − βᵢ)). "Can't tell" counts as half a win for each.

use serde::{Deserialize, Serialize};

/// 97.5 % point of the normal distribution: intervals hold 95 %.
const Z: f64 = 1.959_963_984_540_054;
/// Votes that every item is taken to have had against an average opponent, half of them won. It keeps the strength of an
/// item that never or always won finite, and counts for little beside a dozen real votes.
const PRIOR: f64 = 1.0;
/// Most steps of Newton's method; it needs about ten.
const STEPS: usize = 100;
/// Largest slope of the log-likelihood, in votes, at which it counts as its top.
const FLAT: f64 = 1e-9;

/// A value and the ends of its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Share of `wins` among `trials`, 0 to 1, with the score interval of Wilson (J. Am. Stat. Assoc. 22, 1927), which stays
/// within 0 and 1 and holds for few trials too. None without trials.
pub fn share(wins: f64, trials: f64) -> Option<Estimate> {
    if trials <= 0.0 {
        return None;
    }
    let (value, z2) = (wins / trials, Z * Z / trials);
    let middle = (value + z2 / 2.0) / (1.0 + z2);
    let half = (z2 * value * (1.0 - value) + z2 * z2 / 4.0).sqrt() / (1.0 + z2);
    Some(Estimate { value, low: (middle - half).max(0.0), high: (middle + half).min(1.0) })
}

/// Strengths by Bradley & Terry: natural log of the odds against an average item, so that all of them sum to 0. Intervals
/// follow from the observed information. `wins[i][j]` says how often i was preferred to j. None for items that were never
/// compared.
///
/// The log-likelihood is concave; its top is found by Newton's method (Hunter, Ann. Statist. 32, 2004, compares it with
/// the classical iteration). One vote per item against an average opponent, half won, is the prior.
pub fn strengths(wins: &[Vec<f64>]) -> Vec<Option<Estimate>> {
    let votes = |i: usize, j: usize| wins[i][j] + wins[j][i];
    let known: Vec<usize> = (0..wins.len()).filter(|&i| (0..wins.len()).any(|j| j != i && votes(i, j) > 0.0)).collect();
    let mut all = vec![None; wins.len()];
    let wins: Vec<Vec<f64>> = known.iter().map(|&i| known.iter().map(|&j| wins[i][j]).collect()).collect();
    let fitted = Fit::new(&wins).estimates();
    known.iter().zip(fitted).for_each(|(&i, estimate)| all[i] = Some(estimate));
    all
}

/// The most likely strengths, and how sharply the likelihood falls off around them.
struct Fit {
    beta: Vec<f64>,
    /// Inverse of the observed information.
    covariance: Vec<Vec<f64>>,
}

impl Fit {
    fn new(wins: &[Vec<f64>]) -> Self {
        let n = wins.len();
        let mut beta = vec![0.0; n];
        for _ in 0..STEPS {
            let slope = slope(wins, &beta);
            if slope.iter().all(|s| s.abs() < FLAT) {
                break;
            }
            let covariance = inverse(information(wins, &beta));
            let step: Vec<f64> = covariance.iter().map(|row| dot(row, &slope)).collect();
            // A whole step may overshoot far from the top.
            let before = likelihood(wins, &beta);
            let halves = (0..40).map(|k| 0.5f64.powi(k));
            let moved = |part: f64| beta.iter().zip(&step).map(|(b, s)| b + part * s).collect::<Vec<f64>>();
            let Some(better) = halves.map(moved).find(|next| likelihood(wins, next) >= before) else { break };
            beta = better;
        }
        let covariance = inverse(information(wins, &beta));
        Self { beta, covariance }
    }

    /// Against the mean of all.
    fn estimates(&self) -> Vec<Estimate> {
        let n = self.beta.len() as f64;
        let mean = self.beta.iter().sum::<f64>() / n;
        let rows: Vec<f64> = self.covariance.iter().map(|row| row.iter().sum::<f64>() / n).collect();
        let whole = rows.iter().sum::<f64>() / n;
        let estimate = |(i, beta): (usize, &f64)| {
            let deviation = (self.covariance[i][i] - 2.0 * rows[i] + whole).max(0.0).sqrt();
            let value = beta - mean;
            Estimate { value, low: value - Z * deviation, high: value + Z * deviation }
        };
        self.beta.iter().enumerate().map(estimate).collect()
    }
}

/// Chance that an item stronger by `by` is preferred.
fn chance(by: f64) -> f64 {
    1.0 / (1.0 + (-by).exp())
}

/// ln of [`chance`], also where that is near 0.
fn ln_chance(by: f64) -> f64 {
    by.min(0.0) - (-by.abs()).exp().ln_1p()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Pairs of items, in a fixed order.
fn pairs(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).flat_map(move |i| (0..i).map(move |j| (i, j)))
}

fn likelihood(wins: &[Vec<f64>], beta: &[f64]) -> f64 {
    let votes = pairs(beta.len()).map(|(i, j)| {
        let by = beta[i] - beta[j];
        wins[i][j] * ln_chance(by) + wins[j][i] * ln_chance(-by)
    });
    let prior = beta.iter().map(|&b| PRIOR / 2.0 * (ln_chance(b) + ln_chance(-b)));
    votes.sum::<f64>() + prior.sum::<f64>()
}

fn slope(wins: &[Vec<f64>], beta: &[f64]) -> Vec<f64> {
    let mut slope: Vec<f64> = beta.iter().map(|&b| PRIOR * (0.5 - chance(b))).collect();
    for (i, j) in pairs(beta.len()) {
        let more = wins[i][j] - (wins[i][j] + wins[j][i]) * chance(beta[i] - beta[j]);
        slope[i] += more;
        slope[j] -= more;
    }
    slope
}

fn information(wins: &[Vec<f64>], beta: &[f64]) -> Vec<Vec<f64>> {
    let curve = |by: f64| chance(by) * chance(-by);
    let mut information = vec![vec![0.0; beta.len()]; beta.len()];
    (0..beta.len()).for_each(|i| information[i][i] = PRIOR * curve(beta[i]));
    for (i, j) in pairs(beta.len()) {
        let weight = (wins[i][j] + wins[j][i]) * curve(beta[i] - beta[j]);
        information[i][i] += weight;
        information[j][j] += weight;
        information[i][j] -= weight;
        information[j][i] -= weight;
    }
    information
}

/// Inverse of a positive definite matrix, by elimination; such a one needs no exchange of rows.
fn inverse(mut matrix: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let n = matrix.len();
    let mut inverse: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect()).collect();
    for k in 0..n {
        let pivot = matrix[k][k];
        for rows in [&mut matrix, &mut inverse] {
            rows[k].iter_mut().for_each(|v| *v /= pivot);
        }
        for i in (0..n).filter(|&i| i != k) {
            let factor = matrix[i][k];
            for rows in [&mut matrix, &mut inverse] {
                let row = rows[k].clone();
                rows[i].iter_mut().zip(&row).for_each(|(v, r)| *v -= factor * r);
            }
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    /// Votes of people who follow the model, `each` on every pair.
    fn simulated(beta: &[f64], each: usize, seed: u64) -> Vec<Vec<f64>> {
        let mut wins = vec![vec![0.0; beta.len()]; beta.len()];
        for (i, j) in pairs(beta.len()) {
            for vote in 0..each {
                let drawn = f64::from(rng::unit(rng::hash(seed, &[i as u64, j as u64, vote as u64])));
                let (winner, loser) = if drawn < chance(beta[i] - beta[j]) { (i, j) } else { (j, i) };
                wins[winner][loser] += 1.0;
            }
        }
        wins
    }

    fn values(wins: &[Vec<f64>]) -> Vec<f64> {
        strengths(wins).into_iter().map(|s| s.unwrap().value).collect()
    }

    #[test]
    fn shares_have_wilson_s_interval() {
        // Newcombe, Stat. Med. 17, 1998, table I, method 3.
        let close = |e: Estimate, expected: [f64; 3]| {
            let got = [e.value, e.low, e.high];
            assert!(got.iter().zip(expected).all(|(g, e)| (g - e).abs() < 5e-5), "{got:?} {expected:?}");
        };
        close(share(81.0, 263.0).unwrap(), [0.30798, 0.2553, 0.3662]);
        close(share(15.0, 148.0).unwrap(), [0.10135, 0.0624, 0.1605]);
        close(share(0.0, 20.0).unwrap(), [0.0, 0.0, 0.1611]);
        close(share(1.0, 29.0).unwrap(), [0.03448, 0.0061, 0.1718]);
        assert_eq!(share(0.0, 0.0), None);
        // Its ends are where the score test is just at its bound.
        let found = share(7.5, 31.0).unwrap();
        for p in [found.low, found.high] {
            assert!(((7.5 / 31.0 - p).abs() / (p * (1.0 - p) / 31.0).sqrt() - Z).abs() < 1e-9);
        }
    }

    #[test]
    fn two_items_agree_with_the_closed_form() {
        for (a, b) in [(30.0, 10.0), (1.0, 2.5), (400.0, 100.0), (5.0, 0.0)] {
            let found = values(&[vec![0.0, a], vec![b, 0.0]]);
            // By symmetry the strengths are x and −x, where the slope vanishes; found by halving.
            let (mut low, mut high) = (-20.0, 20.0);
            for _ in 0..200 {
                let x = (low + high) / 2.0;
                let slope = a - (a + b) * chance(2.0 * x) + PRIOR * (0.5 - chance(x));
                if slope > 0.0 { low = x } else { high = x }
            }
            assert!((found[0] - low).abs() < 1e-6 && (found[0] + found[1]).abs() < 1e-9, "{found:?} {low}");
        }
        // Many votes outweigh the prior: the log of the odds.
        let found = strengths(&[vec![0.0, 30_000.0], vec![10_000.0, 0.0]]);
        let (first, second) = (found[0].unwrap(), found[1].unwrap());
        assert!((first.value - second.value - 3f64.ln()).abs() < 1e-3);
        // Standard error of log odds: √(1/a + 1/b), of which each side has half.
        let expected = Z * (1.0 / 30_000.0 + 1.0f64 / 10_000.0).sqrt() / 2.0;
        assert!(((first.high - first.value) / expected - 1.0).abs() < 1e-3);
    }

    #[test]
    fn it_is_the_top_of_the_likelihood() {
        let wins = simulated(&[0.9, 0.1, -0.3, -0.7], 9, 3);
        let fit = Fit::new(&wins);
        let top = likelihood(&wins, &fit.beta);
        for k in 0..400u64 {
            let near = |i: usize| f64::from(rng::unit(rng::hash(k, &[i as u64]))) - 0.5;
            let other: Vec<f64> = fit.beta.iter().enumerate().map(|(i, b)| b + 0.3 * near(i)).collect();
            assert!(likelihood(&wins, &other) < top);
        }
        // Hunter's iteration (eq. 3), with the prior's opponent of strength 1, climbs to the same place.
        let mut gamma = vec![1.0; 4];
        for _ in 0..2000 {
            for i in 0..4 {
                let others = (0..4).filter(|&j| j != i);
                let won: f64 = others.clone().map(|j| wins[i][j]).sum::<f64>() + PRIOR / 2.0;
                let met = others.map(|j| (wins[i][j] + wins[j][i]) / (gamma[i] + gamma[j])).sum::<f64>();
                gamma[i] = won / (met + PRIOR / (gamma[i] + 1.0));
            }
        }
        assert!(fit.beta.iter().zip(&gamma).all(|(b, g): (&f64, &f64)| (b - g.ln()).abs() < 1e-6));
    }

    #[test]
    fn known_strengths_are_recovered() {
        let beta = [1.5, 0.5, 0.0, -0.4, -1.6];
        let found = values(&simulated(&beta, 4000, 11));
        assert!(found.iter().zip(beta).all(|(f, b)| (f - b).abs() < 0.06), "{found:?}");
    }

    #[test]
    fn intervals_hold_what_they_promise() {
        let beta = [1.2, 0.5, 0.0, -0.5, -1.2];
        for each in [6, 20, 60] {
            let held = (0..600u64).flat_map(|run| {
                let found = strengths(&simulated(&beta, each, 100 + run));
                found.into_iter().zip(beta).map(|(e, b)| e.is_some_and(|e| e.low <= b && b <= e.high))
            });
            let held = held.filter(|held| *held).count() as f64 / (600 * beta.len()) as f64;
            println!("{each} votes a pair: {:.1} % of the 95 % intervals hold the truth", 100.0 * held);
            assert!((0.92..0.98).contains(&held), "{each} votes a pair: {held}");
        }
    }

    #[test]
    fn separation_stays_finite_and_order_does_not_matter() {
        // The first always wins, the last always loses, one pair was never shown; the fourth nobody saw.
        let wins = vec![
            vec![0.0, 9.0, 0.0, 0.0, 9.0],
            vec![0.0, 0.0, 3.0, 0.0, 9.0],
            vec![0.0, 2.0, 0.0, 0.0, 9.0],
            vec![0.0; 5],
            vec![0.0; 5],
        ];
        let found = strengths(&wins);
        assert!(found[3].is_none());
        assert!(found.iter().flatten().all(|e| e.value.abs() < 10.0 && e.low.is_finite() && e.high.is_finite()));
        assert!(found[0].unwrap().value > found[1].unwrap().value && found[4].unwrap().high < 0.0);
        let order = [4, 2, 0, 3, 1];
        let turned: Vec<Vec<f64>> = order.iter().map(|&i| order.iter().map(|&j| wins[i][j]).collect()).collect();
        for (k, estimate) in strengths(&turned).into_iter().enumerate() {
            let before = found[order[k]];
            assert_eq!(estimate.is_some(), before.is_some());
            let same =
                estimate.zip(before).is_none_or(|(a, b)| (a.value - b.value).abs() + (a.high - b.high).abs() < 1e-9);
            assert!(same, "{estimate:?} {before:?}");
        }
        // Two groups that never met: within each it is known who is better, and not between them.
        let mut apart = vec![vec![0.0; 4]; 4];
        (apart[0][1], apart[1][0], apart[2][3], apart[3][2]) = (150.0, 50.0, 150.0, 50.0);
        let first = strengths(&apart)[0].unwrap();
        assert!(first.high - first.low > 3.0 && (first.value - 3f64.ln() / 2.0).abs() < 0.05, "{first:?}");
        assert!(strengths(&[]).is_empty() && strengths(&[vec![0.0]]) == [None]);
    }
}
