//! The picture's average image: what a long exposure of the moving scene would have recorded.
//!
//! Image-based motion blur (Brostow & Essa 2001) along the assigned average flow, then a Gaussian that grows with the
//! speed (Okabe et al. 2011, §6). Colours come from inside the matte only.

use super::layout::{Layout, PlacedCell, STRIDE};
use crate::base::par;
use crate::flow::field::Field;
use crate::library::variant::{CELL, PIECE, PIECE_CELLS};
use crate::raster::filter::gaussian;
use crate::raster::image::{Color, Plane};

/// Longest streak, pixels of the working image.
const MAX_STREAK: f32 = 32.0;
/// Widest Gaussian, pixels of the working image.
const MAX_SIGMA: f32 = 4.0;
/// Smoothing of the assigned flow across pieces, cells.
const FLOW_SIGMA: f32 = 2.0;

/// How much the picture is blurred.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Recovery {
    /// Exposure time in frames: a streak is this times the speed long.
    pub shutter: f32,
    /// Standard deviation of the Gaussian per speed, frames.
    pub blur: f32,
    /// Share of the blurred image in the result, 0 to 1; the rest keeps the picture's own detail.
    pub amount: f32,
}

/// Average motion of the pieces where they lie, on cells of [`CELL`] pixels of the working image.
#[derive(Debug, Clone, PartialEq)]
pub struct AssignedMotion {
    /// Mean motion, pixels of the working image per frame.
    pub mean: Field,
    /// Mean length of the motion, pixels per frame.
    pub activity: Plane,
}

/// Blends the cells of all pieces, weighted by where they move.
pub fn assigned_motion(layout: &Layout) -> AssignedMotion {
    let size = (layout.canvas.0.div_ceil(CELL), layout.canvas.1.div_ceil(CELL));
    let mut sums: [Plane; 4] = std::array::from_fn(|_| Plane::zeros(size.0, size.1));
    for placement in &layout.placements {
        for (i, cell) in placement.cells.iter().enumerate() {
            let (cx, cy) = (i % PIECE_CELLS, i / PIECE_CELLS);
            let (x, y) = (placement.node.0 / CELL + cx, placement.node.1 / CELL + cy);
            if x < size.0 && y < size.1 {
                let weight = tent(cx) * tent(cy) * cell.significant.max(0.02);
                let PlacedCell { mean, activity, .. } = *cell;
                let values = [mean.0, mean.1, activity, 1.0];
                sums.iter_mut().zip(values).for_each(|(s, v)| *s.at_mut(x, y) += weight * v);
            }
        }
    }
    let [mut u, mut v, mut activity, total] = sums.map(|s| gaussian(&s, FLOW_SIGMA));
    for plane in [&mut u, &mut v, &mut activity] {
        plane.data.iter_mut().zip(&total.data).for_each(|(p, t)| *p /= t.max(1e-6));
    }
    AssignedMotion { mean: Field { u, v }, activity }
}

/// Weight of a cell within a piece along one axis.
fn tent(cell: usize) -> f32 {
    let centre = (cell * CELL + CELL / 2) as f32;
    1.0 - (centre - (PIECE / 2) as f32).abs() / STRIDE as f32
}

/// The recovered average image at working size; outside the matte it is the picture.
pub fn recover(picture: &Color, matte: &Plane, motion: &AssignedMotion, recovery: &Recovery) -> Color {
    let streaked = streaks(picture, matte, motion, recovery.shutter);
    let blurred = soften(&streaked, matte, motion, recovery.blur);
    let mut out = picture.clone();
    for (plane, blurred) in out.planes.iter_mut().zip(&blurred.planes) {
        for ((p, b), m) in plane.data.iter_mut().zip(&blurred.data).zip(&matte.data) {
            *p += recovery.amount * m * (b - *p);
        }
    }
    out
}

/// Averages colours along the flow, over `shutter` frames of it.
fn streaks(picture: &Color, matte: &Plane, motion: &AssignedMotion, shutter: f32) -> Color {
    let (width, height) = (picture.width(), picture.height());
    let speed = motion.mean.magnitude();
    let rows = par::map(height, |y| {
        let pixel = |x: usize| {
            if matte.at(x, y) == 0.0 || shutter == 0.0 {
                return picture.planes.each_ref().map(|p| p.at(x, y));
            }
            let start = (x as f32 + 0.5, y as f32 + 0.5);
            let length = (shutter * cell_value(&speed, start)).min(MAX_STREAK);
            streak(picture, matte, motion, start, 0.5 * length)
        };
        (0..width).map(pixel).collect::<Vec<_>>()
    });
    let plane = |c: usize| Plane::from_vec(width, height, rows.iter().flatten().map(|p| p[c]).collect());
    Color::from_planes([plane(0), plane(1), plane(2)])
}

/// Mean colour of the streamline through `start`, `half` pixels each way, counting the matte as weight.
fn streak(picture: &Color, matte: &Plane, motion: &AssignedMotion, start: (f32, f32), half: f32) -> [f32; 3] {
    let mut sum = [0.0; 3];
    let mut total = 0.0;
    let mut count = |p: (f32, f32), weight: f32| {
        let weight = weight * matte.bilinear(p.0, p.1).max(1e-3);
        sum.iter_mut().zip(&picture.planes).for_each(|(s, plane)| *s += weight * plane.bilinear(p.0, p.1));
        total += weight;
    };
    count(start, 1.0);
    for sign in [-1.0, 1.0] {
        let (mut p, mut left) = (start, half);
        while left > 0.0 {
            let step = left.min(1.0);
            let (u, v) = (cell_value(&motion.mean.u, p), cell_value(&motion.mean.v, p));
            let norm = (u * u + v * v).sqrt().max(1e-6);
            p = (p.0 + sign * step * u / norm, p.1 + sign * step * v / norm);
            count(p, step);
            left -= 1.0;
        }
    }
    sum.map(|s| s / total)
}

/// Gaussian blur whose width is `blur` times the local speed; colours from inside the matte only.
fn soften(picture: &Color, matte: &Plane, motion: &AssignedMotion, blur: f32) -> Color {
    const SIGMAS: [f32; 4] = [0.0, 1.0, 2.0, MAX_SIGMA];
    let weight = matte.map(|m| m.max(1e-3));
    let blurred = |plane: &Plane, sigma: f32| {
        let mut sum = plane.clone();
        sum.data.iter_mut().zip(&weight.data).for_each(|(s, w)| *s *= w);
        let (mut sum, total) = (gaussian(&sum, sigma), gaussian(&weight, sigma));
        sum.data.iter_mut().zip(&total.data).for_each(|(s, t)| *s /= t);
        sum
    };
    let width = picture.width();
    picture.map_planes(|plane| {
        let stack = SIGMAS.map(|sigma| blurred(plane, sigma));
        Plane::from_fn(width, plane.height, |x, y| {
            let sigma = (blur * cell_value(&motion.activity, (x as f32 + 0.5, y as f32 + 0.5))).min(MAX_SIGMA);
            let i = SIGMAS[1..3].iter().filter(|&&s| sigma >= s).count();
            let t = (sigma - SIGMAS[i]) / (SIGMAS[i + 1] - SIGMAS[i]);
            stack[i].at(x, y) * (1.0 - t) + stack[i + 1].at(x, y) * t
        })
    })
}

/// A plane of cells at a position of the working image.
fn cell_value(cells: &Plane, (x, y): (f32, f32)) -> f32 {
    cells.bilinear(x / CELL as f32, y / CELL as f32)
}
