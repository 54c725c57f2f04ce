//! What depends on all clips: pieces in order, vocabulary, words, normalisers.

use super::assemble::Tables;
use super::format::Parameters;
use super::metadata::{ClipMeta, Metadata, PieceCounts};
use super::normalizers::{self, Normalizers};
use super::options::Options;
use super::piece::ClipId;
use super::pieces::{Cut, Cutting, Levels};
use super::reader::Piece;
use super::segment::Segment;
use super::tile::Tile;
use super::variant::Variant;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::{par, rng};
use crate::descriptor::dense_sift::{DIMENSIONS, DescriptorGrid};
use crate::descriptor::vocabulary::{PIECE_WORDS, Vocabulary};

/// Descriptors the vocabulary is learnt from, about.
const SAMPLES: u64 = 1 << 18;
/// Seed of everything chosen by hash; part of the feature version.
const SEED: u64 = 0x656e_6c69_7665_6e01;

/// The variants in the order of pieces ([`super::piece::PieceRef`]).
fn ordered_variants() -> Vec<Variant> {
    let mut variants: Vec<Variant> = Variant::all().collect();
    variants.sort();
    variants
}

/// A clip's piece as a number that does not depend on the other clips.
fn identity(clip: &ClipId, variant: Variant, x: u16, y: u16) -> u64 {
    let words = clip.0.as_chunks::<8>().0.iter().map(|b| u64::from_le_bytes(*b));
    let clip = words.fold(SEED, |h, w| rng::hash(h, &[w]));
    rng::hash(clip, &[u64::from(variant.index()), u64::from(x), u64::from(y)])
}

/// Computes the tables of a pack from `segments`, which are ordered by clip.
///
/// # Errors
/// When nothing in any clip moves, a segment is damaged, or the run was cancelled.
pub fn compute(segments: &[Segment], options: &Options, observer: &dyn Observer) -> Result<Tables> {
    let total = 3 * segments.len() as u64;
    observe::stage(observer, STAGE, total, || {
        let cutting = Cutting { stride: options.stride as usize, moving_permille: options.moving_permille };
        let cuts = each(segments, observer, |segment| cutting.cut_all(segment))?;
        let pieces = list(&cuts)?;
        let threshold = sampling_threshold(pieces.len());
        let samples = each_indexed(segments, observer, |i, segment| sample(segment, &cuts[i], threshold))?.concat();
        let vocabulary = Vocabulary::train(&samples, options.words as usize, SEED, observer)?;
        drop(samples);
        let words = each_indexed(segments, observer, |i, segment| words(segment, &cuts[i], &vocabulary))?.concat();
        let normalizers = normalize(segments, &pieces)?;
        let parameters = Parameters { words: vocabulary.len() as u32, ..options.parameters() };
        let metadata = Metadata { clips: describe(segments, &cuts, &options.tag), normalizers };
        Ok(Tables { parameters, metadata, vocabulary, pieces, words })
    })
}

/// Name of the stage that [`Observer`] hears of; three steps a clip.
pub const STAGE: &str = "features";

fn each<T>(segments: &[Segment], observer: &dyn Observer, f: impl Fn(&Segment) -> Result<T>) -> Result<Vec<T>> {
    each_indexed(segments, observer, |_, segment| f(segment))
}

/// `f` on one clip after the other; the threads share the variants of each.
fn each_indexed<T>(
    segments: &[Segment],
    observer: &dyn Observer,
    f: impl Fn(usize, &Segment) -> Result<T>,
) -> Result<Vec<T>> {
    let one = |(i, segment): (usize, &Segment)| {
        observe::check(observer)?;
        let result = f(i, segment)?;
        observer.advance(STAGE, 1);
        Ok(result)
    };
    segments.iter().enumerate().map(one).collect()
}

/// All pieces, in order.
fn list(cuts: &[Vec<Cut>]) -> Result<Vec<Piece>> {
    let mut pieces = Vec::new();
    for (clip, cuts) in cuts.iter().enumerate() {
        for variant in ordered_variants() {
            let places = &cuts[variant.index() as usize].places;
            pieces.extend(places.iter().map(|&(x, y)| Piece::new(clip as u32, variant, x, y)));
        }
    }
    if pieces.is_empty() {
        return Err(Error::new(Kind::Unusable, "clips", "no place in any of them moves enough to become a piece")
            .remedy("use clips in which the fluid fills more of the picture"));
    }
    if u32::try_from(pieces.len()).is_err() {
        return Err(Error::new(Kind::Limit, "clips", format!("{} pieces", pieces.len())).allowed("up to 4 billion"));
    }
    Ok(pieces)
}

