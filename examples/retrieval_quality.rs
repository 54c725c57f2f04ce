//! How well appearance alone finds a place again, on real clips: `ENLIVEN_DATA=… cargo run --release --example
//! retrieval_quality [-- CLIP…]`; without names, the clips of `clips/water` that `clips.tsv` calls steady.
//!
//! The library is the mean image of each clip's first 75 frames in all variants, stride 32, where the luma of a piece
//! changes over time. Printed are the share of flat points; for nodes that are pieces of a mean image, how often the
//! piece itself comes first; for nodes of one sharp frame on the 24-px grid, how often a piece of the same clip within
//! 16 px of the node (in the clip, any variant) is among the 100 candidates. Nodes with mostly flat points do not count.

use std::path::{Path, PathBuf};

use enliven::assign::candidates::{Options, Pieces, search};
use enliven::base::error::Result;
use enliven::base::observe::Silent;
use enliven::base::par;
use enliven::descriptor::dense_sift::{DIMENSIONS, DescriptorGrid, describe};
use enliven::descriptor::vocabulary::{PIECE_WORDS, Vocabulary, WORDS};
use enliven::library::variant::{Geometry, PIECE, Variant};
use enliven::raster::image::Plane;
use enliven::raster::resample::resize;
use enliven::video::conform::{ConformOptions, Conformed};

const FRAMES: usize = 75;
const STRIDE: usize = 32;
/// Temporal deviation of luma, averaged over a square, from which it counts as moving.
const MOVING: f32 = 2.0 / 255.0;

struct Clip {
    mean: Plane,
    sharp: Plane,
    deviation: Plane,
}

/// Mean, middle frame and temporal deviation of a clip's luma.
fn load(path: &Path) -> Result<Clip> {
    let mut clip = Conformed::open(path, &ConformOptions::default())?;
    let mut frames: Vec<Plane> = Vec::new();
    while let Some(frame) = clip.next_frame()? {
        frames.push(frame.luma());
        if frames.len() == FRAMES {
            break;
        }
    }
    let n = frames.len() as f32;
    let mut mean = Plane::zeros(frames[0].width, frames[0].height);
    let mut square = mean.clone();
    for frame in &frames {
        mean.data.iter_mut().zip(&frame.data).for_each(|(m, v)| *m += v / n);
        square.data.iter_mut().zip(&frame.data).for_each(|(s, v)| *s += v * v / n);
    }
    square.data.iter_mut().zip(&mean.data).for_each(|(s, m)| *s = (*s - m * m).max(0.0).sqrt());
    Ok(Clip { mean, sharp: frames.swap_remove(frames.len() / 2), deviation: square })
}

/// The clip at a variant, on its canvas; places outside the clip repeat its border.
fn seen(plane: &Plane, variant: Variant) -> (Plane, Geometry) {
    let geometry = variant.geometry(plane.width, plane.height);
    let level = resize(plane, geometry.level_width, geometry.level_height);
    let canvas = Plane::from_fn(geometry.width, geometry.height, |x, y| {
        let (lx, ly) = geometry.to_level(x as f32 + 0.5, y as f32 + 0.5);
        level.bilinear(lx, ly)
    });
    (canvas, geometry)
}

fn mean_over(plane: &Plane, x: usize, y: usize) -> f32 {
    let rows = (y..y + PIECE).map(|row| plane.row(row)[x..x + PIECE].iter().sum::<f32>());
    rows.sum::<f32>() / (PIECE * PIECE) as f32
}

/// Where a piece's centre lies in its clip.
struct Place {
    clip: usize,
    x: f32,
    y: f32,
    aligned: bool,
}

/// Descriptors of one variant of one clip, and its pieces: corner and place.
type Cut = (DescriptorGrid, Vec<(usize, usize, Place)>);

/// Cuts one variant of one clip.
fn cut(clips: &[Clip], clip: usize, variant: Variant) -> Cut {
    let (canvas, geometry) = seen(&clips[clip].mean, variant);
    let (deviation, _) = seen(&clips[clip].deviation, variant);
    let mut places = Vec::new();
    for y in (0..(geometry.height + 1).saturating_sub(PIECE)).step_by(STRIDE) {
        for x in (0..(geometry.width + 1).saturating_sub(PIECE)).step_by(STRIDE) {
            if geometry.covers(x, y, PIECE) && mean_over(&deviation, x, y) >= MOVING {
                let half = PIECE as f32 / 2.0;
                let (lx, ly) = geometry.to_level(x as f32 + half, y as f32 + half);
                let factor = clips[clip].mean.width as f32 / geometry.level_width as f32;
                let place = Place { clip, x: lx * factor, y: ly * factor, aligned: variant.index() == 0 };
                places.push((x, y, place));
            }
        }
    }
    (describe(&canvas), places)
}

fn steady(data: &Path) -> Vec<PathBuf> {
    let table = std::fs::read_to_string(data.join("clips.tsv")).unwrap_or_default();
    let rows = table.lines().filter(|line| line.starts_with("clips/water/"));
    rows.filter(|line| line.split('\t').nth(1) == Some("yes"))
        .filter_map(|line| Some(data.join(line.split('\t').next()?)))
        .collect()
}

