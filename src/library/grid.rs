//! Descriptor grids: what is kept of a clip's motion and texture, on cells of 4 × 4 pixels of each level.

use half::f16;

use super::variant::{CELL, level_size};

/// Number of AC bands of the motion spectrum (windows of 32 frames; methods: Welch).
pub const BANDS: usize = 16;
/// Number of levels of the Laplacian scale space of the textureness.
pub const TEXTURE_LEVELS: usize = 4;

/// One cell's row of 24 half floats, in pixels of its level.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Cell {
    /// Mean motion (u, v), pixels of the level per frame.
    pub mean: [f16; 2],
    /// AC power of the motion, P_u + P_v, band 1 to 16, (pixels of the level per frame)².
    pub spectrum: [f16; BANDS],
    /// Mean absolute Laplacian per scale-space level, fine to coarse, of luma in [0, 1].
    pub textureness: [f16; TEXTURE_LEVELS],
    /// Mean over time of the length of the motion, pixels of the level per frame.
    pub activity: f16,
    /// Share of the cell's pixels with significant motion, 0 to 1.
    pub significant: f16,
}

/// The cells of one clip at one scale, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CellGrid {
    /// Cells in a row.
    pub width: usize,
    /// Rows of cells.
    pub height: usize,
    /// `width * height` cells.
    pub cells: Vec<Cell>,
}

impl CellGrid {
    /// An all-zero grid for a clip of `width` × `height` working pixels at scale number `scale`.
    pub fn for_clip(width: usize, height: usize, scale: u8) -> Self {
        let (w, h) = level_size(width, height, scale);
        let (width, height) = (w / CELL, h / CELL);
        Self { width, height, cells: vec![Cell::default(); width * height] }
    }
}
