//! A piece's 12 × 12 cells, in the piece's own coordinates.

use half::f16;
use half::slice::HalfFloatSliceExt;

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
        let places = std::array::from_fn(|i| {
            let centre = |origin: usize, k: usize| (origin + k * CELL + CELL / 2) as f32;
            let (lx, ly) = geometry.to_level(centre(x, i % PIECE_CELLS), centre(y, i / PIECE_CELLS));
            (lx / CELL as f32, ly / CELL as f32)
        });
        let mut cells = if geometry.aligned() {
            places.map(|(gx, gy): (f32, f32)| *grid.clamped(gx as isize, gy as isize))
        } else {
            interpolate(grid, &places)
        };
        for cell in &mut cells {
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

/// Numbers in a cell.
const N: usize = size_of::<Cell>() / size_of::<f16>();
/// Cells of a tile.
const CELLS: usize = PIECE_CELLS * PIECE_CELLS;

/// Bilinear values of every entry of the cells at grid positions (cell centres at ½). The cells around them are made
/// floats first, row by row, for each is used four times.
fn interpolate(grid: &GridView, places: &[(f32, f32); CELLS]) -> [Cell; CELLS] {
    let corners = places.map(|(x, y)| ((x - 0.5).floor(), (y - 0.5).floor()));
    let bound = |v: isize, size: usize| v.clamp(0, size as isize - 1) as usize;
    let range = |of: fn(&(f32, f32)) -> f32, size: usize| {
        let (low, high) = corners.iter().map(of).fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(v), h.max(v)));
        (bound(low as isize, size), bound(high as isize + 1, size))
    };
    let (left, right) = range(|c| c.0, grid.width);
    let (top, bottom) = range(|c| c.1, grid.height);
    let width = right - left + 1;
    let mut near = vec![[0f32; N]; width * (bottom - top + 1)];
    for (row, y) in near.chunks_exact_mut(width).zip(top..) {
        let cells = &grid.cells[y * grid.width + left..][..width];
        bytemuck::cast_slice::<Cell, f16>(cells).convert_to_f32_slice(row.as_flattened_mut());
    }
    let mut values = [[0f32; N]; CELLS];
    for ((sums, &(x, y)), (x0, y0)) in values.iter_mut().zip(places).zip(corners) {
        let (ax, ay) = (x - 0.5 - x0, y - 0.5 - y0);
        let at = |dx: isize, dy: isize| {
            let (x, y) = (bound(x0 as isize + dx, grid.width), bound(y0 as isize + dy, grid.height));
            &near[(y - top) * width + x - left]
        };
        let corners = [
            (at(0, 0), (1.0 - ax) * (1.0 - ay)),
            (at(1, 0), ax * (1.0 - ay)),
            (at(0, 1), (1.0 - ax) * ay),
            (at(1, 1), ax * ay),
        ];
        for (values, weight) in corners {
            sums.iter_mut().zip(values).for_each(|(s, v)| *s += weight * v);
        }
    }
    let mut cells = [Cell::default(); CELLS];
    bytemuck::cast_slice_mut::<Cell, f16>(&mut cells).convert_from_f32_slice(values.as_flattened());
    cells
}