fn main() -> Result<()> {
    let named: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let data = std::env::var_os("ENLIVEN_DATA").map(PathBuf::from).unwrap_or_default();
    let paths = if named.is_empty() { steady(&data) } else { named };
    let clips = par::try_map(paths.len(), |i| load(&paths[i]))?;
    let variants: Vec<Variant> = Variant::all().collect();
    let jobs: Vec<(usize, Variant)> = (0..clips.len()).flat_map(|c| variants.iter().map(move |&v| (c, v))).collect();
    let cuts = par::map(jobs.len(), |i| cut(&clips, jobs[i].0, jobs[i].1));

    let (points, flat) = cuts.iter().fold((0, 0), |(n, f), (grid, _)| {
        (n + grid.contrast.len(), f + (0..grid.contrast.len()).filter(|&i| grid.is_flat(i)).count())
    });
    println!("{} clips; flat: {:.1} % of {points} points", clips.len(), 100.0 * flat as f32 / points as f32);
    let vocabulary = Vocabulary::train(&sample(&cuts), WORDS, 1, &Silent)?;
    let mut words: Vec<[u8; PIECE_WORDS]> = Vec::new();
    let mut places: Vec<&Place> = Vec::new();
    for (grid, cut) in &cuts {
        let grid = vocabulary.words(grid);
        for (x, y, place) in cut {
            words.extend(grid.piece(*x, *y));
            places.push(place);
        }
    }
    println!("{} pieces", words.len());
    own_mean_image(&vocabulary, &words, &places)?;
    sharp_frame(&clips, &vocabulary, &words, &places)
}

/// At most about a quarter of a million descriptors with contrast.
fn sample(cuts: &[Cut]) -> Vec<u8> {
    let total: usize = cuts.iter().map(|(grid, _)| grid.contrast.len()).sum();
    let every = total.div_ceil(1 << 18);
    let chosen = |grid: &DescriptorGrid| -> Vec<u8> {
        let indices = (0..grid.contrast.len()).step_by(every).filter(|&i| !grid.is_flat(i));
        indices.flat_map(|i| grid.data[i * DIMENSIONS..][..DIMENSIONS].to_vec()).collect()
    };
    cuts.iter().flat_map(|(grid, _)| chosen(grid)).collect()
}

fn mostly_flat(words: &[u8; PIECE_WORDS], vocabulary: &Vocabulary) -> bool {
    2 * words.iter().filter(|&&w| w == vocabulary.flat_word()).count() > PIECE_WORDS
}

fn own_mean_image(vocabulary: &Vocabulary, words: &[[u8; PIECE_WORDS]], places: &[&Place]) -> Result<()> {
    let wanted: Vec<usize> =
        (0..words.len()).filter(|&i| places[i].aligned && !mostly_flat(&words[i], vocabulary)).collect();
    let nodes: Vec<_> = wanted.iter().map(|&i| words[i]).collect();
    let found = search(&nodes, Pieces { words, places: None }, Options::default(), None, &Silent)?;
    let first = (0..nodes.len()).filter(|&n| found.pieces(n)[0].0 as usize == wanted[n]).count();
    println!(
        "own mean image: first in {first} of {} ({:.1} %)",
        nodes.len(),
        100.0 * first as f32 / nodes.len() as f32
    );
    Ok(())
}

fn sharp_frame(clips: &[Clip], vocabulary: &Vocabulary, words: &[[u8; PIECE_WORDS]], places: &[&Place]) -> Result<()> {
    let (mut all_found, mut all) = (0, 0);
    for (c, clip) in clips.iter().enumerate() {
        let grid = vocabulary.words(&describe(&clip.sharp));
        let (mut nodes, mut centres) = (Vec::new(), Vec::new());
        for y in (0..=clip.sharp.height - PIECE).step_by(PIECE / 2) {
            for x in (0..=clip.sharp.width - PIECE).step_by(PIECE / 2) {
                let node = grid.piece(x, y).filter(|node| !mostly_flat(node, vocabulary));
                if let Some(node) = node.filter(|_| mean_over(&clip.deviation, x, y) >= MOVING) {
                    nodes.push(node);
                    centres.push(((x + PIECE / 2) as f32, (y + PIECE / 2) as f32));
                }
            }
        }
        let found = search(&nodes, Pieces { words, places: None }, Options::default(), None, &Silent)?;
        let right = |n: usize| {
            found.pieces(n).iter().any(|p| {
                let place = places[p.0 as usize];
                let near = |a: f32, b: f32| (a - b).abs() <= 16.0;
                place.clip == c && near(place.x, centres[n].0) && near(place.y, centres[n].1)
            })
        };
        let own = |n: usize| found.pieces(n).iter().filter(|p| places[p.0 as usize].clip == c).count();
        let count = (0..nodes.len()).filter(|&n| right(n)).count();
        let share = (0..nodes.len()).map(own).sum::<usize>();
        println!(
            "sharp frame, clip {c}: {count} of {} ({:.1} %), own clip {:.0} % of candidates",
            nodes.len(),
            100.0 * count as f32 / nodes.len().max(1) as f32,
            share as f32 / nodes.len().max(1) as f32
        );
        all_found += count;
        all += nodes.len();
    }
    println!("sharp frame: {all_found} of {all} ({:.1} %)", 100.0 * all_found as f32 / all.max(1) as f32);
    Ok(())
}
