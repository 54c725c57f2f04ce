//! How strong the differences of each piece should be, band by band.
//!
//! A still tells how strong each band of its fluid is, but not how much of that moves: in a flame all of it, down to
//! the largest shapes, in a waterfall the fine detail but not the light and shade. The clip tells the rest. So each
//! coarse band of the piece's frames, moving and still together, is brought to the contrast of the same band of the
//! picture, and the differences by the same factor; in the fine bands, where all fluid moves, the differences alone are.
//! Factors are bounded, since they also lift the clip's noise (Okabe et al. 2011, Fig. 13).

use super::blend::Bands;
use super::layout::{BANDS, Layout, LevelKey, Placement};
use super::sample::Window;
use crate::base::par;
use crate::library::variant::PIECE;
use crate::raster::image::Plane;
use crate::raster::pyramid::{laplacian, reduce};

/// Smallest contrast that is measured, in [0, 1]: about the rounding noise of 8-bit footage.
const NOISE: f32 = 0.002;

/// Bands, fine to coarse, that move as a whole: up to 8 pixels a wave.
pub const FINE: usize = 2;

/// How gains are chosen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strength {
    /// Temporal contrast of the result relative to the picture's spatial contrast.
    pub strength: f32,
    /// Largest factor applied to the differences, and one over the smallest; `bands` come on top.
    pub max_gain: f32,
    /// Factor of each band, fine to coarse; swell and changing light live in the coarse ones, and the large shapes of
    /// flames.
    pub bands: [f32; BANDS],
}

/// Contrast of each band of a clip at one level, in mean squares over some frames.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Contrast {
    /// Of the frames' differences from their average: what moves.
    moving: Vec<Plane>,
    /// Of the frames themselves: what is seen.
    seen: Vec<Plane>,
    frames: usize,
}

impl Contrast {
    /// Counts one frame in: the bands of its difference from the average, and those of the average.
    pub fn add(&mut self, differences: &Bands, average: &Bands) {
        for (sums, still) in [(&mut self.moving, None), (&mut self.seen, Some(average))] {
            if sums.is_empty() {
                *sums = differences.iter().map(|b| Plane::zeros(b.width, b.height)).collect();
            }
            for (k, (sum, band)) in sums.iter_mut().zip(differences).enumerate() {
                match still {
                    None => sum.data.iter_mut().zip(&band.data).for_each(|(s, d)| *s += d * d),
                    Some(average) => {
                        let values = band.data.iter().zip(&average[k].data);
                        sum.data.iter_mut().zip(values).for_each(|(s, (d, a))| *s += (d + a) * (d + a));
                    }
                }
            }
        }
        self.frames += 1;
    }

    /// Root mean squares over a placed piece, weighted by where it moves.
    fn over(&self, sums: &[Plane], layout: &Layout, placement: &Placement, band: usize) -> f32 {
        let Some(plane) = sums.get(band) else { return 0.0 };
        let (window, weights) =
            piece_window(layout, placement, band, |x, y| placement.cell_value(x, y, |c| c.significant).max(0.01));
        // Read like the differences themselves, onto a canvas of the piece's own.
        let mut canvas = Plane::zeros(window.x + window.width, window.y + window.height);
        window.accumulate(plane, &weights, &mut canvas);
        let total: f32 = weights.iter().sum();
        (canvas.data.iter().sum::<f32>() / total.max(1e-6) / self.frames.max(1) as f32).max(0.0).sqrt()
    }
}

/// Differences matched to the picture, per placement and band.
#[derive(Debug, Clone, PartialEq)]
pub struct Match {
    /// Factor of the differences.
    pub gains: Vec<[f32; BANDS]>,
    /// Share of the picture's variance that the differences then have, 0 to 1.
    pub shares: Vec<[f32; BANDS]>,
    /// Share of the rest that moves in the clip as well, 0 to 1.
    pub restless: Vec<[f32; BANDS]>,
}

/// Matches the differences to the picture. `contrast` holds the levels of [`Layout::levels`]; `luma` and `matte` are
/// the picture's, at working size.
pub fn match_contrast(
    layout: &Layout,
    contrast: &[&Contrast],
    luma: &Plane,
    matte: &Plane,
    strength: &Strength,
) -> Match {
    let mattes: Vec<Plane> = std::iter::successors(Some(matte.clone()), |m| Some(reduce(m))).take(BANDS).collect();
    let picture: Vec<Plane> = laplacian(luma, BANDS).0.iter().map(|b| b.map(|v| v * v)).collect();
    let levels: Vec<LevelKey> = layout.levels();
    let matched = par::map(layout.placements.len(), |i| {
        let placement = &layout.placements[i];
        let level = levels.binary_search(&placement.level()).expect("a placement's level is used");
        std::array::from_fn(|band| {
            let wanted = picture_contrast(&picture[band], &mattes[band], placement, band).max(NOISE);
            let of = |sums: &[Plane]| contrast[level].over(sums, layout, placement, band);
            let (seen, moving) = (of(&contrast[level].seen), of(&contrast[level].moving));
            let (found, moves) =
                if band < FINE { (moving, 1.0) } else { (seen, (moving / seen.max(NOISE)).min(1.0).powi(2)) };
            let gain = gain(band, wanted / found.max(NOISE), strength);
            let share = (gain * moving / wanted).min(1.0).powi(2);
            [gain, share, ((moves - share) / (1.0 - share).max(1e-6)).clamp(0.0, 1.0)]
        })
    });
    let part = |k: usize| matched.iter().map(|bands: &[[f32; 3]; BANDS]| bands.map(|band| band[k])).collect();
    Match { gains: part(0), shares: part(1), restless: part(2) }
}

/// Factor of a band whose contrast in the picture is `ratio` times that found in the clip.
fn gain(band: usize, ratio: f32, strength: &Strength) -> f32 {
    let bounded = (strength.strength * ratio).clamp(1.0 / strength.max_gain, strength.max_gain);
    strength.bands[band] * bounded
}

/// Root mean square of a band of the picture over a node, where the matte is white.
fn picture_contrast(squares: &Plane, matte: &Plane, placement: &Placement, band: usize) -> f32 {
    let step = 1 << band;
    let range = |start: usize, size: usize| start / step..((start + PIECE) / step).min(size);
    let (mut sum, mut total) = (0.0, 1e-6);
    for y in range(placement.node.1, squares.height) {
        for x in range(placement.node.0, squares.width) {
            let weight = matte.at(x, y);
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
