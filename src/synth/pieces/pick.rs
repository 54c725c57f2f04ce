//! Which piece each node gets: candidates by appearance, labels by energy.

use std::collections::BTreeSet;

use super::choice::Choice;
use super::gate::{MotionGate, PieceMotion};
use super::slowness::Slowness;
use crate::assign::candidates::{self, Candidates, Gate, Pieces};
use crate::assign::energy::Problem;
use crate::assign::nodes::{Node, NodeGrid};
use crate::assign::pair_costs::{Origin, Weights, continuations, pair_costs};
use crate::assign::solve::{self, Solution, solve};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{Observer, stage};
use crate::base::options::nearest;
use crate::base::text::counted;
use crate::base::{par, rng};
use crate::descriptor::dense_sift;
use crate::descriptor::textureness::Textureness;
use crate::descriptor::vocabulary::PIECE_WORDS;
use crate::library::format::MAX_CLIPS;
use crate::library::metadata::ClipMeta;
use crate::library::normalizers::Normalizers;
use crate::library::piece::{ClipId, PieceIx};
use crate::library::reader::{Pack, Piece};
use crate::library::tile::Tile;
use crate::library::variant::{CELL, PIECE, PIECE_CELLS, Variant};
use crate::scene::asked::Wish;
use crate::scene::file::SceneFile;
use crate::scene::scene::{Scene, Still};
use crate::synth::method::Sources;

/// Fewer clips than this give the same motion everywhere.
const FEW_CLIPS: usize = 3;
/// Side of the places that `per_place` counts, pixels of the clip.
const PLACE: u32 = 32;

/// The candidates of every node, over all libraries.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Choices {
    /// Node `n` has entries `offsets[n]..offsets[n + 1]`.
    pub offsets: Vec<usize>,
    /// The pieces, best first.
    pub choices: Vec<Choice>,
    /// Their data terms (Okabe et al. 2011, §5.1), 0 = alike.
    pub data: Vec<f32>,
    /// Nodes for which too few pieces move as asked, so that others were let in.
    pub widened: usize,
}

/// One piece per node.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Labels {
    /// Per node: the piece.
    pub choices: Vec<Choice>,
    /// The labels, and how good they are.
    pub solution: Solution,
    /// Data terms within the energy.
    pub data_energy: f64,
}

/// Finds the candidates of all nodes in all libraries: the pieces whose average image looks most like the node, of those
/// that move as `wishes`, one per node, asks.
///
/// # Errors
/// Libraries without pieces, or without pieces of the tags asked for; damaged packs; a cancel.
pub fn candidates(
    grid: &NodeGrid,
    still: &Still,
    wishes: &[Wish],
    sources: &Sources,
    scene: &Scene,
    options: &candidates::Options,
    observer: &dyn Observer,
) -> Result<Choices> {
    check_without(sources, &scene.settings().without)?;
    let described = dense_sift::describe(&grid.padded(&still.working.luma()));
    let mut found = Vec::new();
    for (number, (path, pack)) in sources.packs.iter().enumerate() {
        let Some(usable) = Usable::of(pack, scene.settings())? else {
            observer.note(&format!("{}: none of its clips may be used (use, without), so it is not", path.display()));
            continue;
        };
        let words = pack.vocabulary()?.words(&described);
        let word = |n: &Node| words.piece(n.x as usize, n.y as usize);
        let nodes: Option<Vec<[u8; PIECE_WORDS]>> = grid.nodes.iter().map(word).collect();
        let nodes = nodes.ok_or_else(|| Error::file(Kind::Data, path, "its grid of words does not fit the nodes"))?;
        let gate =
            still.asked.as_ref().map(|_| gate(pack, &usable, wishes, scene.settings().output.fps)).transpose()?;
        let gate = gate.as_ref().map(|g| g as &dyn Gate);
        let candidates = candidates::search(&nodes, usable.pieces(pack)?, *options, gate, observer)?;
        found.push((number, usable, candidates));
    }
    if found.is_empty() {
        return Err(nothing_usable(sources, scene.settings()));
    }
    let widened = |n: usize| found.iter().any(|f| f.2.widened[n] > 0);
    let widened = (0..grid.nodes.len()).filter(|&n| widened(n)).count();
    if widened > 0 {
        observer.note(&format!(
            "{widened} of {} places: too few pieces move as asked; others, the nearest to it first, were let in",
            grid.nodes.len()
        ));
    }
    let choices = Choices { widened, ..merge(&found, grid.nodes.len(), options.count) };
    tell_few(&choices, sources, observer)?;
    Ok(choices)
}

