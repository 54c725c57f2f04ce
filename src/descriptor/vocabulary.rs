//! Visual words: repeated bisecting clustering of descriptors, and the nearest word of each (Okabe et al. 2011, §4;
//! Zhao & Karypis 2005).
//!
//! A sample is bisected until there are `k` clusters, always the cluster with the largest squared error next; a few
//! rounds of Lloyd's algorithm over all clusters follow, first on the sample and then on everything, because bisecting
//! never revises its early cuts. Centres are rounded to bytes, which costs at most 1/12 per dimension of squared
//! distance (descriptors have a norm of 512), and makes all distances integers. The dot products come from the
//! floating-point matrix product, where they are exact as well: every partial sum is an integer below 2²⁴. So centres
//! and words are the same for any number of threads and any instruction set.

use macro_rules_attribute::apply;

use super::dense_sift::{DIMENSIONS, DescriptorGrid, PIECE_POINTS};
use crate::base::error::{Error, Kind, Result};
use crate::base::instructions::kernel;
use crate::base::observe::{self, Observer};
use crate::base::{matmul, par, rng};

/// Number of words the paper settles on (§4).
pub const WORDS: usize = 200;
/// Most words a vocabulary can have: a word, and the flat word after the last, are bytes.
pub const MAX_WORDS: usize = 255;
/// Descriptor points of a piece.
pub const PIECE_WORDS: usize = PIECE_POINTS * PIECE_POINTS;

/// Descriptors that are bisected and that the first rounds of refinement see.
const SAMPLE: usize = 1 << 17;
/// Rounds of refinement on the sample, and then on all descriptors.
const SAMPLE_ROUNDS: usize = 12;
const FULL_ROUNDS: usize = 2;
/// Of a cluster to be cut in two, at most so many members take part in the trials.
const TRIAL_MEMBERS: usize = 1024;
const TRIALS: u64 = 4;
/// Rounds of two-means in a trial, and then on the whole cluster.
const TRIAL_ROUNDS: usize = 4;
const CUT_ROUNDS: usize = 6;
/// Descriptors per matrix product, and per unit of parallel work.
const BLOCK: usize = 256;
const SHARE: usize = 1 << 14;
/// Scores compared together.
const LANES: usize = 16;

/// One descriptor.
type Descriptor = [u8; DIMENSIONS];

/// The visual words of a library.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Vocabulary {
    centers: Vec<u8>,
}

/// Word of each point of a descriptor grid, laid out like [`DescriptorGrid`].
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct WordGrid {
    /// Points in a row.
    pub width: usize,
    /// Rows of points.
    pub height: usize,
    /// `width * height` words; the number of words of the vocabulary stands for "flat".
    pub words: Vec<u8>,
}

impl WordGrid {
    /// The 9 × 9 words, row by row, of the 48 × 48 piece whose corner is at pixel `(x, y)`, multiples of 4; none when it
    /// does not fit.
    pub fn piece(&self, x: usize, y: usize) -> Option<[u8; PIECE_WORDS]> {
        let (i, j) = (x / 4, y / 4);
        if i + PIECE_POINTS > self.width || j + PIECE_POINTS > self.height {
            return None;
        }
        let mut words = [0; PIECE_WORDS];
        for (row, out) in words.chunks_exact_mut(PIECE_POINTS).enumerate() {
            out.copy_from_slice(&self.words[(j + row) * self.width + i..][..PIECE_POINTS]);
        }
        Some(words)
    }
}

impl Vocabulary {
    /// A vocabulary from its centres, [`DIMENSIONS`] bytes each, as [`Vocabulary::centers`] gave them.
    ///
    /// # Errors
    /// When there are none, too many, or a broken one.
    pub fn from_centers(centers: Vec<u8>) -> Result<Self> {
        let words = centers.len() / DIMENSIONS;
        if !centers.len().is_multiple_of(DIMENSIONS) || words == 0 || words > MAX_WORDS {
            let problem = format!("{} bytes of word centres", centers.len());
            return Err(Error::new(Kind::Data, "vocabulary", problem)
                .allowed(format!("1 to {MAX_WORDS} words of {DIMENSIONS} bytes")));
        }
        Ok(Self { centers })
    }

