//! How colours are distributed.

use std::sync::LazyLock;

use super::definition::{Better, Measure};
use super::footage::{Footage, spread};
use super::subject::Subject;
use crate::base::{par, rng};

/// Frames looked at.
const FRAMES: usize = 16;
/// Pixels taken from each frame.
const SAMPLES: usize = 8192;

/// Colours that drift or fade.
pub const COLOUR_DISTANCE: Measure = Measure {
    name: "colour distance",
    unit: "CIE Lab",
    definition: "Wasserstein distance between the values of a frame and of the picture (or reference), mean over L*, a*, b* and frames",
    needs: "picture or reference",
    better: Better::Lower,
    compute: |subject: &Subject| {
        let distances = at(subject, &spread(subject.footage.frames().len(), FRAMES))?;
        Some(distances.iter().sum::<f64>() / distances.len() as f64)
    },
};

/// Distance of some frames.
pub(super) fn at(subject: &Subject, frames: &[usize]) -> Option<Vec<f64>> {
    let target = sorted(subject.appearance()?, None, subject.seed);
    Some(par::map(frames.len(), |i| {
        let channels = sorted(subject.footage, Some(frames[i]), subject.seed);
        channels.iter().zip(&target).map(|(a, b)| mean_difference(a, b)).sum::<f64>() / 3.0
    }))
}

/// 1-D Wasserstein-1 distance of two equally long sorted samples.
fn mean_difference(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / a.len() as f64
}

/// Sorted L*, a*, b* of random pixels of one frame, or of all.
fn sorted(footage: &Footage, frame: Option<usize>, seed: u64) -> [Vec<f32>; 3] {
    let pixels = footage.pixels();
    let mut channels: [Vec<f32>; 3] = Default::default();
    for i in 0..SAMPLES as u64 {
        let any = rng::below(rng::hash(seed, &[i, 0]), footage.frames().len() as u64) as usize;
        let pixel = pixels[rng::below(rng::hash(seed, &[i, 1]), pixels.len() as u64) as usize];
        let image = &footage.frames()[frame.unwrap_or(any)];
        let lab = lab(image.pixel(pixel % image.width, pixel / image.width));
        channels.iter_mut().zip(lab).for_each(|(channel, v)| channel.push(v));
    }
    channels.iter_mut().for_each(|channel| channel.sort_unstable_by(f32::total_cmp));
    channels
}

/// CIE L*a*b* (D65) of an sRGB pixel.
fn lab(rgb: [u8; 3]) -> [f32; 3] {
    static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
        std::array::from_fn(|v| {
            let v = v as f32 / 255.0;
            if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        })
    });
    let [r, g, b] = rgb.map(|v| LINEAR[usize::from(v)]);
    let x = (0.412_456_4 * r + 0.357_576_1 * g + 0.180_437_5 * b) / 0.950_47;
    let y = 0.212_672_9 * r + 0.715_152_2 * g + 0.072_175 * b;
    let z = (0.019_333_9 * r + 0.119_192 * g + 0.950_304_1 * b) / 1.088_83;
    let [x, y, z] = [x, y, z].map(|t| if t > 216.0 / 24389.0 { t.cbrt() } else { (24389.0 / 27.0 * t + 16.0) / 116.0 });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lab_of_known_colours() {
        let near = |rgb, expected: [f32; 3]| {
            let got = lab(rgb);
            assert!(got.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.05), "{got:?}");
        };
        near([255, 255, 255], [100.0, 0.0, 0.0]);
        near([0, 0, 0], [0.0, 0.0, 0.0]);
        near([255, 0, 0], [53.24, 80.09, 67.20]);
        near([0, 0, 255], [32.30, 79.19, -107.86]);
    }
}
