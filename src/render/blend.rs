//! Integrates the differences of overlapping pieces band by band (Burt & Adelson 1983; Okabe et al. 2011, §6).
//!
//! Each band has its own width of transition: fine detail changes over few pixels, so that two textures are hardly
//! seen at once, and coarse forms over many, so that no edge shows. All weights are fixed in time: they are made once,
//! with normalisation and gain in them, and a frame costs one multiplication and addition per pixel, band and piece.

use super::layout::{BANDS, Layout, LevelKey, Open, Placement, STRIDE};
use super::sample::Window;
use crate::base::par;
use crate::library::variant::Geometry;
use crate::raster::image::Plane;
use crate::raster::pyramid::{collapse, laplacian};

/// Width of the transition between neighbouring pieces per band, fine to coarse, in pixels of the working image.
const TRANSITION: [f32; BANDS] = [12.0, 20.0, 32.0, 48.0, 48.0];
/// Weight left to pixels of a piece that do not move significantly: enough to fill a place nothing else fills.
const STILL_WEIGHT: f32 = 0.03;
/// Sum of weights below which the differences fade out instead of being divided up to full strength.
const FADE: f32 = 0.02;
/// Exponent of the norm by which weights of different footage are divided. 2 keeps the variance; but differences are
/// sparse, and a sum of two sparse textures fills more places than each of them, so its mean magnitude (what an edge
/// is seen by) would be greater on the lines where pieces meet. Less than 2 shares the error between the two.
const NORM: f32 = 1.75;
/// Pixels of the level over which a clip's border fades.
const BORDER: f32 = 6.0;

/// Band-pass levels of one frame's differences at one level of a clip, fine to coarse.
pub type Bands = [Plane; BANDS];

/// The bands of a plane of differences; what lies below them is dropped (see [`BANDS`]).
pub fn bands(differences: &Plane) -> Bands {
    laplacian(differences, BANDS).0.try_into().expect("as many bands as asked for")
}

/// One piece in one band: where it is read, and its weights.
struct Patch {
    level: usize,
    window: Window,
    weights: Vec<f32>,
}

/// Blends the differences of all pieces of a layout.
pub struct Blender {
    canvas: (usize, usize),
    levels: Vec<LevelKey>,
    patches: [Vec<Patch>; BANDS],
}

impl Blender {
    /// Prepares the weights. `gains` holds, per placement, the factor of each band.
    pub fn new(layout: &Layout, gains: &[[f32; BANDS]]) -> Self {
        let levels = layout.levels();
        let (open, groups) = (layout.open_sides(), layout.groups());
        let patches = std::array::from_fn(|band| {
            let mut patches = par::map(layout.placements.len(), |i| {
                let placement = &layout.placements[i];
                let level = levels.binary_search(&placement.level()).expect("a placement's level is used");
                patch(layout, placement, open[i], band, level)
            });
            normalise(&mut patches, &groups, band_size(layout.canvas, band));
            for (patch, gain) in patches.iter_mut().zip(gains) {
                patch.weights.iter_mut().for_each(|w| *w *= gain[band]);
            }
            joined(&patches, &groups)
        });
        Self { canvas: layout.canvas, levels, patches }
    }

    /// The levels whose bands [`Blender::frame`] wants, in order.
    pub fn levels(&self) -> &[LevelKey] {
        &self.levels
    }

    /// The blended differences of one frame, at working size; `levels` holds the bands of [`Blender::levels`].
    ///
    /// # Panics
    /// When there are more or fewer levels.
    pub fn frame(&self, levels: &[Bands]) -> Plane {
        assert_eq!(levels.len(), self.levels.len());
        let blended: [Plane; BANDS] = std::array::from_fn(|band| {
            let (width, height) = band_size(self.canvas, band);
            let mut canvas = Plane::zeros(width, height);
            for patch in &self.patches[band] {
                patch.window.accumulate(&levels[patch.level][band], &patch.weights, &mut canvas);
            }
            canvas
        });
        collapse(&blended, None)
    }
}