    /// Clusters `descriptors` ([`DIMENSIONS`] bytes each, flat ones left out by the caller) into `k` words, fewer when
    /// there are not so many different descriptors. The result depends on the order of the descriptors and on `seed`,
    /// not on threads or machine.
    ///
    /// # Errors
    /// When there is no descriptor, `k` is 0 or above [`MAX_WORDS`], or after a cancel.
    pub fn train(descriptors: &[u8], k: usize, seed: u64, observer: &dyn Observer) -> Result<Self> {
        let (all, rest) = descriptors.as_chunks::<DIMENSIONS>();
        if k == 0 || k > MAX_WORDS {
            return Err(
                Error::new(Kind::Usage, "vocabulary", format!("{k} words asked")).allowed(format!("1 to {MAX_WORDS}"))
            );
        }
        if all.is_empty() || !rest.is_empty() {
            return Err(Error::new(Kind::Unusable, "vocabulary", "there is nothing with contrast to learn words from")
                .remedy("use clips with more texture"));
        }
        observe::stage(observer, "words", (k + SAMPLE_ROUNDS + FULL_ROUNDS) as u64, || {
            let sample = sample(all, seed);
            let mut vocabulary = bisect(sample.clone(), k, seed, observer)?;
            for round in 0..SAMPLE_ROUNDS + FULL_ROUNDS {
                observe::check(observer)?;
                vocabulary.refine(if round < SAMPLE_ROUNDS { &sample } else { all });
                observer.advance("words", 1);
            }
            Ok(vocabulary)
        })
    }

    /// Repeated bisecting alone, on all `descriptors`: the reference that [`Vocabulary::train`] has to match.
    ///
    /// # Errors
    /// Those of [`Vocabulary::train`].
    pub fn train_by_bisecting(descriptors: &[u8], k: usize, seed: u64, observer: &dyn Observer) -> Result<Self> {
        let (all, _) = descriptors.as_chunks::<DIMENSIONS>();
        bisect(all.to_vec(), k.clamp(1, MAX_WORDS), seed, observer)
    }

    /// Centres of the words, [`DIMENSIONS`] bytes each.
    pub fn centers(&self) -> &[u8] {
        &self.centers
    }

    /// Number of words, without the flat one.
    pub fn len(&self) -> usize {
        self.centers.len() / DIMENSIONS
    }

    /// True when there are no words.
    pub fn is_empty(&self) -> bool {
        self.centers.is_empty()
    }

    /// The word of points without contrast: the number of words.
    pub fn flat_word(&self) -> u8 {
        self.len() as u8
    }

    /// The nearest word of every point (ties: the lower number), or the flat word; on the calling thread.
    pub fn words(&self, grid: &DescriptorGrid) -> WordGrid {
        let mut words = Vec::with_capacity(grid.contrast.len());
        let (descriptors, _) = grid.data.as_chunks::<DIMENSIONS>();
        Nearest::new(&self.centers).for_each(descriptors, |_, word, _| words.push(word));
        for (index, word) in words.iter_mut().enumerate() {
            if grid.is_flat(index) {
                *word = self.flat_word();
            }
        }
        WordGrid { width: grid.width, height: grid.height, words }
    }

    /// Mean squared distance of `descriptors` to their nearest words, in squared descriptor units (norm 512).
    pub fn mean_squared_distance(&self, descriptors: &[u8]) -> f64 {
        let (all, _) = descriptors.as_chunks::<DIMENSIONS>();
        let shares: Vec<&[Descriptor]> = all.chunks(SHARE).collect();
        let nearest = Nearest::new(&self.centers);
        let sums = par::map(shares.len(), |i| {
            let mut sum = 0u64;
            nearest.for_each(shares[i], |_, _, distance| sum += u64::from(distance));
            sum
        });
        sums.iter().sum::<u64>() as f64 / all.len().max(1) as f64
    }

