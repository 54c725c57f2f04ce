//! Spatial pyramids of visual words and their histogram intersection (Okabe et al. 2011, §4 and Eq. 1; Lazebnik,
//! Schmid & Ponce 2006).
//!
//! A piece has 9 × 9 words. Level 0 is the histogram of all 81. Nine points do not divide into cells, so levels 1 and 2
//! leave out the centre row and column: of the other 8 × 8 points, a cell of level 1 holds 4 × 4 and a cell of level 2
//! holds 2 × 2, and mirroring a piece mirrors its cells. Every level is divided by its number of points and weighted ¼,
//! ¼, ½, so a piece intersects itself with exactly 1:
//!
//! `I = ¼ i₀/81 + ¼ i₁/64 + ½ i₂/64 = (64 i₀ + 81 i₁ + 162 i₂) / 20736`, the `i` being common points; scores are the
//! integer numerators.
//!
//! Joining cells or adding points never lowers an intersection, so `i₂ ≤ i₁ ≤ min(i₀, 64)`, which bounds a score by
//! `64 i₀ + 243 min(i₀, 64)` once level 0 is known. (`I ≤ I₀` does not hold: 17 points are in level 0 only.) On real
//! pictures that bound spares next to nothing, since 99 % of unlike pieces share 13 words or more anyway. Instead, a
//! [`Block`] keeps the histograms of 64 pieces side by side: one byte vector per bin, of which a [`Query`] reads only the
//! 150 or so where it has points itself. All three levels of 64 pieces then cost about what a row-by-row scan of level
//! 0 would.

use macro_rules_attribute::apply;

use super::vocabulary::PIECE_WORDS;
use crate::base::instructions::kernel;

/// Length of a row of level 0: one count per word number, so any vocabulary fits; 256 bytes.
pub const ROW: usize = 256;
/// Score of a piece with itself: the denominator of all scores.
pub const SCORE_ONE: u32 = 20_736;
/// Pieces in a [`Block`].
pub const BLOCK: usize = 64;

/// What one common point counts on each level.
const WEIGHTS: [u16; 3] = [64, 81, 162];
/// Bins of the three levels: one row for level 0, four for level 1, sixteen for level 2.
const BINS: usize = 21 * ROW;

/// Histogram intersection of two pieces times [`SCORE_ONE`].
pub fn score(a: &[u8; PIECE_WORDS], b: &[u8; PIECE_WORDS]) -> u32 {
    let mut block = Block::default();
    block.load(std::slice::from_ref(b));
    u32::from(block.scores(&Query::new(a))[0])
}

/// The data term of a score: `1 − I`, in [0, 1].
pub fn data_term(score: u32) -> f32 {
    (SCORE_ONE - score.min(SCORE_ONE)) as f32 / SCORE_ONE as f32
}

/// The pyramid of a node, as the bins it has points in.
#[derive(Debug, Clone)]
pub struct Query {
    /// Per level: bin and count.
    levels: [Vec<(u16, u8)>; 3],
}

impl Query {
    /// The pyramid of 9 × 9 words, row by row.
    pub fn new(words: &[u8; PIECE_WORDS]) -> Self {
        let mut bins: [Vec<u16>; 3] = Default::default();
        for_each_bin(words, |level, bin| bins[level].push(bin));
        let counted = |mut bins: Vec<u16>| {
            bins.sort_unstable();
            bins.chunk_by(|a, b| a == b).map(|equal| (equal[0], equal.len() as u8)).collect()
        };
        Self { levels: bins.map(counted) }
    }
}

/// The pyramids of up to [`BLOCK`] pieces, bin by bin.
#[derive(Debug, Clone)]
pub struct Block {
    counts: Vec<[u8; BLOCK]>,
    loaded: Vec<[u8; PIECE_WORDS]>,
}

impl Default for Block {
    fn default() -> Self {
        Self { counts: vec![[0; BLOCK]; BINS], loaded: Vec::new() }
    }
}

impl Block {
    /// Replaces the pieces by these, the first [`BLOCK`] of them.
    pub fn load(&mut self, pieces: &[[u8; PIECE_WORDS]]) {
        let Self { counts, loaded } = self;
        for (lane, piece) in loaded.iter().enumerate() {
            for_each_bin(piece, |_, bin| counts[usize::from(bin)][lane] = 0);
        }
        loaded.clear();
        loaded.extend_from_slice(&pieces[..pieces.len().min(BLOCK)]);
        for (lane, piece) in loaded.iter().enumerate() {
            for_each_bin(piece, |_, bin| counts[usize::from(bin)][lane] += 1);
        }
    }

    /// Histogram intersections with all pieces, times [`SCORE_ONE`]; 0 where there is no piece.
    pub fn scores(&self, query: &Query) -> [u16; BLOCK] {
        let mut scores = [0; BLOCK];
        for (level, weight) in query.levels.iter().zip(WEIGHTS) {
            add_common(&self.counts, level, weight, &mut scores);
        }
        scores
    }
}

