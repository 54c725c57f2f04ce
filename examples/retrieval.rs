//! Does the library find its own pieces again? `cargo run --release --example retrieval -- LIBRARY.pack`
//!
//! *Mean image*: every unrotated full-scale piece is looked up by the mean image it was cut from; it should come first.
//! *Sharp frame*: 48 × 48 squares of one frame, at hashed positions off the grid, should find their own place (within
//! 16 px of the clip, at any scale, flip or rotation) among the hundred candidates.

use std::process::ExitCode;

use enliven::assign::candidates::{Options, Pieces, search};
use enliven::base::error::{Error, Kind, Result};
use enliven::base::observe::Silent;
use enliven::base::rng;
use enliven::cli::common;
use enliven::descriptor::dense_sift::describe;
use enliven::descriptor::vocabulary::{PIECE_WORDS, Vocabulary};
use enliven::library::piece::PieceIx;
use enliven::library::reader::Pack;
use enliven::library::variant::{PIECE, Variant};
use enliven::raster::image::Plane;

/// Squares asked per clip in the test with a sharp frame.
const SQUARES: u64 = 100;
/// How far from its own place a candidate may lie, pixels of the clip.
const NEAR: f32 = 16.0;

/// A square of a clip: its words and its centre.
struct Query {
    words: [u8; PIECE_WORDS],
    centre: (f32, f32),
}

#[derive(Default)]
struct Tally {
    asked: usize,
    found: usize,
    found_unrotated: usize,
}

impl Tally {
    fn share(&self, found: usize) -> f64 {
        100.0 * found as f64 / self.asked.max(1) as f64
    }
}

/// Fewer flat points than half: something to recognise.
fn has_contrast(words: &[u8; PIECE_WORDS], flat: u8) -> bool {
    words.iter().filter(|&&w| w == flat).count() < PIECE_WORDS / 2
}

fn centre(pack: &Pack, ix: PieceIx) -> Result<(u32, Variant, f32, f32)> {
    let piece = pack.piece(ix)?;
    let clip = &pack.clips()[piece.clip as usize];
    let variant = piece.variant();
    let geometry = variant.geometry(clip.width as usize, clip.height as usize);
    let half = (PIECE / 2) as f32;
    let (x, y) = geometry.to_level(f32::from(piece.x) + half, f32::from(piece.y) + half);
    Ok((piece.clip, variant, x / variant.scale_factor(), y / variant.scale_factor()))
}

/// Own pieces of `clip`, full scale and upright: number and corner.
fn upright(pack: &Pack, clip: u32) -> Result<Vec<(PieceIx, usize, usize)>> {
    let plain = Variant { flip: false, scale: 0, rotation: 0 };
    let pieces = pack.pieces()?.iter().enumerate();
    let own = pieces.filter(|(_, p)| p.clip == clip && p.variant() == plain);
    Ok(own.map(|(i, p)| (PieceIx(i as u32), p.x as usize, p.y as usize)).collect())
}

fn mean_image(pack: &Pack, pieces: Pieces, vocabulary: &Vocabulary, clip: u32) -> Result<Tally> {
    let words = vocabulary.words(&describe(&pack.average(clip)?.luma()));
    let asked: Vec<(PieceIx, [u8; PIECE_WORDS])> = upright(pack, clip)?
        .into_iter()
        .filter_map(|(ix, x, y)| Some((ix, words.piece(x, y)?)))
        .filter(|(_, words)| has_contrast(words, vocabulary.flat_word()))
        .collect();
    let nodes: Vec<_> = asked.iter().map(|(_, words)| *words).collect();
    let first = search(&nodes, pieces, Options { count: 1, per_place: 0 }, None, &Silent)?;
    let found = asked.iter().enumerate().filter(|(n, (ix, _))| first.pieces(*n) == [*ix]).count();
    Ok(Tally { asked: asked.len(), found, found_unrotated: found })
}

fn crop(plane: &Plane, x: usize, y: usize) -> Plane {
    Plane::from_fn(PIECE, PIECE, |i, j| plane.at(x + i, y + j))
}