    /// One round of Lloyd's algorithm: every centre moves to the mean of the descriptors nearest to it.
    fn refine(&mut self, descriptors: &[Descriptor]) {
        let shares: Vec<&[Descriptor]> = descriptors.chunks(SHARE).collect();
        let nearest = Nearest::new(&self.centers);
        let words = self.len();
        let partial = par::map(shares.len(), |s| {
            let mut clusters = vec![Sum::default(); words];
            nearest.for_each(shares[s], |i, word, _| clusters[usize::from(word)].add(&shares[s][i]));
            clusters
        });
        for (word, center) in self.centers.chunks_exact_mut(DIMENSIONS).enumerate() {
            let mut total = Sum::default();
            partial.iter().for_each(|clusters| total.merge(&clusters[word]));
            if total.count > 0 {
                center.copy_from_slice(&total.mean());
            }
        }
    }
}

/// Exact sum of descriptors.
#[derive(Debug, Clone)]
struct Sum {
    count: u64,
    sum: [u64; DIMENSIONS],
}

impl Default for Sum {
    fn default() -> Self {
        Self { count: 0, sum: [0; DIMENSIONS] }
    }
}

impl Sum {
    fn add(&mut self, descriptor: &Descriptor) {
        self.count += 1;
        self.sum.iter_mut().zip(descriptor).for_each(|(s, &d)| *s += u64::from(d));
    }

    fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.sum.iter_mut().zip(&other.sum).for_each(|(s, o)| *s += o);
    }

    fn of(descriptors: &[Descriptor]) -> Self {
        let mut sum = Self::default();
        descriptors.iter().for_each(|d| sum.add(d));
        sum
    }

    /// Rounded mean; zeros when empty.
    fn mean(&self) -> Descriptor {
        let n = self.count.max(1);
        self.sum.map(|s| ((s + n / 2) / n) as u8)
    }
}

/// At most [`SAMPLE`] of the descriptors, one from each of as many equal stretches.
fn sample(all: &[Descriptor], seed: u64) -> Vec<Descriptor> {
    if all.len() <= SAMPLE {
        return all.to_vec();
    }
    let start = |i: usize| (i as u128 * all.len() as u128 / SAMPLE as u128) as usize;
    (0..SAMPLE)
        .map(|i| all[start(i) + rng::below(rng::hash(seed, &[i as u64]), (start(i + 1) - start(i)) as u64) as usize])
        .collect()
}

/// A cluster: its stretch of the reordered descriptors and its squared error.
struct Cluster {
    members: std::ops::Range<usize>,
    center: Descriptor,
    error: u64,
}

impl Cluster {
    fn new(descriptors: &[Descriptor], members: std::ops::Range<usize>) -> Self {
        let own = &descriptors[members.clone()];
        let center = Sum::of(own).mean();
        let error = own.iter().map(|d| u64::from(squared_distance(d, &center))).sum();
        Self { members, center, error }
    }
}

/// Cuts the cluster of largest error in two until there are `k`, or none can be cut.
fn bisect(mut descriptors: Vec<Descriptor>, k: usize, seed: u64, observer: &dyn Observer) -> Result<Vocabulary> {
    let mut clusters = vec![Cluster::new(&descriptors, 0..descriptors.len())];
    while clusters.len() < k {
        observe::check(observer)?;
        let worst = (0..clusters.len()).max_by_key(|&i| (clusters[i].error, std::cmp::Reverse(i))).unwrap_or(0);
        if clusters[worst].error == 0 {
            break;
        }
        let members = clusters[worst].members.clone();
        let middle = members.start + cut(&mut descriptors[members.clone()], rng::hash(seed, &[clusters.len() as u64]));
        if middle == members.start || middle == members.end {
            clusters[worst].error = 0;
            continue;
        }
        clusters[worst] = Cluster::new(&descriptors, members.start..middle);
        clusters.push(Cluster::new(&descriptors, middle..members.end));
        observer.advance("words", 1);
    }
    Ok(Vocabulary { centers: clusters.iter().flat_map(|c| c.center).collect() })
}

