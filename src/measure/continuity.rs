//! What goes on from frame to frame: steps, the loop's closing, flicker, contrast.

use super::definition::{Better, Measure};
use super::footage::Footage;
use super::spectrum::powers;
use crate::base::par;
use crate::raster::image::Rgb8;
use crate::raster::pyramid::laplacian;

/// Frequency above which a change of the whole picture's brightness is flicker, Hz.
const FLICKER_FROM: f64 = 2.0;

/// Change so small that a video of 8 bits stands still, in [0, 1].
const STILL: f64 = 1e-4;

/// The loop's closing.
pub const LOOP_RATIO: Measure = Measure {
    name: "loop ratio",
    unit: "ratio",
    definition: "mean absolute difference of the last and the first frame over the median one of consecutive frames",
    needs: "3 frames",
    better: Better::One,
    compute: |subject| {
        let frames = subject.footage.frames();
        let typical = median(steps(subject.footage)?);
        let closing = difference(&frames[frames.len() - 1], &frames[0], subject.footage.inside());
        ratio(closing, typical)
    },
};

/// Jumps.
pub const LARGEST_STEP_RATIO: Measure = Measure {
    name: "largest step ratio",
    unit: "ratio",
    definition: "largest mean absolute difference of consecutive frames over the median one",
    needs: "3 frames",
    better: Better::One,
    compute: |subject| {
        let steps = steps(subject.footage)?;
        let largest = steps.iter().copied().fold(0.0, f64::max);
        ratio(largest, median(steps))
    },
};

/// Fades that blur.
pub const CONTRAST_DIP: Measure = Measure {
    name: "contrast dip",
    unit: "ratio",
    definition: "least over median, through time, of the band-pass contrast (2 to 8 pixels) of each frame less the mean frame",
    needs: "3 frames",
    better: Better::One,
    compute: |subject| {
        let contrasts = contrasts(subject.footage)?;
        let least = contrasts.iter().copied().fold(f64::INFINITY, f64::min);
        ratio(least, median(contrasts))
    },
};

/// Brightness that trembles.
pub const FLICKER: Measure = Measure {
    name: "flicker",
    unit: "luma, 0 to 1",
    definition: "root of the power of the frames' mean luma above 2 Hz",
    needs: "3 frames, more than 4 frames per second",
    better: Better::Lower,
    compute: |subject| {
        let footage = subject.footage;
        let usable = footage.frames().len() >= 3 && f64::from(footage.fps()) > 2.0 * FLICKER_FROM;
        usable.then(|| power_above(&brightness(footage), f64::from(footage.fps()), footage.loops()).sqrt())
    },
};

/// A quotient that has a meaning: `None` where what is typical is less than [`STILL`].
fn ratio(value: f64, typical: f64) -> Option<f64> {
    (typical > STILL).then(|| value / typical)
}

/// Differences of consecutive frames, without the closing one; `None` when there are fewer than two.
fn steps(footage: &Footage) -> Option<&[f64]> {
    let frames = footage.frames();
    let one = |t: usize| difference(&frames[t], &frames[t + 1], footage.inside());
    (frames.len() >= 3).then(|| &**footage.differences.get_or_init(|| par::map(frames.len() - 1, one)))
}

/// Mean absolute difference of the channels inside the matte, in [0, 1].
fn difference(a: &Rgb8, b: &Rgb8, inside: &[bool]) -> f64 {
    let (mut sum, mut count) = (0u64, 0u64);
    for ((a, b), &inside) in a.data.chunks_exact(3).zip(b.data.chunks_exact(3)).zip(inside) {
        let d = a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>();
        sum += d * u64::from(inside);
        count += u64::from(inside);
    }
    sum as f64 / (255 * 3 * count) as f64
}

/// The measures of this module that stand out in a frame, each with its number: the one after the largest step, the one of
/// least contrast, the last before a loop closes, and the one whose mean luma differs most from the one before.
pub(super) fn worst_frames(footage: &Footage) -> Vec<(&'static str, usize)> {
    let largest = |values: &[f64]| (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b]));
    let after = |values: &[f64]| largest(values).map(|t| t + 1);
    let dull: Vec<f64> = contrasts(footage).unwrap_or_default().iter().map(|c| -c).collect();
    let changes: Vec<f64> = brightness(footage).windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    let closing = footage.loops().then(|| footage.frames().len() - 1);
    let found = [
        (LOOP_RATIO.name, closing),
        (LARGEST_STEP_RATIO.name, steps(footage).and_then(after)),
        (CONTRAST_DIP.name, largest(&dull)),
        (FLICKER.name, after(&changes)),
    ];
    found.into_iter().filter_map(|(name, frame)| Some((name, frame?))).collect()
}

