//! The target's squares: a grid of nodes over the matte, each to be given a piece (Okabe et al. 2011, §5).
//!
//! Nodes are 48 × 48 squares every 24 px of the *working* picture, from its top left corner. A working size seldom ends
//! with a square, so the picture is continued at the right and bottom by at most 23 px, mirrored at its border
//! ([`NodeGrid::padded`]): every pixel is covered, and every node lies wholly on the padded picture and on the 4-px grid
//! of descriptors. A picture smaller than a square is continued to one square.

use crate::base::error::{Error, Kind, Result};
use crate::library::variant::PIECE;
use crate::raster::image::Plane;

/// Distance between nodes in working pixels: half a piece, so inner pixels are covered by four nodes.
pub const STRIDE: usize = PIECE / 2;

/// One square of the target, side [`PIECE`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Node {
    /// Left edge, working pixels, a multiple of [`STRIDE`].
    pub x: u32,
    /// Top edge, working pixels, a multiple of [`STRIDE`].
    pub y: u32,
}

/// A rectangle in working pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rect {
    /// Left edge.
    pub x: u32,
    /// Top edge.
    pub y: u32,
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
}

/// Two neighbouring nodes and the half square they share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Edge {
    /// Number of the left or upper node.
    pub a: u32,
    /// Number of the right or lower node.
    pub b: u32,
    /// Where both squares lie: Ω of the smoothness term.
    pub overlap: Rect,
}

/// The nodes of a target, row by row, and its 4-connected edges.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct NodeGrid {
    /// Node positions in a row, with or without a node.
    pub columns: usize,
    /// Rows of node positions.
    pub rows: usize,
    /// The nodes.
    pub nodes: Vec<Node>,
    /// The edges, by `a`, to the right before down.
    pub edges: Vec<Edge>,
    numbers: Vec<Option<u32>>,
}

impl NodeGrid {
    /// Nodes for a working picture of the size of `matte` (in [0, 1]): those whose square holds a pixel above `threshold`.
    ///
    /// # Errors
    /// When the matte has no such pixel.
    pub fn over(matte: &Plane, threshold: f32) -> Result<Self> {
        let (columns, rows) = (positions(matte.width), positions(matte.height));
        let mut grid = Self { columns, rows, ..Self::default() };
        for (row, column) in (0..rows).flat_map(|r| (0..columns).map(move |c| (r, c))) {
            let (x, y) = (column * STRIDE, row * STRIDE);
            let wanted = touches(matte, x, y, threshold);
            grid.numbers.push(wanted.then_some(grid.nodes.len() as u32));
            if wanted {
                grid.nodes.push(Node { x: x as u32, y: y as u32 });
            }
        }
        if grid.nodes.is_empty() {
            return Err(Error::new(Kind::Unusable, "matte", "is black, so nothing would move")
                .remedy("paint the fluid white, or leave the matte away to move everything"));
        }
        grid.edges = grid.neighbours();
        Ok(grid)
    }

    /// Number of the node at a position of the grid, if there is one.
    pub fn number(&self, column: usize, row: usize) -> Option<u32> {
        if column >= self.columns { None } else { self.numbers.get(row * self.columns + column).copied().flatten() }
    }

    /// Size of the padded picture on which all nodes lie wholly.
    pub fn padded_size(&self) -> (usize, usize) {
        ((self.columns + 1) * STRIDE, (self.rows + 1) * STRIDE)
    }

    /// A plane of the working picture, continued to [`NodeGrid::padded_size`] by mirroring at its right and bottom border.
    pub fn padded(&self, plane: &Plane) -> Plane {
        let (width, height) = self.padded_size();
        Plane::from_fn(width, height, |x, y| plane.at(reflected(x, plane.width), reflected(y, plane.height)))
    }

    fn neighbours(&self) -> Vec<Edge> {
        const SIDE: u32 = PIECE as u32;
        const SHARED: u32 = (PIECE - STRIDE) as u32;
        let mut edges = Vec::new();
        for (row, column) in (0..self.rows).flat_map(|r| (0..self.columns).map(move |c| (r, c))) {
            let Some(a) = self.number(column, row) else { continue };
            if let Some(b) = self.number(column + 1, row) {
                let Node { x, y } = self.nodes[b as usize];
                edges.push(Edge { a, b, overlap: Rect { x, y, width: SHARED, height: SIDE } });
            }
            if let Some(b) = self.number(column, row + 1) {
                let Node { x, y } = self.nodes[b as usize];
                edges.push(Edge { a, b, overlap: Rect { x, y, width: SIDE, height: SHARED } });
            }
        }
        edges
    }
}

