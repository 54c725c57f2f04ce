//! Which piece of which clip lies where on the working image.

use std::collections::BTreeSet;

use crate::library::variant::{CELL, Geometry, PIECE, PIECE_CELLS, Variant, level_size};
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;

/// Band-pass levels of the differences; what is below them (swell, exposure) is dropped.
pub const BANDS: usize = 5;
/// Distance of neighbouring nodes, pixels of the working image.
pub const STRIDE: usize = PIECE / 2;

/// Smoothing of what is spread over the working image, cells.
pub const SPREAD_SIGMA: f32 = 2.0;

/// What is known of one cell of a piece, as it lies on the working image.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PlacedCell {
    /// Mean motion (u, v), pixels per frame.
    pub mean: (f32, f32),
    /// Mean length of the motion, pixels per frame.
    pub activity: f32,
    /// Share of pixels that move significantly, 0 to 1.
    pub significant: f32,
}

/// One piece in its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Placement {
    /// Top left corner of the node on the working image, pixels.
    pub node: (usize, usize),
    /// Index of the source: a clip at a phase of its loop.
    pub source: usize,
    /// The variant of the clip.
    pub variant: Variant,
    /// Top left corner of the piece on the variant's canvas, pixels.
    pub piece: (usize, usize),
    /// The piece's [`PIECE_CELLS`]² cells, row by row.
    pub cells: Vec<PlacedCell>,
}

impl Placement {
    /// Mean motion (u, v) and mean length of the motion over the piece, counting cells by how much of them moves; pixels
    /// per library frame.
    pub fn motion(&self) -> ((f32, f32), f32) {
        let total = self.cells.iter().map(|c| c.significant).sum::<f32>().max(1e-6);
        let mean = |of: fn(&PlacedCell) -> f32| self.cells.iter().map(|c| c.significant * of(c)).sum::<f32>() / total;
        ((mean(|c| c.mean.0), mean(|c| c.mean.1)), mean(|c| c.activity))
    }

    /// A quantity of the cells, interpolated at position `(x, y)` relative to the node's corner, pixels.
    pub fn cell_value(&self, x: f32, y: f32, value: impl Fn(&PlacedCell) -> f32) -> f32 {
        let side = PIECE_CELLS as f32;
        let cell = (PIECE / PIECE_CELLS) as f32;
        let clamp = |v: f32| (v / cell - 0.5).clamp(0.0, side - 1.0);
        let (fx, fy) = (clamp(x), clamp(y));
        let (x0, y0) = (fx as usize, fy as usize);
        let (x1, y1) = ((x0 + 1).min(PIECE_CELLS - 1), (y0 + 1).min(PIECE_CELLS - 1));
        let (ax, ay) = (fx - x0 as f32, fy - y0 as f32);
        let at = |x: usize, y: usize| value(&self.cells[y * PIECE_CELLS + x]);
        let top = at(x0, y0) * (1.0 - ax) + at(x1, y0) * ax;
        let bottom = at(x0, y1) * (1.0 - ax) + at(x1, y1) * ax;
        top * (1.0 - ay) + bottom * ay
    }
}

/// All pieces in their places.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Width and height of the working image.
    pub canvas: (usize, usize),
    /// Width and height of each source's clip, working pixels (multiples of 16).
    pub sources: Vec<(usize, usize)>,
    /// The pieces; nodes lie on the grid of [`STRIDE`].
    pub placements: Vec<Placement>,
}

/// One source at one scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct LevelKey {
    /// Index into [`Layout::sources`].
    pub source: usize,
    /// Scale number of the level.
    pub scale: u8,
}

/// Which sides of a node have no neighbour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Open {
    /// No node to the left.
    pub left: bool,
    /// No node to the right.
    pub right: bool,
    /// No node above.
    pub top: bool,
    /// No node below.
    pub bottom: bool,
}

impl Layout {
    /// The levels that are used, in order; frames are decomposed once for each of them.
    pub fn levels(&self) -> Vec<LevelKey> {
        let used: BTreeSet<_> = self.placements.iter().map(Placement::level).collect();
        used.into_iter().collect()
    }

