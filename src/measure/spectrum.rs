//! Power over time per frequency.

use std::f64::consts::TAU;
use std::sync::Arc;

use rustfft::FftPlannerScalar;
use rustfft::num_complex::Complex;

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
    compute: |subject: &Subject| distance(subject.footage, subject.reference?, subject.seed),
};

/// See [`TEMPORAL_SPECTRUM_DISTANCE`].
pub(super) fn distance(a: &Footage, b: &Footage, seed: u64) -> Option<f64> {
    let (a, b) = (levels(a, seed)?, levels(b, seed)?);
    let band = |(a, b): (&Vec<f32>, &Vec<f32>)| a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
    Some(a.iter().zip(b.iter()).map(band).sum::<f64>() / (BANDS * SAMPLES) as f64)
}

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

/// Power of a series at 1, 2, … n / 2 waves in its length; their sum is its variance. A series that does not loop is
/// tapered (Hann), or the jump from its end to its start would count.
pub fn powers(series: &[f64], loops: bool) -> Vec<f64> {
    let n = series.len();
    let mean = series.iter().sum::<f64>() / n as f64;
    let taper = |t: usize| if loops { 1.0 } else { 0.5 - 0.5 * (TAU * (t as f64 + 0.5) / n as f64).cos() };
    let tapered = series.iter().enumerate().map(|(t, v)| Complex::new((v - mean) * taper(t), 0.0));
    let mut waves: Vec<Complex<f64>> = tapered.collect();
    FftPlannerScalar::new().plan_fft_forward(n).process(&mut waves);
    let weight = n as f64 * (0..n).map(|t| taper(t).powi(2)).sum::<f64>();
    let power = |k: usize| (if 2 * k == n { 1.0 } else { 2.0 }) * waves[k].norm_sqr() / weight;
    (1..=n / 2).map(power).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, term by term.
    fn summed(series: &[f64]) -> Vec<f64> {
        let n = series.len();
        let power = |k: usize| {
            let angle = |t: usize| TAU * ((k * t) % n) as f64 / n as f64;
            let sum = |wave: fn(f64) -> f64| series.iter().enumerate().map(|(t, v)| v * wave(angle(t))).sum::<f64>();
            let power = sum(f64::cos).powi(2) + sum(f64::sin).powi(2);
            (if 2 * k == n { 1.0 } else { 2.0 }) * power / (n * n) as f64
        };
        (1..=n / 2).map(power).collect()
    }

    #[test]
    fn powers_of_any_length_are_those_of_the_definition_and_sum_to_the_variance() {
        // Powers of two, small factors, a prime and twice a prime.
        for n in [3, 4, 25, 32, 120, 127, 254, 375] {
            let series: Vec<f64> = (0..n).map(|t| f64::from(rng::unit(rng::hash(n, &[t])))).collect();
            let powers = powers(&series, true);
            for (power, expected) in powers.iter().zip(summed(&series)) {
                assert!((power - expected).abs() < 1e-12, "{n}: {power} {expected}");
            }
            let mean = series.iter().sum::<f64>() / n as f64;
            let variance = series.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n as f64;
            assert!((powers.iter().sum::<f64>() - variance).abs() < 1e-12, "{n}");
        }
    }
}
