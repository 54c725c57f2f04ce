//! The pieces whose appearance is most like a node's (Okabe et al. 2011, §5, Eq. 1; 100 per node: §5).
//!
//! The search is exact: every node is compared with every piece, 64 pieces at a time
//! ([`crate::descriptor::spatial_pyramid::Block`]); ties are broken by the number of the piece.

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::descriptor::spatial_pyramid::{self, BLOCK, Block, Query};
use crate::descriptor::vocabulary::PIECE_WORDS;
use crate::library::piece::PieceIx;

/// Candidates per node (Okabe et al. 2011, §5).
pub const CANDIDATES: usize = 100;

/// What the search reads of a library, one entry per piece, in the order of [`PieceIx`].
#[derive(Debug, Clone, Copy)]
pub struct Pieces<'a> {
    /// The 9 × 9 words.
    pub words: &'a [[u8; PIECE_WORDS]],
    /// A number for the clip and place that a piece shows, equal for pieces that should count as one spot; used only with
    /// [`Options::per_place`].
    pub places: Option<&'a [u32]>,
}

/// How many candidates, and how they are spread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Candidates per node, at least 1; default [`CANDIDATES`].
    pub count: usize,
    /// Of the pieces with one place number, only so many of the best become candidates; 0, the default, means no
    /// limit, and so does the absence of place numbers.
    pub per_place: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { count: CANDIDATES, per_place: 0 }
    }
}

/// Decides which pieces a node may have at all: those that move as the user asked (Okabe et al. 2011, §6).
pub trait Gate: Sync {
    /// True when `node` may have `piece` after `widening` steps of widening; must admit more with more steps.
    fn admits(&self, node: usize, piece: PieceIx, widening: u32) -> bool;
    /// Number of steps after which the gate stands open for all.
    fn steps(&self) -> u32;
}

/// The candidates of all nodes, best first, node after node.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Candidates {
    /// Node `n` has entries `offsets[n]..offsets[n + 1]`.
    pub offsets: Vec<u32>,
    /// The pieces.
    pub pieces: Vec<PieceIx>,
    /// Their histogram intersections, in units of 1 / [`spatial_pyramid::SCORE_ONE`].
    pub scores: Vec<u32>,
    /// Per node: how many steps the gate had to be widened; 0 without a gate.
    pub widened: Vec<u32>,
}

impl Candidates {
    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.widened.len()
    }

    /// Entries of `node` in [`Candidates::pieces`] and [`Candidates::scores`].
    pub fn range(&self, node: usize) -> std::ops::Range<usize> {
        self.offsets[node] as usize..self.offsets[node + 1] as usize
    }

    /// Pieces of `node`, best first.
    pub fn pieces(&self, node: usize) -> &[PieceIx] {
        &self.pieces[self.range(node)]
    }

    /// The data term `V = 1 − I` of entry `entry` (Okabe et al. 2011, Eq. 1, to be minimised).
    pub fn data_term(&self, entry: usize) -> f32 {
        spatial_pyramid::data_term(self.scores[entry])
    }
}

/// The best `options.count` pieces for every node, given by its 9 × 9 words. With a gate, a node that gets fewer
/// candidates than asked (and than there are pieces) widens its gate step by step.
///
/// # Errors
/// When there are no pieces, the tables of `pieces` differ in length, an option is out of range, or after a cancel.
pub fn search(
    nodes: &[[u8; PIECE_WORDS]],
    pieces: Pieces,
    options: Options,
    gate: Option<&dyn Gate>,
    observer: &dyn Observer,
) -> Result<Candidates> {
    check(nodes.len(), pieces, options)?;
    let options = Options { per_place: if pieces.places.is_some() { options.per_place } else { 0 }, ..options };
    // Every share of the nodes sorts all pieces into blocks, so there is just one share per thread.
    let share = nodes.len().div_ceil(par::threads()).max(1);
    let shares: Vec<&[[u8; PIECE_WORDS]]> = nodes.chunks(share).collect();
    let found = observe::stage(observer, "candidates", (shares.len() * pieces.words.len()) as u64, || {
        par::try_map(shares.len(), |i| search_share(i * share, shares[i], pieces, options, gate, observer))
    })?;
    let mut out = Candidates { offsets: vec![0], ..Candidates::default() };
    for top in found.iter().flatten() {
        out.pieces.extend(top.entries.iter().map(|e| PieceIx(e.piece)));
        out.scores.extend(top.entries.iter().map(|e| e.score));
        out.offsets.push(out.pieces.len() as u32);
        out.widened.push(top.widening);
    }
    Ok(out)
}