    /// Geometry of a placement's variant.
    pub fn geometry(&self, placement: &Placement) -> Geometry {
        let (width, height) = self.sources[placement.source];
        placement.variant.geometry(width, height)
    }

    /// Size of a level in pixels.
    pub fn level_size(&self, key: LevelKey) -> (usize, usize) {
        let (width, height) = self.sources[key.source];
        level_size(width, height, key.scale)
    }

    /// The sides of each node without a neighbour.
    pub fn open_sides(&self) -> Vec<Open> {
        let nodes: BTreeSet<_> = self.placements.iter().map(|p| p.node).collect();
        let lacks = |(x, y): (usize, usize), dx: isize, dy: isize| {
            let at = |v: usize, d: isize| v.checked_add_signed(d * STRIDE as isize);
            !matches!((at(x, dx), at(y, dy)), (Some(x), Some(y)) if nodes.contains(&(x, y)))
        };
        let open = |p: &Placement| Open {
            left: lacks(p.node, -1, 0),
            right: lacks(p.node, 1, 0),
            top: lacks(p.node, 0, -1),
            bottom: lacks(p.node, 0, 1),
        };
        self.placements.iter().map(open).collect()
    }

    /// A value per placement, blended over the working image on cells of [`CELL`] pixels.
    pub fn spread(&self, values: impl Fn(usize) -> f32) -> Plane {
        let [sum, total] = self.spread_cells(|i, _| [values(i), 1.0]).map(|s| gaussian(&s, SPREAD_SIGMA));
        Plane::from_vec(sum.width, sum.height, sum.data.iter().zip(&total.data).map(|(s, t)| s / t.max(1e-6)).collect())
    }

    /// Sums of values per cell of every placement where it lies, weighted by a tent over the piece.
    pub fn spread_cells<const N: usize>(&self, values: impl Fn(usize, &PlacedCell) -> [f32; N]) -> [Plane; N] {
        let size = (self.canvas.0.div_ceil(CELL), self.canvas.1.div_ceil(CELL));
        let mut sums: [Plane; N] = std::array::from_fn(|_| Plane::zeros(size.0, size.1));
        for (i, placement) in self.placements.iter().enumerate() {
            for (k, cell) in placement.cells.iter().enumerate() {
                let (cx, cy) = (k % PIECE_CELLS, k / PIECE_CELLS);
                let (x, y) = (placement.node.0 / CELL + cx, placement.node.1 / CELL + cy);
                if x < size.0 && y < size.1 {
                    let weight = tent(cx) * tent(cy);
                    sums.iter_mut().zip(values(i, cell)).for_each(|(s, v)| *s.at_mut(x, y) += weight * v);
                }
            }
        }
        sums
    }

    /// Number of each placement's group: those of a group show the same place of the same source in the same pose, so
    /// what they show is one continuous piece of footage.
    pub fn groups(&self) -> Vec<usize> {
        let key = |p: &Placement| {
            let offset = |piece: usize, node: usize| piece as isize - node as isize;
            let Variant { flip, scale, rotation } = p.variant;
            let pose = [isize::from(flip), scale as isize, rotation as isize];
            // One array: sorting a tuple of as many fields takes five seconds to compile.
            [p.source as isize, pose[0], pose[1], pose[2], offset(p.piece.0, p.node.0), offset(p.piece.1, p.node.1)]
        };
        let mut keys: Vec<_> = self.placements.iter().map(key).collect();
        keys.sort_unstable();
        keys.dedup();
        self.placements.iter().map(|p| keys.partition_point(|k| *k < key(p))).collect()
    }
}

/// Weight of a cell within a piece along one axis.
pub fn tent(cell: usize) -> f32 {
    let centre = (cell * CELL + CELL / 2) as f32;
    1.0 - (centre - STRIDE as f32).abs() / STRIDE as f32
}

impl Placement {
    /// The level it is cut from.
    pub fn level(&self) -> LevelKey {
        LevelKey { source: self.source, scale: self.variant.scale }
    }
}
