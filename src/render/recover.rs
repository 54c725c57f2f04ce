//! The picture's average image: what a long exposure of the moving scene would have recorded.
//!
//! Image-based motion blur (Brostow & Essa 2001) along the assigned average flow, then a Gaussian that grows with the
//! speed (Okabe et al. 2011, §6). Colours come from inside the matte only.

use super::layout::{BANDS, Layout, PlacedCell, SPREAD_SIGMA};
use crate::base::par;
use crate::flow::field::Field;
use crate::library::variant::CELL;
use crate::raster::filter::gaussian;
use crate::raster::image::{Color, Plane};
use crate::raster::pyramid::{collapse, laplacian};

/// Longest streak, pixels of the working image.
const MAX_STREAK: f32 = 32.0;
/// Widest Gaussian, pixels of the working image.
const MAX_SIGMA: f32 = 4.0;
/// Window over which contrast is measured, pixels of the working image.
const CONTRAST_SIGMA: f32 = 10.0;

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
    let cell = |_, c: &PlacedCell| {
        let weight = c.significant.max(0.02);
        [weight * c.mean.0, weight * c.mean.1, weight * c.activity, weight]
    };
    let [mut u, mut v, mut activity, total] = layout.spread_cells(cell).map(|s| gaussian(&s, SPREAD_SIGMA));
    for plane in [&mut u, &mut v, &mut activity] {
        plane.data.iter_mut().zip(&total.data).for_each(|(p, t)| *p /= t.max(1e-6));
    }
    AssignedMotion { mean: Field { u, v }, activity }
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

/// Takes from each band of the recovered image what the differences will bring back, so that every frame has the
/// picture's contrast and not the sum of a still and a moving texture. `shares` holds, per band and on cells, the share
/// of the picture's variance that the differences have. (The blur along the flow should do this, but optical flow
/// underestimates whitewater, and streaks then stay too short.)
pub fn make_room(recovered: &Color, picture: &Color, matte: &Plane, shares: &[Plane; BANDS]) -> Color {
    let factors = room_factors(&recovered.luma(), &picture.luma(), shares);
    let mut out = picture.clone();
    for (plane, recovered) in out.planes.iter_mut().zip(&recovered.planes) {
        let (mut bands, rest) = laplacian(recovered, BANDS);
        for (band, factor) in bands.iter_mut().zip(&factors) {
            band.data.iter_mut().zip(&factor.data).for_each(|(b, f)| *b *= f);
        }
        let roomy = collapse(&bands, Some(&rest));
        for ((p, r), m) in plane.data.iter_mut().zip(&roomy.data).zip(&matte.data) {
            *p += m * (r - *p);
        }
    }
    out
}

/// Per band and pixel: what brings the recovered image's contrast down to what should stay still.
fn room_factors(recovered: &Plane, picture: &Plane, shares: &[Plane; BANDS]) -> Vec<Plane> {
    let contrasts = |plane: &Plane| -> Vec<Plane> {
        let sigma = |band: usize| (CONTRAST_SIGMA / (1 << band) as f32).max(1.5);
        let (bands, _) = laplacian(plane, BANDS);
        bands.iter().enumerate().map(|(k, b)| gaussian(&b.map(|v| v * v), sigma(k)).map(f32::sqrt)).collect()
    };
    let (have, wanted) = (contrasts(recovered), contrasts(picture));
    let factor = |band: usize| {
        let (have, wanted) = (&have[band], &wanted[band]);
        Plane::from_fn(have.width, have.height, |x, y| {
            let at = |v: usize| (v as f32 + 0.5) * (1 << band) as f32;
            let still = (1.0 - cell_value(&shares[band], (at(x), at(y)))).max(0.0).sqrt();
            (still * wanted.at(x, y) / have.at(x, y).max(1e-4)).min(1.0)
        })
    };
    (0..BANDS).map(factor).collect()
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
