//! Edge energies from the 4-pixel cells against the same at every pixel: rank correlation over random edges.
//!
//! `ENLIVEN_DATA=… cargo run --release --example edge_energies [CLIP…]` (paths under the data folder). Pieces are 48 × 48
//! pixels of the unrotated levels; an edge is the right half of one against the left half of another.

use std::path::Path;

use enliven::base::error::Result;
use enliven::base::observe::Silent;
use enliven::base::{par, rng};
use enliven::library::analyse::{Analysis, Gathered, gather, library_flow};
use enliven::library::variant::{CELL, PIECE, PIECE_CELLS, SCALES};
use enliven::raster::image::Plane;
use enliven::video::conform::{ConformOptions, Conformed};

const FRAMES: usize = 81;
const EDGES: usize = 3000;
/// Floors of power and textureness in the logarithm, as the library's normalisers have them.
const FLOORS: [f32; 2] = [1e-4, 1e-3];

/// One clip, both ways.
struct Clip {
    pixels: Gathered,
    cells: Analysis,
    mask: Plane,
}

/// A piece: clip, scale, corner in cells.
type Place = (usize, usize, usize, usize);

/// Mean motion, logarithms of spectrum and textureness.
type Row = [f32; 22];

fn row(mean: [f32; 2], spectrum: [f32; 16], texture: [f32; 4]) -> Row {
    std::array::from_fn(|i| match i {
        0..2 => mean[i],
        2..18 => (spectrum[i - 2] + FLOORS[0]).log2(),
        _ => (texture[i - 18] + FLOORS[1]).log2(),
    })
}

fn distance(a: &Row, b: &Row) -> [f32; 3] {
    let part = |range: std::ops::Range<usize>| range.map(|i| (a[i] - b[i]).powi(2)).sum();
    [part(0..2), part(2..18), part(18..22)]
}

impl Clip {
    fn read(path: &Path) -> Result<Self> {
        let mut clip = Conformed::open(path, &ConformOptions::default())?;
        let size = clip.report().working;
        let mut left = FRAMES;
        let mut next = || {
            left = left.saturating_sub(1);
            if left == 0 { Ok(None) } else { clip.next_frame() }
        };
        let pixels = gather(&mut next, size, &Silent, &mut |_| Ok(()), &library_flow())?;
        let (mask, cells) = (pixels.significance(None), pixels.clone().reduce(None));
        Ok(Self { pixels, cells, mask })
    }

    fn pixel(&self, scale: usize, x: usize, y: usize) -> Option<Row> {
        let at = |v: usize| ((v as f32 + 0.5) / SCALES[scale]) as usize;
        let of = &self.pixels.scales[scale];
        let [u, v, _] = of.motion(x, y, 1);
        (self.mask.at(at(x), at(y)) > 0.5).then(|| row([u, v], of.spectrum.at(x, y), of.textureness[0].at(x, y)))
    }

    fn cell(&self, scale: usize, x: usize, y: usize) -> Option<Row> {
        let grid = &self.cells.grids[scale];
        let cell = &grid.cells[y * grid.width + x];
        let row = || {
            row(cell.mean.map(|v| v.to_f32()), cell.spectrum.map(|v| v.to_f32()), cell.textureness.map(|v| v.to_f32()))
        };
        (cell.significant.to_f32() >= 0.5).then(row)
    }
}

/// Mean distances over the places that count in both halves, `width` × `height` of them.
fn edge(
    width: usize,
    height: usize,
    a: impl Fn(usize, usize) -> Option<Row>,
    b: impl Fn(usize, usize) -> Option<Row>,
) -> Option<[f32; 3]> {
    let (mut sums, mut count) = ([0.0f32; 3], 0);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        if let (Some(p), Some(q)) = (a(width + x, y), b(x, y)) {
            sums.iter_mut().zip(distance(&p, &q)).for_each(|(s, d)| *s += d);
            count += 1;
        }
    }
    // A sliver of overlap says nothing in either form.
    (count * 4 >= width * height).then(|| sums.map(|s| s / count as f32))
}

fn ranks(values: &[f32]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let mut ranks = vec![0.0; values.len()];
    order.into_iter().enumerate().for_each(|(rank, i)| ranks[i] = rank as f64);
    ranks
}

/// Spearman's rank correlation.
fn spearman(a: &[f32], b: &[f32]) -> f64 {
    let (a, b) = (ranks(a), ranks(b));
    let mean = (a.len() as f64 - 1.0) / 2.0;
    let product: f64 = a.iter().zip(&b).map(|(a, b)| (a - mean) * (b - mean)).sum();
    product / a.iter().map(|a| (a - mean).powi(2)).sum::<f64>()
}

/// Each term over its median, summed: σ = ρ = 1.
fn energies(distances: &[[f32; 3]]) -> Vec<f32> {
    let median = |term: usize| {
        let mut values: Vec<f32> = distances.iter().map(|d| d[term]).collect();
        values.sort_by(f32::total_cmp);
        values[values.len() / 2]
    };
    let medians = [0, 1, 2].map(median);
    distances.iter().map(|d| (0..3).map(|term| d[term] / medians[term]).sum()).collect()
}

fn main() -> Result<()> {
    let Some(root) = std::env::var_os("ENLIVEN_DATA") else {
        println!("set ENLIVEN_DATA to the folder that holds the clips");
        return Ok(());
    };
    let mut names: Vec<String> = std::env::args().skip(1).collect();
    if names.is_empty() {
        names = ["relaxe_waterfall", "webar_waterfall", "eco_river"].map(|n| format!("clips/water/{n}.mp4")).into();
    }
    let clips = names.iter().map(|name| Clip::read(&Path::new(&root).join(name))).collect::<Result<Vec<_>>>()?;
    let place = |i: usize, end: u64| -> Place {
        let pick = |k: u64, n: usize| rng::below(rng::hash(1, &[i as u64, end, k]), n as u64) as usize;
        let (clip, scale) = (pick(0, clips.len()), pick(1, SCALES.len()));
        let grid = &clips[clip].cells.grids[scale];
        (clip, scale, pick(2, grid.width - PIECE_CELLS + 1), pick(3, grid.height - PIECE_CELLS + 1))
    };
    let both = par::map(8 * EDGES, |i| {
        let ((ca, sa, xa, ya), (cb, sb, xb, yb)) = (place(i, 0), place(i, 1));
        let (a, b) = (&clips[ca], &clips[cb]);
        let cells =
            edge(PIECE_CELLS / 2, PIECE_CELLS, |x, y| a.cell(sa, xa + x, ya + y), |x, y| b.cell(sb, xb + x, yb + y))?;
        let at = |cell: usize, pixel: usize| CELL * cell + pixel;
        let pixels =
            edge(PIECE / 2, PIECE, |x, y| a.pixel(sa, at(xa, x), at(ya, y)), |x, y| b.pixel(sb, at(xb, x), at(yb, y)))?;
        Some((cells, pixels))
    });
    let (cells, pixels): (Vec<_>, Vec<_>) = both.into_iter().flatten().take(EDGES).unzip();
    println!("{} edges of {} clips", cells.len(), clips.len());
    for (term, name) in ["mean motion", "motion spectrum", "textureness"].into_iter().enumerate() {
        let of = |d: &[[f32; 3]]| d.iter().map(|d| d[term]).collect::<Vec<_>>();
        println!("{name}: rank correlation {:.4}", spearman(&of(&cells), &of(&pixels)));
    }
    println!("energy: rank correlation {:.4}", spearman(&energies(&cells), &energies(&pixels)));
    Ok(())
}
