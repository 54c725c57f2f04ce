//! Power over time per frequency.

use std::sync::Arc;

use super::definition::{Better, Measure};
use super::footage::Footage;
use super::subject::Subject;
use crate::base::rng;
use crate::descriptor::motion_spectrum::{BANDS, HOP, MotionSpectrum, WINDOW};
use crate::raster::image::Plane;

/// Pixels taken from each video.
const SAMPLES: usize = 8192;
/// Power of a band that rounding to 8 bits alone gives, luma²; what is below counts as this.
const FLOOR: f32 = 1e-7;

/// How fast things happen.
pub const TEMPORAL_SPECTRUM_DISTANCE: Measure = Measure {
    name: "temporal spectrum distance",
    unit: "dB",
    definition: "Wasserstein distance between the pixels' powers in decibels, of the frames and of the reference, mean over 16 frequency bands",
    needs: "reference, 32 frames in each",
    better: Better::Lower,
    compute: |subject: &Subject| {
        let (a, b) = (levels(subject.footage, subject.seed)?, levels(subject.reference?, subject.seed)?);
        let band = |(a, b): (&Vec<f32>, &Vec<f32>)| a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
        Some(a.iter().zip(b.iter()).map(band).sum::<f64>() / (BANDS * SAMPLES) as f64)
    },
};

/// Per band, the sorted powers of the sampled pixels in decibels; `None` when there are fewer frames than a window.
fn levels(footage: &Footage, seed: u64) -> Option<Arc<Vec<Vec<f32>>>> {
    footage.levels.get(seed, || sampled(footage, seed))
}

fn sampled(footage: &Footage, seed: u64) -> Option<Vec<Vec<f32>>> {
    let luma = footage.luma();
    let windows =
        if footage.loops() { luma.len().div_ceil(HOP) } else { (luma.len() + HOP).saturating_sub(WINDOW) / HOP };
    if luma.len() < WINDOW {
        return None;
    }
    let none = Plane::zeros(footage.width(), footage.height());
    let mut spectrum = MotionSpectrum::new(footage.width(), footage.height());
    for window in 0..windows {
        let frames: Vec<[&Plane; 2]> = (0..WINDOW).map(|t| [&luma[(window * HOP + t) % luma.len()], &none]).collect();
        spectrum.add_window(&frames);
    }
    let pixels = footage.pixels();
    let mut levels = vec![Vec::new(); BANDS];
    for i in 0..SAMPLES as u64 {
        let pixel = pixels[rng::below(rng::hash(seed, &[i]), pixels.len() as u64) as usize];
        let power = spectrum.at(pixel % footage.width(), pixel / footage.width());
        levels.iter_mut().zip(power).for_each(|(level, p)| level.push(10.0 * (p + FLOOR).log10()));
    }
    levels.iter_mut().for_each(|level| level.sort_unstable_by(f32::total_cmp));
    Some(levels)
}