/// Size of the canvas at a band.
fn band_size((width, height): (usize, usize), band: usize) -> (usize, usize) {
    (width.div_ceil(1 << band), height.div_ceil(1 << band))
}

/// One piece at one band, with its weights before normalisation.
fn patch(layout: &Layout, placement: &Placement, open: Open, band: usize, level: usize) -> Patch {
    let geometry = layout.geometry(placement);
    let step = (1usize << band) as f32;
    let (width, height) = band_size(layout.canvas, band);
    let half = 0.5 * TRANSITION[band];
    let x = Profile::new(placement.node.0, open.left, open.right, half);
    let y = Profile::new(placement.node.1, open.top, open.bottom, half);
    let window = Window::new(placement, &geometry, band, x.pixels(step, width), y.pixels(step, height));
    let mut weights = Vec::with_capacity(window.width * window.height);
    for j in 0..window.height {
        let py = (window.y + j) as f32 * step + 0.5 * step;
        let wy = y.at(py);
        for i in 0..window.width {
            let px = (window.x + i) as f32 * step + 0.5 * step;
            let (lx, ly) = window.position(i, j);
            let moving =
                placement.cell_value(px - placement.node.0 as f32, py - placement.node.1 as f32, |c| c.significant);
            weights.push(wy * x.at(px) * moving.max(STILL_WEIGHT) * inside(&geometry, lx * step, ly * step));
        }
    }
    Patch { level, window, weights }
}

/// A node's weight along one axis: 1 over its own `STRIDE` pixels in the middle, smooth transitions around them. On a
/// side without neighbour it reaches further, so that the last nodes cover what is left of the matte.
struct Profile {
    low: f32,
    high: f32,
    half: f32,
}

impl Profile {
    fn new(node: usize, open_low: bool, open_high: bool, half: f32) -> Self {
        let reach = |open: bool| if open { STRIDE as f32 } else { 0.0 };
        let low = node as f32 + 0.5 * STRIDE as f32;
        Self { low: low - reach(open_low), high: low + STRIDE as f32 + reach(open_high), half }
    }

    /// The pixels of a band, of `step` working pixels each, where the weight is not zero.
    fn pixels(&self, step: f32, size: usize) -> (usize, usize) {
        let low = ((self.low - self.half) / step).floor().max(0.0) as usize;
        let high = ((self.high + self.half) / step).ceil().max(0.0) as usize;
        (low.min(size), high.min(size))
    }

    fn at(&self, v: f32) -> f32 {
        rise((v - self.low) / self.half) * rise((self.high - v) / self.half)
    }
}