/// Hashes below this are sampled, about [`SAMPLES`] of all points.
fn sampling_threshold(pieces: usize) -> u64 {
    let points = (pieces * PIECE_WORDS) as u64;
    if points <= SAMPLES { u64::MAX } else { (u128::from(u64::MAX) * u128::from(SAMPLES) / u128::from(points)) as u64 }
}

/// Calls `f(variant, its descriptors)` for the variants that have pieces, on all threads; results in piece order.
fn by_variant<T: Send>(
    segment: &Segment,
    cuts: &[Cut],
    f: impl Fn(Variant, &DescriptorGrid) -> Vec<T> + Sync + Send,
) -> Result<Vec<T>> {
    let levels = Levels::of(segment)?;
    let variants = ordered_variants();
    let parts = par::map(variants.len(), |i| match &cuts[variants[i].index() as usize].places[..] {
        [] => Vec::new(),
        _ => f(variants[i], &levels.describe(variants[i])),
    });
    Ok(parts.into_iter().flatten().collect())
}

/// A clip's share of the descriptors to learn from: chosen by the hash of the piece, flat ones left out.
fn sample(segment: &Segment, cuts: &[Cut], threshold: u64) -> Result<Vec<u8>> {
    let chosen = by_variant(segment, cuts, |variant, grid| {
        let mut descriptors: Vec<[u8; DIMENSIONS]> = Vec::new();
        for &(x, y) in &cuts[variant.index() as usize].places {
            let piece = identity(&segment.meta.id, variant, x, y);
            for point in 0..PIECE_WORDS {
                let (i, j) = (x as usize / 4 + point % 9, y as usize / 4 + point / 9);
                let flat = grid.is_flat(j * grid.width + i);
                if !flat && rng::hash(piece, &[point as u64]) <= threshold {
                    descriptors.extend(grid.at(i, j).as_chunks::<DIMENSIONS>().0);
                }
            }
        }
        descriptors
    })?;
    Ok(chosen.into_flattened())
}

/// Word numbers of a clip's pieces.
fn words(segment: &Segment, cuts: &[Cut], vocabulary: &Vocabulary) -> Result<Vec<[u8; PIECE_WORDS]>> {
    by_variant(segment, cuts, |variant, grid| {
        let words = vocabulary.words(grid);
        let places = &cuts[variant.index() as usize].places;
        // Every place lies on the canvas, so every piece has its words.
        places.iter().filter_map(|&(x, y)| words.piece(x as usize, y as usize)).collect()
    })
}

fn describe(segments: &[Segment], cuts: &[Vec<Cut>], tag: &str) -> Vec<ClipMeta> {
    let mut first_piece = 0;
    let one = |(segment, cuts): (&Segment, &Vec<Cut>)| {
        let mut counts = [PieceCounts::default(); Variant::COUNT];
        counts.iter_mut().zip(cuts).for_each(|(count, cut)| *count = cut.counts);
        let meta = &segment.meta;
        let clip = ClipMeta {
            id: meta.id,
            tag: tag.to_owned(),
            width: meta.width,
            height: meta.height,
            frames: meta.frames,
            first_piece,
            counts,
        };
        first_piece += clip.pieces() as u32;
        clip
    };
    segments.iter().zip(cuts).map(one).collect()
}

/// Normalisers from pairs of pieces chosen by hash.
fn normalize(segments: &[Segment], pieces: &[Piece]) -> Result<Normalizers> {
    let mut by_hash: Vec<(u64, usize)> = par::map(pieces.len(), |i| {
        let piece = &pieces[i];
        (identity(&segments[piece.clip as usize].meta.id, piece.variant(), piece.x, piece.y), i)
    });
    by_hash.sort_unstable();
    by_hash.truncate(2 * normalizers::PAIRS);
    let tile = |i: usize| -> Result<Tile> {
        let piece = &pieces[by_hash[i].1];
        let segment = &segments[piece.clip as usize];
        let geometry = piece.variant().geometry(segment.meta.width as usize, segment.meta.height as usize);
        let grid = segment.grid(piece.variant().scale)?;
        Ok(Tile::sample(&grid, &geometry, piece.x as usize, piece.y as usize))
    };
    let tiles = par::try_map(by_hash.len(), tile)?;
    Ok(Normalizers::measure(&tiles))
}