/// Adds `weight` times the common points of one level. No level has more than 81, so bytes hold the sums.
#[apply(kernel)]
fn add_common(counts: &[[u8; BLOCK]], level: &[(u16, u8)], weight: u16, scores: &mut [u16; BLOCK]) {
    let mut common = [0u8; BLOCK];
    for &(bin, count) in level {
        let row = &counts[usize::from(bin)];
        for lane in 0..BLOCK {
            common[lane] = common[lane].wrapping_add(row[lane].min(count));
        }
    }
    for lane in 0..BLOCK {
        scores[lane] += weight * u16::from(common[lane]);
    }
}

/// Calls `f(level, bin)` for the 81 + 64 + 64 points that the levels count.
#[inline(always)]
fn for_each_bin(words: &[u8; PIECE_WORDS], mut f: impl FnMut(usize, u16)) {
    for (&word, &[cell1, cell2]) in words.iter().zip(&CELLS) {
        f(0, u16::from(word));
        if cell1 > 0 {
            f(1, cell1 + u16::from(word));
            f(2, cell2 + u16::from(word));
        }
    }
}

/// First bins of the cells of levels 1 and 2 in which a point of the 9 × 9 grid lies; 0 for the centre row and column.
const CELLS: [[u16; 2]; PIECE_WORDS] = {
    let mut cells = [[0; 2]; PIECE_WORDS];
    let mut point = 0;
    while point < PIECE_WORDS {
        let (x, y) = (point % 9, point / 9);
        if x != 4 && y != 4 {
            let (x, y) = (x - x / 5, y - y / 5);
            cells[point] = [((1 + y / 4 * 2 + x / 4) * ROW) as u16, ((5 + y / 2 * 4 + x / 2) * ROW) as u16];
        }
        point += 1;
    }
    cells
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    fn random_piece(seed: u64, words: u64) -> [u8; PIECE_WORDS] {
        std::array::from_fn(|i| rng::below(rng::hash(seed, &[i as u64]), words) as u8)
    }

    /// Common points per level by the definition: a histogram per level and cell.
    fn by_definition(a: &[u8; PIECE_WORDS], b: &[u8; PIECE_WORDS]) -> [u32; 3] {
        let mut common = [0u32; 3];
        for (level, common) in common.iter_mut().enumerate() {
            let side = 1 << level;
            for cell in 0..side * side {
                let count = |words: &[u8; PIECE_WORDS], word: u8| {
                    let place = |v: usize| match v {
                        _ if level == 0 => Some(0),
                        0..4 => Some(v * side / 8),
                        4 => None,
                        _ => Some((v - 1) * side / 8),
                    };
                    let inside = |i: usize| place(i % 9).zip(place(i / 9)).is_some_and(|(x, y)| y * side + x == cell);
                    (0..PIECE_WORDS).filter(|&i| words[i] == word && inside(i)).count() as u32
                };
                *common += (0..=255).map(|w| count(a, w).min(count(b, w))).sum::<u32>();
            }
        }
        common
    }

    #[test]
    fn scores_follow_the_definition() {
        let mut block = Block::default();
        for round in 0..4u64 {
            let words = [2, 20, 201, 256][round as usize];
            let n = [BLOCK, 7, 1, 40][round as usize];
            let pieces: Vec<_> = (0..n as u64).map(|i| random_piece(100 * round + i, words)).collect();
            block.load(&pieces);
            let node = random_piece(9999 + round, words);
            let scores = block.scores(&Query::new(&node));
            for (i, piece) in pieces.iter().enumerate() {
                let [i0, i1, i2] = by_definition(&node, piece);
                assert!(i2 <= i1 && i1 <= i0.min(64));
                assert_eq!(u32::from(scores[i]), 64 * i0 + 81 * i1 + 162 * i2);
                assert_eq!(u32::from(scores[i]), score(piece, &node));
            }
            assert!(scores[n..].iter().all(|&s| s == 0));
        }
    }

    #[test]
    fn a_piece_intersects_itself_with_one() {
        let a = random_piece(3, 201);
        assert_eq!(score(&a, &a), SCORE_ONE);
        assert_eq!((data_term(SCORE_ONE), data_term(0)), (0.0, 1.0));
        let (zeros, last) = ([0; PIECE_WORDS], [255; PIECE_WORDS]);
        assert_eq!((score(&zeros, &last), score(&last, &last)), (0, SCORE_ONE));
    }

    #[test]
    fn mirroring_both_pieces_changes_nothing() {
        let mirror = |w: &[u8; PIECE_WORDS]| -> [u8; PIECE_WORDS] { std::array::from_fn(|i| w[i / 9 * 9 + 8 - i % 9]) };
        for seed in 0..20 {
            let (a, b) = (random_piece(seed, 6), random_piece(seed + 50, 6));
            assert_eq!(score(&a, &b), score(&mirror(&a), &mirror(&b)));
        }
    }
}
