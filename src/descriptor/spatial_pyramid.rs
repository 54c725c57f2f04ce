//! Spatial pyramids of visual words and their histogram intersection (Okabe et al. 2011, §4 and Eq. 1; Lazebnik,
//! Schmid & Ponce 2006).
//!
//! A piece has 9 × 9 words. Level 0 is the histogram of all 81. Nine points do not divide into cells, so levels 1 and 2
//! leave out the centre row and column: of the other 8 × 8 points, a cell of level 1 holds 4 × 4 and a cell of level 2
//! holds 2 × 2, and mirroring a piece mirrors its cells. Every level is divided by its number of points and weighted ¼,
//! ¼, ½, so a piece intersects itself with exactly 1:
//!
//! `I = ¼ i₀/81 + ¼ i₁/64 + ½ i₂/64 = (64 i₀ + 81 i₁ + 162 i₂) / 20736`, the `i` being counts; scores are the integer
//! numerators.
//!
//! **Bounds.** Let `j` be the intersection of the two histograms of the 64 points. `min(a + α, b + β) ≥ min(a, b) +
//! min(α, β)`: joining cells or adding points never lowers an intersection, so `i₂ ≤ i₁ ≤ j ≤ min(i₀, 64)`. Hence
//! `64 i₀ + 243 min(i₀, 64)` bounds the score once level 0 is known ([`bound_after_level0`]), and `64 i₀ + 243 i₁` once
//! level 1 is. (`I ≤ I₀`, which holds when all levels count the same points, fails here: two pieces may differ in the
//! 17 points that only level 0 sees.)

use multiversion::multiversion;

use super::vocabulary::PIECE_WORDS;

/// Length of a row of level 0: one count per word number, so any vocabulary fits; 256 bytes.
pub const ROW: usize = 256;
/// Score of a piece with itself: the denominator of all scores.
pub const SCORE_ONE: u32 = 20_736;
/// What one common point counts on each level.
const WEIGHTS: [u32; 3] = [64, 81, 162];
/// Points of levels 1 and 2.
const INNER: usize = 64;

/// Counts of the 81 words: level 0.
pub fn level0(words: &[u8; PIECE_WORDS]) -> [u8; ROW] {
    let mut row = [0; ROW];
    words.iter().for_each(|&w| row[usize::from(w)] += 1);
    row
}

/// Greatest score possible with `i0` common points on level 0.
#[inline]
pub fn bound_after_level0(i0: u32) -> u32 {
    WEIGHTS[0] * i0 + (WEIGHTS[1] + WEIGHTS[2]) * i0.min(INNER as u32)
}

/// The data term of a score: `1 − I`, in [0, 1].
pub fn data_term(score: u32) -> f32 {
    (SCORE_ONE - score.min(SCORE_ONE)) as f32 / SCORE_ONE as f32
}

/// Common points of two level-0 rows: sum of the lesser counts. Rows hold at most 81 points, so bytes do not overflow.
#[inline(always)]
pub(crate) fn common(a: &[u8; ROW], b: &[u8; ROW]) -> u8 {
    const LANES: usize = 64;
    let mut sums = [0u8; LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for i in 0..LANES {
            sums[i] = sums[i].wrapping_add(a[i].min(b[i]));
        }
    }
    sums.iter().fold(0, |total, &s| total.wrapping_add(s))
}

/// The pyramid of one piece or node, ready to be compared with many pieces given by their words.
#[derive(Debug, Clone)]
pub struct Pyramid {
    level0: [u8; ROW],
    level1: [[u8; ROW]; 4],
    level2: Box<[[u8; ROW]; 16]>,
}

impl Pyramid {
    /// The pyramid of a piece's 9 × 9 words, row by row.
    pub fn of(words: &[u8; PIECE_WORDS]) -> Self {
        let cells = by_cell(words);
        let mut level2 = Box::new([[0; ROW]; 16]);
        for (point, &word) in cells.iter().enumerate() {
            level2[point % 16][usize::from(word)] += 1;
        }
        Self { level0: level0(words), level1: level1(&cells), level2 }
    }

    /// Counts of all words.
    pub fn level0(&self) -> &[u8; ROW] {
        &self.level0
    }

    /// Histogram intersection with a piece, times [`SCORE_ONE`].
    pub fn score(&self, words: &[u8; PIECE_WORDS]) -> u32 {
        let i0 = u32::from(common(&self.level0, &level0(words)));
        self.score_above(i0, words, 0).unwrap_or(0)
    }

    /// The score with a piece of which `i0` is known, or none when it cannot reach `least`.
    #[inline]
    pub(crate) fn score_above(&self, i0: u32, words: &[u8; PIECE_WORDS], least: u32) -> Option<u32> {
        let cells = by_cell(words);
        let i1 = intersect1(&self.level1, &cells);
        let known = WEIGHTS[0] * i0 + WEIGHTS[1] * i1;
        if known + WEIGHTS[2] * i1 < least {
            return None;
        }
        let score = known + WEIGHTS[2] * intersect2(&self.level2, &cells);
        (score >= least).then_some(score)
    }
}

/// The 64 words of levels 1 and 2, ordered so that entry `16 n + c` is the n-th point of cell `c` of level 2.
#[inline(always)]
fn by_cell(words: &[u8; PIECE_WORDS]) -> [u8; INNER] {
    ORDER.map(|point| words[usize::from(point)])
}