/// Squares at hashed positions within 16 px of an upright piece of the clip.
fn off_grid(pack: &Pack, vocabulary: &Vocabulary, clip: u32) -> Result<Vec<Query>> {
    let meta = &pack.clips()[clip as usize];
    let (width, height) = (meta.width as usize, meta.height as usize);
    let frame = pack.frame(clip, meta.frames as usize / 2)?.luma();
    let own = upright(pack, clip)?;
    let mut queries = Vec::new();
    for i in 0..SQUARES {
        let x = rng::below(rng::hash(1, &[u64::from(clip), i, 0]), (width - PIECE + 1) as u64) as usize;
        let y = rng::below(rng::hash(1, &[u64::from(clip), i, 1]), (height - PIECE + 1) as u64) as usize;
        let held = own.iter().any(|&(_, px, py)| px.abs_diff(x) <= NEAR as usize && py.abs_diff(y) <= NEAR as usize);
        let grid = vocabulary.words(&describe(&crop(&frame, x, y)));
        let half = (PIECE / 2) as f32;
        if let Some(words) = grid.piece(0, 0).filter(|w| held && has_contrast(w, vocabulary.flat_word())) {
            queries.push(Query { words, centre: (x as f32 + half, y as f32 + half) });
        }
    }
    Ok(queries)
}

fn sharp_frame(pack: &Pack, pieces: Pieces, vocabulary: &Vocabulary, clip: u32) -> Result<Tally> {
    let queries = off_grid(pack, vocabulary, clip)?;
    let nodes: Vec<_> = queries.iter().map(|q| q.words).collect();
    let found = search(&nodes, pieces, Options::default(), None, &Silent)?;
    let mut tally = Tally { asked: queries.len(), ..Tally::default() };
    for (n, query) in queries.iter().enumerate() {
        let (mut any, mut unrotated) = (false, false);
        for &ix in found.pieces(n) {
            let (of, variant, x, y) = centre(pack, ix)?;
            let near = of == clip && (x - query.centre.0).abs() <= NEAR && (y - query.centre.1).abs() <= NEAR;
            any |= near;
            unrotated |= near && variant.rotation == 0;
        }
        tally.found += usize::from(any);
        tally.found_unrotated += usize::from(unrotated);
    }
    Ok(tally)
}

fn run() -> Result<()> {
    let path = std::env::args_os().nth(1).ok_or_else(|| {
        Error::new(Kind::Usage, "retrieval", "no library given").remedy("build one with enliven-db build")
    })?;
    let pack = Pack::open(path.as_ref())?;
    let vocabulary = pack.vocabulary()?;
    let pieces = Pieces { words: pack.words()?, places: None };
    println!("{} clips, {} pieces", pack.clips().len(), pack.piece_count());
    println!("{:18} {:>8} {:>8} | {:>8} {:>8} {:>10}", "clip", "asked", "first", "squares", "found", "unrotated");
    let (mut mean, mut sharp) = (Tally::default(), Tally::default());
    for clip in 0..pack.clips().len() as u32 {
        let m = mean_image(&pack, pieces, &vocabulary, clip)?;
        let s = sharp_frame(&pack, pieces, &vocabulary, clip)?;
        println!(
            "{:18} {:>8} {:>7.1}% | {:>8} {:>7.1}% {:>9.1}%",
            pack.clips()[clip as usize].id.to_string(),
            m.asked,
            m.share(m.found),
            s.asked,
            s.share(s.found),
            s.share(s.found_unrotated)
        );
        for (sum, part) in [(&mut mean, m), (&mut sharp, s)] {
            sum.asked += part.asked;
            sum.found += part.found;
            sum.found_unrotated += part.found_unrotated;
        }
    }
    println!("mean image: the right piece first for {:.2} % of {} non-flat pieces", mean.share(mean.found), mean.asked);
    println!(
        "sharp frame: the right place among the candidates for {:.1} % of {} squares ({:.1} % without rotated pieces)",
        sharp.share(sharp.found),
        sharp.asked,
        sharp.share(sharp.found_unrotated)
    );
    Ok(())
}

fn main() -> ExitCode {
    common::main(|| (), |()| run())
}
