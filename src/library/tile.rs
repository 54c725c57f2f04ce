//! A piece's 12 × 12 cells, in the piece's own coordinates.

use half::f16;

use super::grid::Cell;
use super::variant::{CELL, Geometry, PIECE_CELLS};

/// Cells of one level of a clip, viewed in a pack.
#[derive(Debug, Clone, Copy)]
pub struct GridView<'a> {
    /// Cells in a row.
    pub width: usize,
    /// Rows of cells.
    pub height: usize,
    /// `width * height` cells, row by row.
    pub cells: &'a [Cell],
}

impl GridView<'_> {
    /// The cell at `(x, y)`, coordinates clamped to the border.
    fn clamped(&self, x: isize, y: isize) -> &Cell {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        &self.cells[y * self.width + x]
    }
}

impl<'a> From<&'a super::grid::CellGrid> for GridView<'a> {
    fn from(grid: &'a super::grid::CellGrid) -> Self {
        Self { width: grid.width, height: grid.height, cells: &grid.cells }
    }
}

/// The 12 × 12 cells of a piece, row by row, motion vectors turned with the piece, in pixels of the variant.
#[derive(Debug, Clone, PartialEq)]
pub struct Tile {
    /// The cells.
    pub cells: [Cell; PIECE_CELLS * PIECE_CELLS],
}

impl Tile {
    /// The cells of the piece at canvas position `(x, y)` (pixels, multiples of 4) of a variant with that geometry.
    /// Unrotated variants read cells exactly (a flip is exact); rotated ones interpolate bilinearly.
    pub fn sample(grid: &GridView, geometry: &Geometry, x: usize, y: usize) -> Self {
        let mut cells = [Cell::default(); PIECE_CELLS * PIECE_CELLS];
        for (i, cell) in cells.iter_mut().enumerate() {
            let centre = |origin: usize, k: usize| (origin + k * CELL + CELL / 2) as f32;
            let (lx, ly) = geometry.to_level(centre(x, i % PIECE_CELLS), centre(y, i / PIECE_CELLS));
            let (gx, gy) = (lx / CELL as f32, ly / CELL as f32);
            *cell = if geometry.aligned() {
                *grid.clamped(gx as isize, gy as isize)
            } else {
                interpolate(grid, gx - 0.5, gy - 0.5)
            };
            let [u, v] = cell.mean.map(f16::to_f32);
            let (u, v) = geometry.vector_from_level(u, v);
            cell.mean = [f16::from_f32(u), f16::from_f32(v)];
        }
        Self { cells }
    }

    /// Mean share of moving pixels, 0 to 1.
    pub fn moving(&self) -> f32 {
        self.cells.iter().map(|c| c.significant.to_f32()).sum::<f32>() / self.cells.len() as f32
    }

    /// Average motion over the moving pixels, pixels of the variant per frame; zero when nothing moves.
    pub fn mean_motion(&self) -> (f32, f32) {
        let mut sum = (0.0, 0.0, 0.0);
        for cell in &self.cells {
            let w = cell.significant.to_f32();
            sum = (sum.0 + w * cell.mean[0].to_f32(), sum.1 + w * cell.mean[1].to_f32(), sum.2 + w);
        }
        if sum.2 > 0.0 { (sum.0 / sum.2, sum.1 / sum.2) } else { (0.0, 0.0) }
    }
}

/// Bilinear value of every entry of the cells at grid position `(x, y)` (cell centres at integers).
fn interpolate(grid: &GridView, x: f32, y: f32) -> Cell {
    let (x0, y0) = (x.floor(), y.floor());
    let (ax, ay) = (x - x0, y - y0);
    let (x0, y0) = (x0 as isize, y0 as isize);
    let corners = [
        (grid.clamped(x0, y0), (1.0 - ax) * (1.0 - ay)),
        (grid.clamped(x0 + 1, y0), ax * (1.0 - ay)),
        (grid.clamped(x0, y0 + 1), (1.0 - ax) * ay),
        (grid.clamped(x0 + 1, y0 + 1), ax * ay),
    ];
    const N: usize = size_of::<Cell>() / size_of::<f16>();
    let mut sums = [0f32; N];
    for (cell, weight) in corners {
        let values: &[f16; N] = bytemuck::cast_ref(cell);
        sums.iter_mut().zip(values).for_each(|(s, v)| *s += weight * v.to_f32());
    }
    bytemuck::cast(sums.map(f16::from_f32))
}