/// Smooth step from 0 at −1 to 1 at 1, with `rise(v) + rise(−v) = 1`.
fn rise(v: f32) -> f32 {
    let t = (0.5 + 0.5 * v).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Fades towards the border of the level, beyond which there is no footage.
fn inside(geometry: &Geometry, x: f32, y: f32) -> f32 {
    let (w, h) = (geometry.level_width as f32, geometry.level_height as f32);
    let depth = x.min(w - x).min(y).min(h - y);
    (depth / BORDER).clamp(0.02, 1.0)
}

/// Divides the weights of a band so that the blend keeps its contrast: within a group, where all show the same
/// footage, weights add up; between groups, whose textures are uncorrelated, variances do. With `W_g` the sum of
/// weights of group `g` at a pixel, the divisor is `(Σ_g W_g^p)^(1/p)` (it is `Σ W` where only one group is present).
fn normalise(patches: &mut [Patch], groups: &[usize], (width, height): (usize, usize)) {
    let mut order: Vec<usize> = (0..patches.len()).collect();
    order.sort_by_key(|&i| groups[i]);
    let mut powers = Plane::zeros(width, height);
    let mut sums = Plane::zeros(width, height);
    for members in order.chunk_by(|&a, &b| groups[a] == groups[b]) {
        for &i in members {
            for (row, weights) in patches[i].rows() {
                row.of(&mut sums).iter_mut().zip(weights).for_each(|(s, w)| *s += w);
            }
        }
        for &i in members {
            for (row, _) in patches[i].rows() {
                // Taking the sum leaves zeros for the next group, and for members that overlap this one.
                let sums = row.of(&mut sums).iter_mut().map(std::mem::take);
                row.of(&mut powers).iter_mut().zip(sums).for_each(|(q, s)| *q += s.powf(NORM));
            }
        }
    }
    let mut scale = powers.map(|s| 1.0 / (s + FADE.powf(NORM)).powf(1.0 / NORM));
    for patch in patches {
        let rows: Vec<Row> = patch.rows().map(|(row, _)| row).collect();
        for (row, weights) in rows.iter().zip(patch.weights.chunks_exact_mut(patch.window.width.max(1))) {
            weights.iter_mut().zip(row.of(&mut scale)).for_each(|(w, s)| *w *= *s);
        }
    }
}

/// One patch for all that overlap and show the same continuous footage, so that it is read once.
fn joined(patches: &[Patch], groups: &[usize]) -> Vec<Patch> {
    let mut order: Vec<usize> = (0..patches.len()).collect();
    order.sort_by_key(|&i| groups[i]);
    let mut out = Vec::new();
    for members in order.chunk_by(|&a, &b| groups[a] == groups[b]) {
        let mut parts: Vec<(Area, Vec<usize>)> = Vec::new();
        for &i in members {
            let mut part = (Area::of(&patches[i].window), vec![i]);
            while let Some(k) = parts.iter().position(|p| p.0.overlaps(&part.0)) {
                let (area, others) = parts.swap_remove(k);
                part.0 = part.0.with(&area);
                part.1.extend(others);
            }
            parts.push(part);
        }
        out.extend(parts.iter().map(|(area, members)| join(patches, area, members)));
    }
    out
}

/// The sum of some patches of one footage over an area that holds them.
fn join(patches: &[Patch], area: &Area, members: &[usize]) -> Patch {
    let first = &patches[members[0]];
    let window = first.window.moved_to(area.x, area.y);
    let mut weights = Plane::zeros(window.width, window.height);
    for &i in members {
        for (row, values) in patches[i].rows() {
            let sums = &mut weights.row_mut(row.y - area.y.0)[row.x - area.x.0..][..row.width];
            sums.iter_mut().zip(values).for_each(|(s, w)| *s += w);
        }
    }
    Patch { level: first.level, window, weights: weights.data }
}

/// A rectangle of the canvas.
struct Area {
    x: (usize, usize),
    y: (usize, usize),
}

impl Area {
    fn of(window: &Window) -> Self {
        Self { x: (window.x, window.x + window.width), y: (window.y, window.y + window.height) }
    }

    fn overlaps(&self, other: &Self) -> bool {
        let overlap = |a: (usize, usize), b: (usize, usize)| a.0 < b.1 && b.0 < a.1;
        overlap(self.x, other.x) && overlap(self.y, other.y)
    }

    /// The smallest rectangle that holds both.
    fn with(&self, other: &Self) -> Self {
        let both = |a: (usize, usize), b: (usize, usize)| (a.0.min(b.0), a.1.max(b.1));
        Self { x: both(self.x, other.x), y: both(self.y, other.y) }
    }
}

/// A row of a window on the canvas.
#[derive(Clone, Copy)]
struct Row {
    x: usize,
    y: usize,
    width: usize,
}

impl Row {
    fn of(self, plane: &mut Plane) -> &mut [f32] {
        &mut plane.row_mut(self.y)[self.x..self.x + self.width]
    }
}

impl Patch {
    fn rows(&self) -> impl Iterator<Item = (Row, &[f32])> {
        let Window { x, y, width, .. } = self.window;
        let rows = self.weights.chunks_exact(width.max(1)).enumerate();
        rows.map(move |(j, weights)| (Row { x, y: y + j, width }, weights))
    }
}