fn check(nodes: usize, pieces: Pieces, options: Options) -> Result<()> {
    let n = pieces.words.len();
    if n == 0 {
        return Err(Error::new(Kind::Unusable, "library", "holds no pieces").remedy("add clips to it, or use another"));
    }
    if pieces.places.is_some_and(|p| p.len() != n) || u32::try_from(n).is_err() {
        return Err(Error::new(Kind::Data, "library", format!("its piece tables do not fit together ({n} pieces)")));
    }
    if options.count == 0 || u32::try_from(nodes.saturating_mul(options.count)).is_err() {
        let problem = format!("{} candidates for each of {nodes} nodes", options.count);
        return Err(Error::new(Kind::Usage, "candidates", problem).allowed(format!("1 or more, say {CANDIDATES}")));
    }
    Ok(())
}

/// Candidates of consecutive nodes, the first of which has number `first`.
fn search_share(
    first: usize,
    nodes: &[[u8; PIECE_WORDS]],
    pieces: Pieces,
    options: Options,
    gate: Option<&dyn Gate>,
    observer: &dyn Observer,
) -> Result<Vec<Top>> {
    let queries: Vec<Query> = nodes.iter().map(Query::new).collect();
    let mut tops: Vec<Top> = nodes.iter().map(|_| Top::new(options, 0)).collect();
    let wanted = options.count.min(pieces.words.len());
    let mut open: Vec<usize> = (0..nodes.len()).collect();
    let mut block = Block::default();
    for widening in 0.. {
        let gate = gate.filter(|gate| widening < gate.steps());
        open.iter().for_each(|&n| tops[n] = Top::new(options, widening));
        for (b, words) in pieces.words.chunks(BLOCK).enumerate() {
            observe::check(observer)?;
            block.load(words);
            for &n in &open {
                let scores = &block.scores(&queries[n])[..words.len()];
                let admits = |piece| gate.is_none_or(|g| g.admits(first + n, PieceIx(piece), widening));
                tops[n].see(b * BLOCK, scores, pieces.places, admits);
            }
            if widening == 0 {
                observer.advance("candidates", words.len() as u64);
            }
        }
        open.retain(|&n| tops[n].entries.len() < wanted);
        if gate.is_none() || open.is_empty() {
            break;
        }
    }
    Ok(tops)
}

/// A piece found.
#[derive(Debug, Clone, Copy)]
struct Entry {
    score: u32,
    piece: u32,
    place: u32,
}

/// The best pieces seen so far of one node, best first; pieces are seen in order, so of equal scores the earlier stays.
///
/// With a limit per place this is still exact: sets of at most `count` pieces with at most `per_place` of each place
/// are the independent sets of a matroid, where always dropping the worst of what a new piece makes too many keeps the
/// best set.
#[derive(Debug, Clone)]
struct Top {
    options: Options,
    entries: Vec<Entry>,
    /// Pieces with a lower score cannot get in.
    least: u32,
    widening: u32,
}

impl Top {
    fn new(options: Options, widening: u32) -> Self {
        Self { options, entries: Vec::new(), least: 0, widening }
    }

    /// Takes what it can use of the pieces from `start` on, which have these scores.
    fn see(&mut self, start: usize, scores: &[u16], places: Option<&[u32]>, admits: impl Fn(u32) -> bool) {
        if scores.iter().all(|&score| u32::from(score) < self.least) {
            return;
        }
        for (piece, &score) in (start..).zip(scores) {
            let score = u32::from(score);
            if score >= self.least && admits(piece as u32) {
                let place = places.map_or(0, |places| places[piece]);
                self.offer(Entry { score, piece: piece as u32, place });
            }
        }
    }

