//! What the votes say: who won how often, how strong every row is, and whether the votes mean anything.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::findings::{BlindTest, Cast, Choice, Judged, Planted, Standing, Use};
use super::key::{self, Key, Named};
use super::votes::{self, Ballot, Vote};
use crate::base::error::Result;
use crate::measure::preference::{Estimate, share, strengths};
use crate::report::comparison::{Comparison, Sort};

/// The blind test of a comparison, with the votes that are kept in `folder`; none where there is no blind test.
///
/// # Errors
/// A key, a video or votes that cannot be read.
pub fn read(comparison: &Comparison, folder: &Path) -> Result<Option<BlindTest>> {
    let Some(key) = Key::load(folder)? else { return Ok(None) };
    let mut ballots: Vec<Ballot> = votes::kept(folder, &key)?.into_values().collect();
    ballots.sort_by(|a, b| (&a.saved, &a.session).cmp(&(&b.saved, &b.session)));
    let now = key::names(comparison, folder)?;
    let stale = key.videos.keys().any(|id| !now.contains_key(id));
    Ok(Some(Tally::new(&key, &now, &ballots).result(comparison, stale)))
}

/// Votes sorted by what becomes of them.
#[derive(Default)]
struct Tally {
    voters: BTreeSet<String>,
    cast: Vec<Cast>,
    /// Whether each repeat agreed.
    agreed: Vec<bool>,
    replaced: BTreeSet<(String, String)>,
    /// Which video somebody preferred of a pair, the first time; none where they could not tell.
    preferred: BTreeMap<(String, [String; 2]), Option<String>>,
}

impl Tally {
    fn new(key: &Key, now: &BTreeMap<String, Named>, ballots: &[Ballot]) -> Self {
        let mut tally = Self::default();
        for ballot in ballots {
            let voter = if ballot.voter.trim().is_empty() { &ballot.session } else { &ballot.voter };
            tally.voters.insert(voter.clone());
            for (i, vote) in ballot.votes.iter().enumerate() {
                let [Some(left), Some(right)] = [&vote.left, &vote.right].map(|id| key.named(id)) else { continue };
                let used = tally.count(voter, vote, |id| now.contains_key(id));
                if used == Use::Outdated {
                    let old =
                        [(&vote.left, left), (&vote.right, right)].into_iter().filter(|(id, _)| !now.contains_key(*id));
                    tally.replaced.extend(old.map(|(_, named)| (named.scene.clone(), named.row.clone())));
                }
                tally.cast.push(Cast {
                    voter: ballot.voter.clone(),
                    session: ballot.session.clone(),
                    order: i + 1,
                    scene: left.scene.clone(),
                    left: left.row.clone(),
                    right: right.row.clone(),
                    choice: vote.choice,
                    seconds: vote.seconds,
                    used,
                });
            }
        }
        tally
    }

    /// A first vote on a pair that is there counts; later ones are compared with it.
    fn count(&mut self, voter: &str, vote: &Vote, is_there: impl Fn(&str) -> bool) -> Use {
        if !is_there(&vote.left) || !is_there(&vote.right) {
            return Use::Outdated;
        }
        let mut pair = [vote.left.clone(), vote.right.clone()];
        pair.sort();
        let preferred = match vote.choice {
            Choice::Left => Some(vote.left.clone()),
            Choice::Tie => None,
            Choice::Right => Some(vote.right.clone()),
        };
        match self.preferred.entry((voter.to_owned(), pair)) {
            Entry::Occupied(before) => {
                self.agreed.push(*before.get() == preferred);
                Use::Repeat
            }
            Entry::Vacant(first) => {
                first.insert(preferred);
                Use::Counted
            }
        }
    }