/// Contrast of each frame less the mean frame.
fn contrasts(footage: &Footage) -> Option<&[f64]> {
    (footage.frames().len() >= 3).then(|| &**footage.contrasts.get_or_init(|| moving_contrasts(footage)))
}

fn moving_contrasts(footage: &Footage) -> Vec<f64> {
    let (luma, mean) = (footage.luma(), footage.mean());
    let (width, inside) = (footage.width(), footage.inside());
    par::map(luma.len(), |t| {
        let mut moving = luma[t].clone();
        moving.data.iter_mut().zip(&mean.data).for_each(|(l, m)| *l -= m);
        let band = laplacian(&moving, 2).0.swap_remove(1);
        let places = (0..band.height).flat_map(|y| (0..band.width).map(move |x| (x, y)));
        let values = places.filter(|&(x, y)| inside[2 * y * width + 2 * x]).map(|(x, y)| f64::from(band.at(x, y)));
        let (sum, count) = values.fold((0.0, 0usize), |(sum, n), v| (sum + v * v, n + 1));
        (sum / count.max(1) as f64).sqrt()
    })
}

/// Mean luma of each frame.
fn brightness(footage: &Footage) -> Vec<f64> {
    let pixels = footage.pixels();
    let luma = footage.luma();
    par::map(luma.len(), |t| pixels.iter().map(|&p| f64::from(luma[t].data[p])).sum::<f64>() / pixels.len() as f64)
}

/// Power of a series above [`FLICKER_FROM`]: its variance in that band.
fn power_above(series: &[f64], fps: f64, loops: bool) -> f64 {
    let hertz = fps / series.len() as f64;
    let powers = powers(series, loops).into_iter().enumerate();
    powers.filter(|(i, _)| (i + 1) as f64 * hertz > FLICKER_FROM).map(|(_, power)| power).sum()
}

/// Deviation of the frames' mean luma in each band of frequency, and the bands' width in Hz; the first band is centred on
/// that width. `None` when there are fewer than 3 frames.
pub(super) fn flicker_spectrum(footage: &Footage) -> Option<(f64, Vec<f64>)> {
    let count = footage.frames().len();
    let deviations = || powers(&brightness(footage), footage.loops()).into_iter().map(f64::sqrt).collect();
    (count >= 3).then(|| (f64::from(footage.fps()) / count as f64, deviations()))
}

/// The middle value, the upper one of two; 0 for none.
fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flash_is_the_worst_frame_of_steps_and_flicker() {
        let grey = |t: usize| {
            let byte = |i: usize| if t == 7 { 250 } else { ((i * 37 + t * 11) % 61) as u8 };
            Rgb8 { width: 32, height: 32, data: (0..32 * 32 * 3).map(byte).collect() }
        };
        let footage = Footage::new((0..12).map(grey).collect(), 25.0, true, None).unwrap();
        let of = |name: &str| worst_frames(&footage).into_iter().find(|f| f.0 == name).map(|f| f.1);
        assert!([Some(7), Some(8)].contains(&of("largest step ratio")), "{:?}", of("largest step ratio"));
        assert!([Some(7), Some(8)].contains(&of("flicker")), "{:?}", of("flicker"));
        assert_eq!(of("loop ratio"), Some(11));
        assert!(of("contrast dip").is_some());
    }

    #[test]
    fn power_is_the_variance_above_two_hertz() {
        let wave = |hertz: f64, t: usize| 0.1 * (std::f64::consts::TAU * hertz * t as f64 / 25.0).sin();
        let series: Vec<f64> = (0..100).map(|t| 0.5 + wave(5.0, t) + wave(1.0, t)).collect();
        for loops in [true, false] {
            let power = power_above(&series, 25.0, loops);
            assert!((power - 0.005).abs() < 1e-4, "{power}");
        }
    }
}