    fn offer(&mut self, entry: Entry) {
        let limit = if self.options.per_place == 0 { usize::MAX } else { self.options.per_place };
        let mut rivals = self.entries.iter().enumerate().rev().filter(|(_, e)| e.place == entry.place);
        let worst_rival = rivals.next().map(|(i, _)| i);
        let surplus = match worst_rival {
            Some(worst) if limit < usize::MAX && 1 + rivals.count() >= limit => Some(worst),
            _ if self.entries.len() == self.options.count => Some(self.entries.len() - 1),
            _ => None,
        };
        if let Some(surplus) = surplus {
            if self.entries[surplus].score >= entry.score {
                return;
            }
            self.entries.remove(surplus);
        }
        let at = self.entries.partition_point(|e| e.score >= entry.score);
        self.entries.insert(at, entry);
        if self.entries.len() == self.options.count {
            self.least = self.entries[self.options.count - 1].score + 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::observe::Silent;
    use crate::base::rng;
    use crate::descriptor::spatial_pyramid::score;
    use proptest::prelude::*;

    /// Pieces of `words` words; every piece but the first few repeats an earlier one with some words changed, so that
    /// scores are high and ties are common.
    fn random_pieces(n: usize, words: u64, seed: u64) -> Vec<[u8; PIECE_WORDS]> {
        let mut pieces: Vec<[u8; PIECE_WORDS]> = Vec::new();
        for i in 0..n {
            let hash = |k: usize, salt| rng::hash(seed, &[i as u64, k as u64, salt]);
            let base = (i >= 8).then(|| pieces[rng::below(hash(0, 1), i as u64) as usize]);
            let change = rng::below(hash(0, 2), 81);
            let word = |k| match base {
                Some(base) if rng::below(hash(k, 3), 81) >= change => base[k],
                _ => rng::below(hash(k, 4), words) as u8,
            };
            pieces.push(std::array::from_fn(word));
        }
        pieces
    }

    /// Everything scored, sorted and taken in order.
    fn brute_force(
        node: &[u8; PIECE_WORDS],
        pieces: &[[u8; PIECE_WORDS]],
        places: &[u32],
        options: Options,
        admits: impl Fn(usize) -> bool,
    ) -> Vec<(u32, usize)> {
        let admitted = (0..pieces.len()).filter(|&i| admits(i));
        let mut all: Vec<(u32, usize)> = admitted.map(|i| (score(node, &pieces[i]), i)).collect();
        all.sort_by_key(|&(score, i)| (std::cmp::Reverse(score), i));
        let mut taken = std::collections::BTreeMap::new();
        all.retain(|&(_, i)| {
            let n: &mut usize = taken.entry(places[i]).or_default();
            *n += 1;
            options.per_place == 0 || *n <= options.per_place
        });
        all.truncate(options.count);
        all
    }

    fn entries(found: &Candidates, node: usize) -> Vec<(u32, usize)> {
        found.range(node).map(|e| (found.scores[e], found.pieces[e].0 as usize)).collect()
    }

    struct Every(u32);

    impl Gate for Every {
        fn admits(&self, node: usize, piece: PieceIx, widening: u32) -> bool {
            (piece.0 + node as u32).is_multiple_of(self.0 >> widening)
        }

        fn steps(&self) -> u32 {
            2
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn exact_search_equals_brute_force(
            n in 1usize..600, words in 1u64..202, seed: u64, count in 1usize..120, per_place in 0usize..4,
            place_count in 1u64..60, nodes in 1usize..4
        ) {
            let pieces = random_pieces(n, words, seed);
            let places: Vec<u32> = (0..n).map(|i| rng::below(rng::hash(seed, &[i as u64]), place_count) as u32).collect();
            let nodes = random_pieces(n + nodes, words, seed).split_off(n);
            let options = Options { count, per_place };
            let all = Pieces { words: &pieces, places: Some(&places) };
            let found = search(&nodes, all, options, None, &Silent).unwrap();
            prop_assert_eq!(found.nodes(), nodes.len());
            for (k, node) in nodes.iter().enumerate() {
                prop_assert_eq!(entries(&found, k), brute_force(node, &pieces, &places, options, |_| true));
            }
        }

        #[test]
        fn a_gate_is_widened_until_there_are_enough(n in 1usize..600, seed: u64, count in 1usize..40) {
            let pieces = random_pieces(n, 30, seed);
            let nodes = random_pieces(n + 2, 30, seed).split_off(n);
            let options = Options { count, ..Options::default() };
            let all = Pieces { words: &pieces, places: None };
            let gate = Every(64);
            let found = search(&nodes, all, options, Some(&gate), &Silent).unwrap();
            for (k, node) in nodes.iter().enumerate() {
                let admitted = |w: u32| (0..n).filter(|&i| w == 2 || gate.admits(k, PieceIx(i as u32), w)).count();
                let expected = (0..2).find(|&w| admitted(w) >= count.min(n)).unwrap_or(2);
                prop_assert_eq!(found.widened[k], expected);
                let admits = |i: usize| expected == 2 || gate.admits(k, PieceIx(i as u32), expected);
                prop_assert_eq!(entries(&found, k), brute_force(node, &pieces, &vec![0; n], options, admits));
            }
        }
    }

    #[test]
    fn any_number_of_threads_gives_the_same_candidates() {
        let pieces = random_pieces(3000, 40, 1);
        let nodes = random_pieces(3100, 40, 1).split_off(3000);
        let all = Pieces { words: &pieces, places: None };
        let run = || search(&nodes, all, Options::default(), None, &Silent).unwrap();
        assert_eq!(par::with_threads(1, run).unwrap(), par::with_threads(2, run).unwrap());
    }

    #[test]
    fn nonsense_is_refused() {
        let pieces = random_pieces(3, 5, 1);
        let run = |pieces, count| search(&[], pieces, Options { count, per_place: 0 }, None, &Silent);
        let all = Pieces { words: &pieces, places: None };
        assert_eq!(run(all, 1).unwrap().nodes(), 0);
        assert!(run(all, 0).is_err());
        assert!(run(Pieces { places: Some(&[1, 2]), ..all }, 1).is_err());
        assert!(run(Pieces { words: &[], places: None }, 1).is_err());
    }
}