    fn result(&self, comparison: &Comparison, stale: bool) -> BlindTest {
        let counted = || self.cast.iter().filter(|cast| cast.used == Use::Counted);
        let of = |choice: Choice| self.cast.iter().filter(|cast| cast.choice == choice).count() as f64;
        let agreed = self.agreed.iter().filter(|agreed| **agreed).count();
        let scenes = comparison.scenes.iter().map(|scene| &scene.name);
        let standing = |scene: &String| {
            let rows = Standing::new(comparison, counted().filter(|cast| cast.scene == *scene));
            (scene.clone(), rows)
        };
        BlindTest {
            voters: self.voters.len(),
            votes: counted().count(),
            repeats: self.agreed.len(),
            agreement: share(agreed as f64, self.agreed.len() as f64),
            left: share(of(Choice::Left), of(Choice::Left) + of(Choice::Right)),
            outdated: self.cast.iter().filter(|cast| cast.used == Use::Outdated).count(),
            planted: planted(comparison, counted()),
            pooled: Standing::new(comparison, counted()),
            scenes: scenes.map(standing).filter(|(_, standing)| !standing.rows.is_empty()).collect(),
            replaced: self.replaced.clone(),
            stale,
            cast: self.cast.clone(),
        }
    }
}

/// Names of rows with what they are, as they come first in the comparison.
fn rows(comparison: &Comparison) -> Vec<(&str, Sort)> {
    let mut rows: Vec<(&str, Sort)> = Vec::new();
    for row in comparison.scenes.iter().flat_map(|scene| &scene.rows) {
        if !rows.iter().any(|(name, _)| *name == row.name) {
            rows.push((&row.name, row.sort));
        }
    }
    rows
}

impl Cast {
    /// What the left and the right video have of it.
    fn halves(&self) -> (f64, f64) {
        match self.choice {
            Choice::Left => (1.0, 0.0),
            Choice::Tie => (0.5, 0.5),
            Choice::Right => (0.0, 1.0),
        }
    }
}

impl Standing {
    fn new<'a>(comparison: &Comparison, votes: impl Iterator<Item = &'a Cast>) -> Self {
        let rows = rows(comparison);
        let place = |name: &str| rows.iter().position(|row| row.0 == name);
        let mut wins = vec![vec![0.0; rows.len()]; rows.len()];
        for vote in votes {
            let (Some(left), Some(right)) = (place(&vote.left), place(&vote.right)) else { continue };
            let halves = vote.halves();
            wins[left][right] += halves.0;
            wins[right][left] += halves.1;
        }
        let fitted = strengths(&wins);
        let mut order: Vec<(usize, Estimate)> =
            fitted.iter().enumerate().filter_map(|(i, strength)| Some((i, (*strength)?))).collect();
        order.sort_by(|a, b| b.1.value.total_cmp(&a.1.value));
        let judged = |&(i, strength): &(usize, Estimate)| {
            let won: f64 = wins[i].iter().sum();
            let votes = won + wins.iter().map(|row| row[i]).sum::<f64>();
            let over = order.iter().map(|&(j, _)| wins[i][j]).collect();
            let (name, sort) = (rows[i].0.to_owned(), rows[i].1);
            Some(Judged { name, sort, votes: votes.round() as usize, won: share(won, votes)?, strength, over })
        };
        Self { rows: order.iter().filter_map(judged).collect() }
    }
}

/// How the planted rows did against those that are not.
fn planted<'a>(comparison: &Comparison, votes: impl Iterator<Item = &'a Cast> + Clone) -> Vec<Planted> {
    let bad: Vec<&str> = rows(comparison).into_iter().filter(|row| row.1.is_bad()).map(|row| row.0).collect();
    let result = |&name: &&str| {
        let (mut won, mut count) = (0.0, 0);
        for vote in votes.clone() {
            let halves = vote.halves();
            for (row, other, half) in [(&vote.left, &vote.right, halves.0), (&vote.right, &vote.left, halves.1)] {
                if row == name && !bad.contains(&other.as_str()) {
                    won += half;
                    count += 1;
                }
            }
        }
        Planted { name: name.to_owned(), votes: count, won: share(won, count as f64) }
    };
    bad.iter().map(result).collect()
}