/// Tells of a library that hardly serves the picture: too few clips look like it, or clips of several fluids do.
fn tell_few(choices: &Choices, sources: &Sources, observer: &dyn Observer) -> Result<()> {
    let clip = |c: &Choice| Ok((c.pack, sources.packs[c.pack].1.piece(c.piece)?.clip));
    let clips: BTreeSet<(usize, u32)> = choices.choices.iter().map(clip).collect::<Result<_>>()?;
    if clips.len() < FEW_CLIPS {
        observer.note(&format!(
            "all the motion comes from {}: it will be seen in many places at once; twenty varied clips make a good library",
            counted(clips.len() as u64, "clip")
        ));
    }
    let tag = |&(pack, clip): &(usize, u32)| sources.packs[pack].1.clips()[clip as usize].tag.as_str();
    let tags: BTreeSet<&str> = clips.iter().map(tag).filter(|tag| !tag.is_empty()).collect();
    if tags.len() > 1 {
        let tags = tags.into_iter().collect::<Vec<_>>().join(" and ");
        observer.note(&format!("clips tagged {tags} are used side by side; --use keeps to one tag"));
    }
    Ok(())
}

/// The gate for what is asked of the nodes, shut for the usable pieces of a pack that move otherwise.
fn gate<'a>(pack: &Pack, usable: &Usable, wishes: &'a [Wish], fps: f32) -> Result<MotionGate<'a>> {
    let pace = pack.parameters().rate as f32 / fps;
    let motion = |i: usize| Ok(PieceMotion::of(&pack.tile(usable.piece(PieceIx(i as u32)))?, pace));
    Ok(MotionGate { wishes, pieces: par::try_map(usable.places.len(), motion)? })
}

/// The best `count` of all libraries' candidates, per node.
fn merge(found: &[(usize, Usable, Candidates)], nodes: usize, count: usize) -> Choices {
    let mut out = Choices { offsets: vec![0], ..Choices::default() };
    for node in 0..nodes {
        let of = |(pack, usable, candidates): &(usize, Usable, Candidates)| {
            let entry = |e: usize| {
                let choice = Choice { pack: *pack, piece: usable.piece(candidates.pieces[e]) };
                (candidates.data_term(e), choice)
            };
            candidates.range(node).map(entry).collect::<Vec<_>>()
        };
        let mut all: Vec<(f32, Choice)> = found.iter().flat_map(of).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        all.truncate(count);
        out.data.extend(all.iter().map(|a| a.0));
        out.choices.extend(all.iter().map(|a| a.1));
        out.offsets.push(out.choices.len());
    }
    out
}

/// The pieces of a pack that may be used: all of them, or copies of the rows of those with the right tags that are not
/// to be left out.
struct Usable {
    some: Option<Selection>,
    places: Vec<u32>,
}

struct Selection {
    numbers: Vec<u32>,
    words: Vec<[u8; PIECE_WORDS]>,
}

