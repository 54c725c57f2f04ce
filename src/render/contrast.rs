//! How strong the differences of each piece should be, band by band.
//!
//! A fluid's picture and its temporal differences are related: what makes a frame differ from the average is the very
//! texture the frame shows. So the standard deviation over time of a band is matched to the spatial contrast of the
//! same band of the picture, within bounds, since a gain also lifts the clip's noise (Okabe et al. 2011, Fig. 13).

use super::blend::Bands;
use super::layout::{BANDS, Layout, LevelKey, Placement};
use super::sample::Window;
use crate::base::par;
use crate::library::variant::PIECE;
use crate::raster::image::Plane;
use crate::raster::pyramid::laplacian;

/// Smallest contrast that is measured, in [0, 1]: about the rounding noise of 8-bit footage.
const NOISE: f32 = 0.002;

/// Bands that hold the texture of a fluid; the coarser ones hold its swell.
const FINE: usize = 3;

/// How gains are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strength {
    /// Temporal contrast of the result relative to the picture's spatial contrast.
    pub strength: f32,
    /// Largest factor applied to the differences, and one over the smallest.
    pub max_gain: f32,
    /// Factor of the coarse bands; swell and changing light live there, and the large shapes of flames.
    pub coarse: f32,
}

/// Temporal variance of each band at one level: mean square of the differences' bands over some frames.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Variance {
    planes: Vec<Plane>,
    frames: usize,
}

impl Variance {
    /// Counts one frame's bands in.
    pub fn add(&mut self, bands: &Bands) {
        if self.planes.is_empty() {
            self.planes = bands.iter().map(|b| Plane::zeros(b.width, b.height)).collect();
        }
        for (sum, band) in self.planes.iter_mut().zip(bands) {
            sum.data.iter_mut().zip(&band.data).for_each(|(s, b)| *s += b * b);
        }
        self.frames += 1;
    }

    /// Mean over a placed piece, weighted by where it moves.
    fn over(&self, layout: &Layout, placement: &Placement, band: usize) -> f32 {
        let Some(plane) = self.planes.get(band) else { return 0.0 };
        let (window, weights) =
            piece_window(layout, placement, band, |x, y| placement.cell_value(x, y, |c| c.significant).max(0.01));
        // Read like the differences themselves, onto a canvas of the piece's own.
        let mut canvas = Plane::zeros(window.x + window.width, window.y + window.height);
        window.accumulate(plane, &weights, &mut canvas);
        let total: f32 = weights.iter().sum();
        (canvas.data.iter().sum::<f32>() / total.max(1e-6) / self.frames.max(1) as f32).max(0.0)
    }
}

/// Differences matched to the picture, per placement and band.
#[derive(Debug, Clone, PartialEq)]
pub struct Match {
    /// Factor of the differences.
    pub gains: Vec<[f32; BANDS]>,
    /// Share of the picture's variance that the differences then have, 0 to 1.
    pub shares: Vec<[f32; BANDS]>,
}

/// Matches the differences to the picture. `variance` holds the levels of [`Layout::levels`]; `luma` and `matte` are
/// the picture's, at working size.
pub fn match_contrast(
    layout: &Layout,
    variance: &[&Variance],
    luma: &Plane,
    matte: &Plane,
    strength: &Strength,
) -> Match {
    let picture: Vec<Plane> = laplacian(luma, BANDS).0.iter().map(|b| b.map(|v| v * v)).collect();
    let levels: Vec<LevelKey> = layout.levels();
    let matched = par::map(layout.placements.len(), |i| {
        let placement = &layout.placements[i];
        let level = levels.binary_search(&placement.level()).expect("a placement's level is used");
        let wanted: [f32; BANDS] = std::array::from_fn(|band| picture_contrast(&picture[band], matte, placement, band));
        let found: [f32; BANDS] = std::array::from_fn(|band| variance[level].over(layout, placement, band).sqrt());
        let gains = gains(&wanted, &found, strength);
        std::array::from_fn(|band| {
            let gain = gains[band];
            (gain, (gain * found[band] / wanted[band].max(NOISE)).min(1.0).powi(2))
        })
    });
    let part = |of: fn((f32, f32)) -> f32| matched.iter().map(|bands: &[(f32, f32); BANDS]| bands.map(of)).collect();
    Match { gains: part(|m| m.0), shares: part(|m| m.1) }
}

/// Factors that bring the contrasts `found` to those that are `wanted`. The coarse bands are lifted no more than the
/// fine ones, and not above what the clip has: a waterfall's picture is bright here and dark there, but that is light and shade, which stand still, and
/// a piece's own swell made as strong would be dark blobs. Flames have their own strong coarse bands.
fn gains(wanted: &[f32; BANDS], found: &[f32; BANDS], strength: &Strength) -> [f32; BANDS] {
    let matched = |band: usize| {
        let ratio = strength.strength * wanted[band] / found[band].max(NOISE);
        ratio.clamp(1.0 / strength.max_gain, strength.max_gain)
    };
    let fine = ((0..FINE).map(|band| matched(band).ln()).sum::<f32>() / FINE as f32).exp();
    std::array::from_fn(|band| match band {
        fine_band if fine_band < FINE => matched(fine_band),
        band => strength.coarse * matched(band).min(fine).min(1.0),
    })
}

/// Root mean square of a band of the picture over a node, where the matte is white.
fn picture_contrast(squares: &Plane, matte: &Plane, placement: &Placement, band: usize) -> f32 {
    let step = 1 << band;
    let range = |start: usize, size: usize| start / step..((start + PIECE) / step).min(size);
    let (mut sum, mut total) = (0.0, 1e-6);
    for y in range(placement.node.1, squares.height) {
        for x in range(placement.node.0, squares.width) {
            let (mx, my) = ((x * step + step / 2).min(matte.width - 1), (y * step + step / 2).min(matte.height - 1));
            let weight = matte.at(mx, my);
            sum += weight * squares.at(x, y);
            total += weight;
        }
    }
    (sum / total).sqrt()
}

/// The piece's own pixels at a band, with weights of the position within the piece (pixels).
fn piece_window(
    layout: &Layout,
    placement: &Placement,
    band: usize,
    weight: impl Fn(f32, f32) -> f32,
) -> (Window, Vec<f32>) {
    let step = 1usize << band;
    let side = PIECE / step;
    let at_origin = Placement { node: (0, 0), ..placement.clone() };
    let window = Window::new(&at_origin, &layout.geometry(placement), band, (0, side), (0, side));
    let centre = |i: usize| (i as f32 + 0.5) * step as f32;
    let weights = (0..side * side).map(|i| weight(centre(i % side), centre(i / side))).collect();
    (window, weights)
}