/// Points of the 9 × 9 grid in the order of [`by_cell`].
const ORDER: [u8; INNER] = {
    let mut order = [0; INNER];
    let mut i = 0;
    while i < INNER {
        let (n, cell) = (i / 16, i % 16);
        // Points 0–3 and 5–8 of a side; the centre, 4, is left out.
        let (x, y) = (cell % 4 * 2 + n % 2, cell / 4 * 2 + n / 2);
        let (x, y) = (x + x / 4, y + y / 4);
        order[i] = (y * 9 + x) as u8;
        i += 1;
    }
    order
};

fn level1(cells: &[u8; INNER]) -> [[u8; ROW]; 4] {
    let mut rows = [[0u8; ROW]; 4];
    for (point, &word) in cells.iter().enumerate() {
        let cell = point % 16;
        rows[cell / 8 * 2 + cell % 4 / 2][usize::from(word)] += 1;
    }
    rows
}

/// Common points on level 1.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn intersect1(own: &[[u8; ROW]; 4], cells: &[u8; INNER]) -> u32 {
    let other = level1(cells);
    own.iter().zip(&other).map(|(a, b)| u32::from(common(a, b))).sum()
}

/// Common points on level 2: a point counts when its cell holds more of its word than the points before it took.
#[inline]
fn intersect2(own: &[[u8; ROW]; 16], cells: &[u8; INNER]) -> u32 {
    let mut common = 0;
    for (c, counts) in own.iter().enumerate() {
        let [p, q, r, s] = [cells[c], cells[16 + c], cells[32 + c], cells[48 + c]];
        let taken = [0, u8::from(q == p), u8::from(r == p) + u8::from(r == q)];
        let last = u8::from(s == p) + u8::from(s == q) + u8::from(s == r);
        common += u32::from(counts[usize::from(p)] > taken[0]) + u32::from(counts[usize::from(q)] > taken[1]);
        common += u32::from(counts[usize::from(r)] > taken[2]) + u32::from(counts[usize::from(s)] > last);
    }
    common
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    fn random_piece(seed: u64, words: u64) -> [u8; PIECE_WORDS] {
        std::array::from_fn(|i| rng::below(rng::hash(seed, &[i as u64]), words) as u8)
    }

    /// Weighted intersection by the definition: a histogram per level and cell.
    fn by_definition(a: &[u8; PIECE_WORDS], b: &[u8; PIECE_WORDS]) -> (u32, [u32; 3]) {
        let mut common = [0u32; 3];
        for (level, common) in common.iter_mut().enumerate() {
            let side = 1 << level;
            for cell in 0..side * side {
                let count = |words: &[u8; PIECE_WORDS], word: u8| {
                    let inside = |i: usize| {
                        let (x, y) = (i % 9, i / 9);
                        let place = |v: usize| {
                            if level == 0 {
                                Some(0)
                            } else if v == 4 {
                                None
                            } else {
                                Some((v - v / 5) * side / 8)
                            }
                        };
                        place(x).zip(place(y)).is_some_and(|(x, y)| y * side + x == cell)
                    };
                    (0..PIECE_WORDS).filter(|&i| words[i] == word && inside(i)).count() as u32
                };
                *common += (0..=255).map(|w| count(a, w).min(count(b, w))).sum::<u32>();
            }
        }
        (64 * common[0] + 81 * common[1] + 162 * common[2], common)
    }

    #[test]
    fn scores_follow_the_definition_and_the_bounds_hold() {
        for seed in 0..60 {
            let words = [2, 5, 20, 201][seed as usize % 4];
            let (a, b) = (random_piece(seed, words), random_piece(1000 + seed / 2, words));
            let (score, common) = by_definition(&a, &b);
            let pyramid = Pyramid::of(&a);
            assert_eq!(pyramid.score(&b), score);
            assert!(common[2] <= common[1] && common[1] <= common[0].min(64), "{common:?}");
            assert!(score <= 64 * common[0] + 243 * common[1] && score <= bound_after_level0(common[0]));
            assert_eq!(pyramid.score_above(common[0], &b, score), Some(score));
            assert_eq!(pyramid.score_above(common[0], &b, score + 1), None);
        }
    }

    #[test]
    fn a_piece_intersects_itself_with_one() {
        let a = random_piece(3, 201);
        assert_eq!(Pyramid::of(&a).score(&a), SCORE_ONE);
        assert_eq!((data_term(SCORE_ONE), data_term(0)), (0.0, 1.0));
        let (zeros, ones) = ([0; PIECE_WORDS], [1; PIECE_WORDS]);
        assert_eq!(Pyramid::of(&zeros).score(&ones), 0);
        assert_eq!(bound_after_level0(81), SCORE_ONE);
    }

    #[test]
    fn mirroring_both_pieces_changes_nothing() {
        let mirror = |w: &[u8; PIECE_WORDS]| -> [u8; PIECE_WORDS] { std::array::from_fn(|i| w[i / 9 * 9 + 8 - i % 9]) };
        for seed in 0..20 {
            let (a, b) = (random_piece(seed, 6), random_piece(seed + 50, 6));
            assert_eq!(Pyramid::of(&a).score(&b), Pyramid::of(&mirror(&a)).score(&mirror(&b)));
        }
    }
}