impl Usable {
    /// `None` when no clip may be used.
    fn of(pack: &Pack, SceneFile { tags, without, .. }: &SceneFile) -> Result<Option<Self>> {
        let pieces = pack.pieces()?;
        let wanted = |c: &ClipMeta| {
            (tags.is_empty() || tags.contains(&c.tag)) && !without.iter().any(|name| c.id.is_called(name))
        };
        let wanted: Vec<bool> = pack.clips().iter().map(wanted).collect();
        if wanted.iter().all(|&w| w) {
            let places = (0..pieces.len()).map(|i| place(pack, &pieces[i])).collect();
            return Ok((!pieces.is_empty()).then_some(Self { some: None, places }));
        }
        let numbers: Vec<u32> =
            (0..pieces.len() as u32).filter(|&i| wanted[pieces[i as usize].clip as usize]).collect();
        let words = pack.words()?;
        let selection = Selection { words: numbers.iter().map(|&i| words[i as usize]).collect(), numbers };
        let places = selection.numbers.iter().map(|&i| place(pack, &pieces[i as usize])).collect();
        Ok((!selection.numbers.is_empty()).then_some(Self { some: Some(selection), places }))
    }

    fn pieces<'a>(&'a self, pack: &'a Pack) -> Result<Pieces<'a>> {
        let words = match &self.some {
            Some(s) => &s.words[..],
            None => pack.words()?,
        };
        Ok(Pieces { words, places: Some(&self.places) })
    }

    /// The pack's number of a usable piece.
    fn piece(&self, usable: PieceIx) -> PieceIx {
        self.some.as_ref().map_or(usable, |s| PieceIx(s.numbers[usable.0 as usize]))
    }
}

/// A number for the clip and the square of it that a piece shows, whatever its variant.
fn place(pack: &Pack, piece: &Piece) -> u32 {
    let meta = &pack.clips()[piece.clip as usize];
    let variant = piece.variant();
    let half = 0.5 * PIECE as f32;
    let geometry = variant.geometry(meta.width as usize, meta.height as usize);
    let (x, y) = geometry.to_level(f32::from(piece.x) + half, f32::from(piece.y) + half);
    let square = |v: f32| (v / variant.scale_factor()).max(0.0) as u32 / PLACE;
    (piece.clip << 16) | ((square(y) & 0xff) << 8) | (square(x) & 0xff)
}

/// Refuses clips to be left out that no library has: a misspelt one would be used.
fn check_without(sources: &Sources, without: &[String]) -> Result<()> {
    let ids: Vec<ClipId> = sources.packs.iter().flat_map(|(_, pack)| pack.clips()).map(|c| c.id).collect();
    let Some(unknown) = without.iter().find(|name| !ids.iter().any(|id| id.is_called(name))) else { return Ok(()) };
    let names: Vec<String> = ids.iter().map(ClipId::to_string).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let error = Error::new(Kind::Usage, "without", format!("no clip of the library is called {unknown:?}"));
    Err(match nearest(unknown, &names) {
        Some(name) => error.remedy(format!("did you mean {name:?}?")),
        None => error.remedy("`enliven-db inspect` lists its clips"),
    })
}

fn nothing_usable(sources: &Sources, SceneFile { tags, without, .. }: &SceneFile) -> Error {
    let clips = || sources.packs.iter().flat_map(|(_, pack)| pack.clips());
    let known: BTreeSet<&str> = clips().map(|c| c.tag.as_str()).filter(|t| !t.is_empty()).collect();
    if !tags.is_empty() && !clips().any(|c| tags.contains(&c.tag)) {
        let known: Vec<&str> = known.into_iter().collect();
        return Error::new(Kind::Unusable, "use", format!("no clip of the library is tagged {}", tags.join(" or ")))
            .allowed(if known.is_empty() { "its clips have no tags".to_owned() } else { known.join(", ") })
            .remedy("leave --use out, or build the library with enliven-db build --tag");
    }
    if !without.is_empty() {
        return Error::new(Kind::Unusable, "without", "leaves no piece of the library to use")
            .remedy("name fewer clips, or another library");
    }
    Error::new(Kind::Unusable, "library", "holds no pieces").remedy("add clips to it with enliven-db")
}