/// Orders the members so that the two halves of the best cut found lie one after the other; returns where the second
/// begins. Trials on a few members start from random pairs; the best one is refined on all.
fn cut(members: &mut [Descriptor], seed: u64) -> usize {
    let few: Vec<Descriptor> = if members.len() <= TRIAL_MEMBERS {
        members.to_vec()
    } else {
        let pick = |i| rng::below(rng::hash(seed, &[i as u64]), members.len() as u64) as usize;
        (0..TRIAL_MEMBERS).map(|i| members[pick(i)]).collect()
    };
    let trial = |t: u64| {
        let pick = |which| few[rng::below(rng::hash(seed, &[t, which, 1]), few.len() as u64) as usize];
        two_means(&few, (pick(0), pick(1)), TRIAL_ROUNDS)
    };
    let error = |(a, b): &(Descriptor, Descriptor)| -> u64 {
        few.iter().map(|d| u64::from(squared_distance(d, a).min(squared_distance(d, b)))).sum()
    };
    let Some(best) = (0..TRIALS).map(trial).min_by_key(error) else { return 0 };
    let (a, b) = two_means(members, best, CUT_ROUNDS);
    let side = Side::new(&a, &b);
    let mut middle = 0;
    for i in 0..members.len() {
        if side.is_first(&members[i]) {
            members.swap(i, middle);
            middle += 1;
        }
    }
    middle
}

/// Lloyd's algorithm with two centres; an empty side keeps its centre.
fn two_means(members: &[Descriptor], start: (Descriptor, Descriptor), rounds: usize) -> (Descriptor, Descriptor) {
    let total = Sum::of(members);
    let (mut a, mut b) = start;
    for _ in 0..rounds {
        let side = Side::new(&a, &b);
        let mut first = Sum::default();
        members.iter().filter(|d| side.is_first(d)).for_each(|d| first.add(d));
        if first.count == 0 || first.count == total.count {
            break;
        }
        let mut second = total.clone();
        second.count -= first.count;
        second.sum.iter_mut().zip(&first.sum).for_each(|(s, f)| *s -= f);
        let next = (first.mean(), second.mean());
        if next == (a, b) {
            break;
        }
        (a, b) = next;
    }
    (a, b)
}

/// Which of two centres is nearer: one dot product with their difference (ties: the first).
struct Side {
    difference: [i16; DIMENSIONS],
    threshold: i32,
}

impl Side {
    fn new(a: &Descriptor, b: &Descriptor) -> Self {
        let norm = |d: &Descriptor| d.iter().map(|&v| i32::from(v) * i32::from(v)).sum::<i32>();
        let difference = std::array::from_fn(|i| i16::from(b[i]) - i16::from(a[i]));
        Self { difference, threshold: norm(b) - norm(a) }
    }

    fn is_first(&self, descriptor: &Descriptor) -> bool {
        2 * dot(descriptor, &self.difference) <= self.threshold
    }
}

#[apply(kernel)]
fn dot(a: &Descriptor, b: &[i16; DIMENSIONS]) -> i32 {
    a.iter().zip(b).map(|(&a, &b)| i32::from(a) * i32::from(b)).sum()
}

#[apply(kernel)]
fn squared_distance(a: &Descriptor, b: &Descriptor) -> u32 {
    let term = |(&a, &b): (&u8, &u8)| {
        let d = i32::from(i16::from(a) - i16::from(b));
        d * d
    };
    a.iter().zip(b).map(term).sum::<i32>() as u32
}

/// Finds nearest centres: `‖x − c‖² = ‖x‖² + (‖c‖² − 2 x·c)`.
struct Nearest {
    /// Centres as floats, filled up with zeros to a multiple of [`LANES`].
    centers: Vec<f32>,
    /// Their squared norms; infinite for the filling.
    norms: Vec<f32>,
}