/// Node positions needed to cover `length` pixels.
pub fn positions(length: usize) -> usize {
    length.saturating_sub(PIECE).div_ceil(STRIDE) + 1
}

/// Position `i` folded back into `0..length`, the border pixel repeated once.
fn reflected(i: usize, length: usize) -> usize {
    let i = i % (2 * length);
    i.min(2 * length - 1 - i)
}

fn touches(matte: &Plane, x: usize, y: usize, threshold: f32) -> bool {
    let (right, bottom) = ((x + PIECE).min(matte.width), (y + PIECE).min(matte.height));
    (y..bottom).any(|row| matte.row(row)[x.min(right)..right].iter().any(|&m| m > threshold))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_full_picture_has_the_papers_grid() {
        let grid = NodeGrid::over(&Plane::filled(640, 480, 1.0), 0.5).unwrap();
        assert_eq!((grid.columns, grid.rows, grid.nodes.len()), (26, 19, 494));
        assert_eq!(grid.edges.len(), 25 * 19 + 26 * 18);
        assert_eq!(grid.padded_size(), (648, 480));
    }

    #[test]
    fn a_black_matte_is_an_error_and_a_small_picture_is_one_node() {
        assert_eq!(NodeGrid::over(&Plane::zeros(100, 90), 0.0).unwrap_err().kind(), Kind::Unusable);
        assert!(NodeGrid::over(&Plane::zeros(0, 0), 0.0).is_err());
        let plane = Plane::from_fn(5, 3, |x, y| (x + 10 * y) as f32 + 1.0);
        let grid = NodeGrid::over(&plane, 0.0).unwrap();
        assert_eq!((grid.nodes.len(), grid.edges.len()), (1, 0));
        let padded = grid.padded(&plane);
        assert_eq!((padded.width, padded.height), (48, 48));
        assert_eq!(padded.row(0)[..12], [1.0, 2.0, 3.0, 4.0, 5.0, 5.0, 4.0, 3.0, 2.0, 1.0, 1.0, 2.0]);
        assert_eq!((padded.at(0, 2), padded.at(0, 3), padded.at(0, 6)), (21.0, 21.0, 1.0));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn the_matte_is_covered_and_edges_join_overlapping_nodes(
            width in 1usize..200, height in 1usize..200, left in 0usize..200, top in 0usize..200, size in 1usize..80
        ) {
            let inside = |x: usize, y: usize| x >= left && x < left + size && y >= top && y < top + size;
            let matte = Plane::from_fn(width, height, |x, y| if inside(x, y) { 1.0 } else { 0.0 });
            let Ok(grid) = NodeGrid::over(&matte, 0.5) else {
                prop_assert!(matte.data.iter().all(|&m| m == 0.0));
                return Ok(());
            };
            let (padded_width, padded_height) = grid.padded_size();
            prop_assert!(padded_width >= width && padded_height >= height);
            let holds = |n: &Node, x: usize, y: usize| {
                let (dx, dy) = (x.wrapping_sub(n.x as usize), y.wrapping_sub(n.y as usize));
                dx < PIECE && dy < PIECE
            };
            for n in &grid.nodes {
                prop_assert!(n.x as usize + PIECE <= padded_width && n.y as usize + PIECE <= padded_height);
                prop_assert!((0..width * height).any(|i| matte.data[i] > 0.5 && holds(n, i % width, i / width)));
            }
            for i in (0..width * height).filter(|&i| matte.data[i] > 0.5) {
                prop_assert!(grid.nodes.iter().any(|n| holds(n, i % width, i / width)));
            }
            for e in &grid.edges {
                let (a, b, r) = (grid.nodes[e.a as usize], grid.nodes[e.b as usize], e.overlap);
                prop_assert_eq!((b.x - a.x) + (b.y - a.y), STRIDE as u32);
                prop_assert_eq!((r.x, r.y), (b.x, b.y));
                prop_assert_eq!((r.x + r.width, r.y + r.height), (a.x + 48, a.y + 48));
            }
        }
    }
}