/// How labels are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabelOptions {
    /// Weights within the smoothness term.
    pub weights: Weights,
    /// Weight of the smoothness term.
    pub lambda: f32,
    /// Weight of the difference in textureness between picture and piece, as part of the data term.
    pub texture: f32,
    /// Weight of the share of the node's fluid where the piece stands still, as part of the data term.
    pub still: f32,
    /// Weight of how slowly the piece changes, as part of the data term.
    pub lively: f32,
    /// Weight of the angle between a piece's motion and the asked direction, as part of the data term.
    pub direction: f32,
    /// Weight of every octave that a piece's speed is too far from the asked one, as part of the data term.
    pub speed: f32,
    /// Frames per second of the output.
    pub fps: f32,
    /// How the energy is minimised.
    pub solver: solve::Options,
}

/// Chooses one candidate per node, such that neighbours move alike (Okabe et al. 2011, §5).
///
/// # Errors
/// Damaged packs, too many pairs, a cancel.
pub fn labels(
    grid: &NodeGrid,
    still: &Still,
    wishes: &[Wish],
    choices: &Choices,
    sources: &Sources,
    options: &LabelOptions,
    observer: &dyn Observer,
) -> Result<Labels> {
    let pack = |c: &Choice| &sources.packs[c.pack].1;
    let tile = |entry: usize| pack(&choices.choices[entry]).tile(choices.choices[entry].piece);
    let origins = choices.choices.iter().map(|c| origin(c, pack(c))).collect::<Result<Vec<_>>>()?;
    let normalizers = common_normalizers(sources);
    let Choices { offsets, data, .. } = choices;
    let mut data = data.clone();
    let (texture, holes) = (texture_term(grid, still, options.texture), still_term(grid, still, options.still));
    add_terms(offsets, &mut data, |n| {
        let (texture, holes, wish) = (texture(n), holes(n), wishes[n]);
        let asked = wish != Wish::default();
        let pack = &pack;
        Ok(move |entry: usize| {
            // One reading of the piece serves all terms.
            let tile = tile(entry)?;
            let pace = pack(&choices.choices[entry]).parameters().rate as f32 / options.fps;
            let misfit = || PieceMotion::of(&tile, pace).misfit(&wish, options.direction, options.speed);
            Ok([texture(&tile), holes(&tile), if asked { misfit() } else { 0.0 }])
        })
    })?;
    if options.lively > 0.0 {
        let slowness_of = Slowness::of(&choices.choices, sources, observer)?;
        add_terms(offsets, &mut data, |_| {
            let slowness = |entry: usize| slowness_of.slowness(&choices.choices[entry], sources);
            Ok(move |entry| Ok([options.lively * slowness(entry)?]))
        })?;
    }
    let pairs = pair_costs(grid, offsets, &origins, tile, &normalizers, options.weights, observer)?;
    let problem = Problem { offsets, data: &data, pairs: &pairs, lambda: options.lambda };
    let solution = stage(observer, "labels", 0, || {
        solve(&problem, &continuations(grid, offsets, &origins), &options.solver, observer)
    })?;
    let chosen = |n: usize| choices.choices[offsets[n] + solution.labels[n] as usize];
    Ok(Labels {
        choices: (0..grid.nodes.len()).map(chosen).collect(),
        data_energy: problem.data_energy(&solution.labels),
        solution,
    })
}

/// A random candidate for every node.
pub fn random_labels(choices: &Choices, seed: u64) -> Labels {
    let Choices { offsets, choices, .. } = choices;
    let label = |n: usize| rng::below(rng::hash(seed, &[n as u64]), (offsets[n + 1] - offsets[n]) as u64) as u32;
    let labels: Vec<u32> = (0..offsets.len() - 1).map(label).collect();
    Labels {
        choices: labels.iter().enumerate().map(|(n, &l)| choices[offsets[n] + l as usize]).collect(),
        solution: Solution { labels, history: vec![0.0], ..Solution::default() },
        data_energy: 0.0,
    }
}