impl Nearest {
    fn new(centers: &[u8]) -> Self {
        let words = centers.len() / DIMENSIONS;
        let padded = words.next_multiple_of(LANES);
        let mut floats: Vec<f32> = centers.iter().map(|&v| f32::from(v)).collect();
        floats.resize(padded * DIMENSIONS, 0.0);
        let mut norms: Vec<f32> = floats.chunks_exact(DIMENSIONS).map(|c| c.iter().map(|v| v * v).sum()).collect();
        norms[words..].fill(f32::INFINITY);
        Self { centers: floats, norms }
    }

    /// Calls `f(index, word, squared distance)` for every descriptor, in order.
    fn for_each(&self, descriptors: &[Descriptor], mut f: impl FnMut(usize, u8, u32)) {
        let words = self.norms.len();
        let mut floats = vec![0.0f32; BLOCK.min(descriptors.len()) * DIMENSIONS];
        let mut products = vec![0.0f32; BLOCK.min(descriptors.len()) * words];
        for (b, block) in descriptors.chunks(BLOCK).enumerate() {
            let (floats, products) = (&mut floats[..block.len() * DIMENSIONS], &mut products[..block.len() * words]);
            floats.iter_mut().zip(block.as_flattened()).for_each(|(f, &v)| *f = f32::from(v));
            matmul::a_bt(block.len(), words, DIMENSIONS, floats, &self.centers, products);
            for (i, (row, x)) in products.chunks_exact(words).zip(floats.chunks_exact(DIMENSIONS)).enumerate() {
                let (word, score) = lowest(row, &self.norms);
                f(b * BLOCK + i, word as u8, (score as i32 + squared_norm(x) as i32) as u32);
            }
        }
    }
}

/// Squared norm of a descriptor; exact, since all sums stay below 2²⁴.
#[apply(kernel)]
fn squared_norm(x: &[f32]) -> f32 {
    let mut sums = [0.0f32; LANES];
    for lanes in x.chunks_exact(LANES) {
        sums.iter_mut().zip(lanes).for_each(|(s, v)| *s += v * v);
    }
    sums.iter().sum()
}