fn origin(choice: &Choice, pack: &Pack) -> Result<Origin> {
    let piece = pack.piece(choice.piece)?;
    let clip = u32::try_from(choice.pack * MAX_CLIPS).unwrap_or(u32::MAX) + piece.clip;
    let footage = clip * Variant::COUNT as u32 + u32::from(piece.variant_index());
    Ok(Origin { footage, x: piece.x, y: piece.y })
}

/// Scales of the smoothness terms over all libraries: the means of their own.
fn common_normalizers(sources: &Sources) -> Normalizers {
    let mean = |of: fn(&Normalizers) -> f32| {
        sources.packs.iter().map(|(_, p)| of(p.normalizers())).sum::<f32>() / sources.packs.len().max(1) as f32
    };
    Normalizers { dc: mean(|n| n.dc), ac: mean(|n| n.ac), texture: mean(|n| n.texture) }
}

/// Per node and piece: `weight` times the mean over levels of |log₂| of the textureness ratio of picture and piece. Words
/// say where the edges are, not how strong: without it quiet pieces are put into rough water.
fn texture_term(grid: &NodeGrid, still: &Still, weight: f32) -> impl Fn(usize) -> TileTerm {
    /// Textureness of flat, noisy footage.
    const FLOOR: f32 = 1.0 / 1024.0;
    let luma = grid.padded(&still.working.luma());
    let mut picture = Textureness::new(luma.width, luma.height);
    picture.add(&luma);
    move |n| {
        let node = &grid.nodes[n];
        let wanted = picture.cell(node.x as usize, node.y as usize, PIECE);
        Box::new(move |tile| {
            let mean =
                |k: usize| tile.cells.iter().map(|c| c.textureness[k].to_f32()).sum::<f32>() / tile.cells.len() as f32;
            let ratio = |k: usize| ((wanted[k] + FLOOR) / (mean(k) + FLOOR)).log2().abs();
            weight * (0..wanted.len()).map(ratio).sum::<f32>() / wanted.len() as f32
        })
    }
}

/// Per node and piece: `weight` times the share of the node's fluid over which the piece has no motion to give: it would
/// be a hole.
fn still_term(grid: &NodeGrid, still: &Still, weight: f32) -> impl Fn(usize) -> TileTerm {
    let matte = grid.padded(&still.working_matte);
    move |n| {
        let node = &grid.nodes[n];
        let (x0, y0) = (node.x as usize, node.y as usize);
        let mut fluid = [0.0f32; PIECE_CELLS * PIECE_CELLS];
        for (x, y) in (0..PIECE).flat_map(|y| (0..PIECE).map(move |x| (x, y))) {
            fluid[y / CELL * PIECE_CELLS + x / CELL] += matte.at(x0 + x, y0 + y);
        }
        let area = fluid.iter().sum::<f32>().max(1.0);
        Box::new(move |tile| {
            let holes = fluid.iter().zip(&tile.cells).map(|(f, c)| f * (1.0 - c.significant.to_f32())).sum::<f32>();
            weight * holes / area
        })
    }
}

/// A part of the data term of a node's candidates, from their pieces' cells.
type TileTerm = Box<dyn Fn(&Tile) -> f32>;

/// Adds to every candidate's data term what `of(node)` says of its entry, one after the other.
fn add_terms<const N: usize, F: Fn(usize) -> Result<[f32; N]>>(
    offsets: &[usize],
    data: &mut [f32],
    of: impl Fn(usize) -> Result<F> + Sync + Send,
) -> Result<()> {
    let terms = par::try_map(offsets.len() - 1, |n| {
        let term = of(n)?;
        (offsets[n]..offsets[n + 1]).map(term).collect::<Result<Vec<[f32; N]>>>()
    })?;
    let entries = data.iter_mut().zip(terms.iter().flatten());
    entries.for_each(|(d, terms)| terms.iter().for_each(|t| *d += t));
    Ok(())
}