/// Position and value of the least `norm − 2 product`; the lowest position among equals.
#[apply(kernel)]
fn lowest(products: &[f32], norms: &[f32]) -> (usize, f32) {
    let mut best = [f32::INFINITY; LANES];
    let mut at = [0u32; LANES];
    let lanes = products.chunks_exact(LANES).zip(norms.chunks_exact(LANES)).enumerate();
    for (chunk, (products, norms)) in lanes {
        for i in 0..LANES {
            let score = norms[i] - 2.0 * products[i];
            at[i] = if score < best[i] { chunk as u32 } else { at[i] };
            best[i] = if score < best[i] { score } else { best[i] };
        }
    }
    let value = best.iter().copied().fold(f32::INFINITY, f32::min);
    let position = |i: usize| at[i] as usize * LANES + i;
    let first = (0..LANES).filter(|&i| best[i] == value).map(position).min().unwrap_or(0);
    (first, value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::observe::Silent;

    /// `n` descriptors scattered by up to `spread` around `clusters` random centres; member `i` is of `i % clusters`.
    fn planted(n: usize, clusters: u64, spread: u64, seed: u64) -> Vec<u8> {
        let value = |i: usize| {
            let (member, d) = ((i / DIMENSIONS) as u64, (i % DIMENSIONS) as u64);
            let center = 20 + rng::below(rng::hash(seed, &[member % clusters, d]), 100);
            (center + rng::below(rng::hash(seed, &[member, d, 7]), 2 * spread + 1) - spread) as u8
        };
        (0..n * DIMENSIONS).map(value).collect()
    }

    fn brute_force(vocabulary: &Vocabulary, descriptor: &[u8]) -> (usize, u32) {
        let distance = |c: &[u8]| c.iter().zip(descriptor).map(|(&a, &b)| u32::from(a.abs_diff(b)).pow(2)).sum();
        let distances: Vec<u32> = vocabulary.centers().chunks_exact(DIMENSIONS).map(distance).collect();
        let least = *distances.iter().min().unwrap();
        (distances.iter().position(|&d| d == least).unwrap(), least)
    }

    #[test]
    fn planted_clusters_are_found() {
        let data = planted(3000, 12, 4, 1);
        let vocabulary = Vocabulary::train(&data, 12, 5, &Silent).unwrap();
        let mut member_of = [None; 12];
        for (i, d) in data.chunks_exact(DIMENSIONS).enumerate() {
            let word = brute_force(&vocabulary, d).0;
            assert_eq!(*member_of[word].get_or_insert(i % 12), i % 12, "word {word} mixes clusters");
        }
        assert!(member_of.iter().all(Option::is_some));
    }

    #[test]
    fn refinement_is_no_worse_than_bisecting() {
        let data = planted(4000, 40, 30, 2);
        let msd = |v: Vocabulary| v.mean_squared_distance(&data);
        let reference = msd(Vocabulary::train_by_bisecting(&data, 25, 3, &Silent).unwrap());
        let refined = msd(Vocabulary::train(&data, 25, 3, &Silent).unwrap());
        assert!(refined <= reference, "{refined} against {reference}");
    }

    #[test]
    fn words_are_the_nearest_with_ties_to_the_lower() {
        let mut centers = planted(37, 37, 0, 4);
        centers.extend_from_within(..DIMENSIONS);
        let vocabulary = Vocabulary::from_centers(centers).unwrap();
        let data = planted(700, 90, 40, 9);
        let (all, _) = data.as_chunks::<DIMENSIONS>();
        Nearest::new(&vocabulary.centers).for_each(all, |i, word, distance| {
            assert_eq!((usize::from(word), distance), brute_force(&vocabulary, &all[i]));
        });
        let extreme = vec![255; DIMENSIONS];
        assert_eq!(Vocabulary::from_centers(extreme.clone()).unwrap().mean_squared_distance(&extreme), 0.0);
    }

    #[test]
    fn any_number_of_threads_gives_the_same_words() {
        let data = planted(20_000, 50, 40, 6);
        let train = || Vocabulary::train(&data, 60, 1, &Silent).unwrap();
        let (one, two) = (par::with_threads(1, train).unwrap(), par::with_threads(2, train).unwrap());
        assert_eq!(one, two);
        assert_eq!(Vocabulary::from_centers(one.centers().to_vec()).unwrap(), one);
    }

    #[test]
    fn few_different_descriptors_give_few_words_and_none_an_error() {
        let data = planted(300, 3, 0, 8);
        assert_eq!(Vocabulary::train(&data, 200, 1, &Silent).unwrap().len(), 3);
        assert!(Vocabulary::train(&[], 200, 1, &Silent).is_err());
        assert!(Vocabulary::train(&data, 256, 1, &Silent).is_err());
        assert!(Vocabulary::from_centers(vec![0; 100]).is_err());
    }

    #[test]
    fn flat_points_get_the_flat_word_and_pieces_their_window() {
        let data = planted(20 * 11, 9, 20, 3);
        let contrast = (0..20 * 11).map(|i| if i % 3 == 0 { 0.0 } else { 1.0 }).collect();
        let grid = DescriptorGrid { width: 20, height: 11, data, contrast };
        let vocabulary = Vocabulary::train(&grid.data, 9, 1, &Silent).unwrap();
        let words = vocabulary.words(&grid);
        assert!(words.words.iter().enumerate().all(|(i, &w)| (w == 9) == (i % 3 == 0)));
        let piece = words.piece(12, 8).unwrap();
        assert!((0..81).all(|k| piece[k] == words.words[(2 + k / 9) * 20 + 3 + k % 9]));
        assert!(words.piece(44, 8).is_some() && words.piece(48, 8).is_none() && words.piece(0, 12).is_none());
    }
}
