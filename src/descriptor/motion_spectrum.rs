//! Power of the motion over time, per frequency (Okabe et al. 2011, §5.2; Welch 1967 for the common frequency axis).
//!
//! Windows of 32 motion fields, 16 apart, mean removed, Hann; the power of `u` plus that of `v`, averaged over the
//! windows. The transform runs across pixels in a fixed order of plain sums and products, so the result is the same
//! on any instruction set and any number of threads.

use macro_rules_attribute::apply;

use crate::base::instructions::kernel;
use crate::base::par;
use crate::raster::image::Plane;

/// Motion fields in a window.
pub const WINDOW: usize = 32;
/// Motion fields from one window to the next.
pub const HOP: usize = WINDOW / 2;
/// Frequency bands kept: 1 to 16 cycles per window (0.78 to 12.5 Hz at 25 frames/s).
pub const BANDS: usize = WINDOW / 2;

/// Pixels transformed together.
const LANES: usize = 16;

type Lane = [f32; LANES];

/// cos(2πk/32) for k = 0..=8, as literals: library transcendentals may differ in the last bit between machines.
const COS: [f32; 9] =
    [1.0, 0.980_785_3, 0.923_879_5, 0.831_469_6, 0.707_106_77, 0.555_570_24, 0.382_683_43, 0.195_090_32, 0.0];

/// cos(2πk/32) for any k.
const fn cosine(k: usize) -> f32 {
    let k = k % WINDOW;
    let k = if k > 16 { 32 - k } else { k };
    if k <= 8 { COS[k] } else { -COS[16 - k] }
}

/// sin(2πk/32) for any k.
const fn sine(k: usize) -> f32 {
    cosine(k + 24)
}

/// Hann window, periodic.
const HANN: [f32; WINDOW] = {
    let mut window = [0.0; WINDOW];
    let mut n = 0;
    while n < WINDOW {
        window[n] = 0.5 - 0.5 * cosine(n);
        n += 1;
    }
    window
};

/// 2 / (N · Σ w²): makes the sum over the bands the variance of the motion over time.
const ONE_SIDED: f32 = 2.0 / (WINDOW as f32 * 0.375 * WINDOW as f32);

/// Spectra of every pixel, summed over windows.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionSpectrum {
    width: usize,
    height: usize,
    windows: usize,
    /// Row by row, band by band: `[y][band][x]`.
    power: Vec<f32>,
}

impl MotionSpectrum {
    /// No windows yet, for fields of `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, windows: 0, power: vec![0.0; width * height * BANDS] }
    }

    /// Number of windows seen.
    pub fn windows(&self) -> usize {
        self.windows
    }

    /// Adds one window of [`WINDOW`] consecutive motion fields, each as its horizontal and its vertical component in
    /// pixels per frame; rows in parallel.
    ///
    /// # Panics
    /// When there are not [`WINDOW`] fields of this size.
    pub fn add_window(&mut self, fields: &[[&Plane; 2]]) {
        assert_eq!(fields.len(), WINDOW);
        assert!(fields.iter().flatten().all(|c| (c.width, c.height) == (self.width, self.height)));
        let width = self.width;
        par::for_each_chunk(&mut self.power, width * BANDS, |y, row| add_row(fields, y, width, row));
        self.windows += 1;
    }

    /// Mean power of band 1 to 16 at pixel `(x, y)`, (pixels per frame)²; zeros before the first window.
    pub fn at(&self, x: usize, y: usize) -> [f32; BANDS] {
        let scale = 1.0 / self.windows.max(1) as f32;
        std::array::from_fn(|band| self.power[(y * BANDS + band) * self.width + x] * scale)
    }

    /// Mean power of band 1 to 16 over the square of `side` pixels at `(x, y)`, (pixels per frame)². Pixels are
    /// summed in mirrored pairs along the row, so a mirrored clip gives exactly the mirrored cells.
    pub fn cell(&self, x: usize, y: usize, side: usize) -> [f32; BANDS] {
        let scale = 1.0 / (self.windows.max(1) * side * side) as f32;
        std::array::from_fn(|band| {
            let row =
                |y: usize| super::textureness::mirror_sum(&self.power[(y * BANDS + band) * self.width + x..][..side]);
            (y..y + side).map(row).sum::<f32>() * scale
        })
    }
}

/// Adds the window's power along row `y`.
fn add_row(fields: &[[&Plane; 2]], y: usize, width: usize, row: &mut [f32]) {
    let mut x = 0;
    while x < width {
        let n = LANES.min(width - x);
        let mut re = [[0.0; LANES]; WINDOW];
        let mut im = [[0.0; LANES]; WINDOW];
        for (t, [u, v]) in fields.iter().enumerate() {
            let at = y * width + x;
            re[t][..n].copy_from_slice(&u.data[at..at + n]);
            im[t][..n].copy_from_slice(&v.data[at..at + n]);
        }
        let power = power(&mut re, &mut im);
        for (band, power) in power.iter().enumerate() {
            row[band * width + x..][..n].iter_mut().zip(power).for_each(|(sum, p)| *sum += p);
        }
        x += n;
    }
}

/// Power of the bands of `LANES` pixels. With `z = u + iv`, `P_u + P_v` at frequency k is the mean of `|Z(k)|²` and
/// `|Z(−k)|²`, so one complex transform serves both components.
#[apply(kernel)]
fn power(re: &mut [Lane; WINDOW], im: &mut [Lane; WINDOW]) -> [Lane; BANDS] {
    taper(re);
    taper(im);
    transform(re, im);
    let mut out = [[0.0; LANES]; BANDS];
    for (band, out) in out.iter_mut().enumerate() {
        let k = band + 1;
        let (a, b) = (reverse(k), reverse(WINDOW - k));
        // The Nyquist band is its own mirror, and counts once.
        let weight = if k == WINDOW / 2 { 0.5 * ONE_SIDED } else { ONE_SIDED };
        for l in 0..LANES {
            let plus = re[a][l] * re[a][l] + im[a][l] * im[a][l];
            let minus = re[b][l] * re[b][l] + im[b][l] * im[b][l];
            out[l] = 0.5 * (plus + minus) * weight;
        }
    }
    out
}

/// Removes the mean and applies the window.
#[inline(always)]
fn taper(lanes: &mut [Lane; WINDOW]) {
    let mut mean = [0.0; LANES];
    for lane in lanes.iter() {
        for l in 0..LANES {
            mean[l] += lane[l];
        }
    }
    for (lane, hann) in lanes.iter_mut().zip(HANN) {
        for l in 0..LANES {
            lane[l] = (lane[l] - mean[l] * (1.0 / WINDOW as f32)) * hann;
        }
    }
}

/// Position of frequency `k` after [`transform`].
#[inline(always)]
fn reverse(k: usize) -> usize {
    (k % WINDOW).reverse_bits() >> (usize::BITS - WINDOW.trailing_zeros())
}

/// Complex transform of length 32, radix 2, decimation in frequency, in place, output bit-reversed.
#[inline(always)]
fn transform(re: &mut [Lane; WINDOW], im: &mut [Lane; WINDOW]) {
    let mut half = WINDOW / 2;
    while half > 0 {
        let step = WINDOW / (2 * half);
        for start in (0..WINDOW).step_by(2 * half) {
            for j in 0..half {
                let (c, s) = (cosine(j * step), -sine(j * step));
                let (a, b) = (start + j, start + j + half);
                for l in 0..LANES {
                    let (dr, di) = (re[a][l] - re[b][l], im[a][l] - im[b][l]);
                    re[a][l] += re[b][l];
                    im[a][l] += im[b][l];
                    re[b][l] = dr * c - di * s;
                    im[b][l] = dr * s + di * c;
                }
            }
        }
        half /= 2;
    }
}

#[cfg(test)]
mod tests {
    use rustfft::FftPlannerScalar;
    use rustfft::num_complex::Complex;

    use super::*;
    use crate::base::rng;

    fn fields(width: usize, height: usize, f: impl Fn(usize, usize, usize) -> (f32, f32)) -> Vec<[Plane; 2]> {
        let field = |t| {
            [Plane::from_fn(width, height, |x, y| f(t, x, y).0), Plane::from_fn(width, height, |x, y| f(t, x, y).1)]
        };
        (0..WINDOW).map(field).collect()
    }

    fn spectrum(fields: &[[Plane; 2]]) -> MotionSpectrum {
        let mut spectrum = MotionSpectrum::new(fields[0][0].width, fields[0][0].height);
        spectrum.add_window(&fields.iter().map(|f| f.each_ref()).collect::<Vec<_>>());
        spectrum
    }

    fn noise(t: usize, x: usize, y: usize, c: u64) -> f32 {
        rng::unit(rng::hash(c, &[t as u64, x as u64, y as u64])) - 0.5
    }

    #[test]
    fn the_transform_is_rustffts() {
        let value = |t: usize, l: usize, c: u64| noise(t, l, 7, c);
        let mut re: [Lane; WINDOW] = std::array::from_fn(|t| std::array::from_fn(|l| value(t, l, 5)));
        let mut im: [Lane; WINDOW] = std::array::from_fn(|t| std::array::from_fn(|l| value(t, l, 6)));
        transform(&mut re, &mut im);
        let fft = FftPlannerScalar::new().plan_fft_forward(WINDOW);
        for l in 0..LANES {
            let complex = |t| Complex::new(f64::from(value(t, l, 5)), f64::from(value(t, l, 6)));
            let mut expected: [Complex<f64>; WINDOW] = std::array::from_fn(complex);
            fft.process(&mut expected);
            for (k, expected) in expected.iter().enumerate() {
                let found = Complex::new(f64::from(re[reverse(k)][l]), f64::from(im[reverse(k)][l]));
                assert!((found - expected).norm() < 2e-6, "{k}: {found} {expected}");
            }
        }
    }

    #[test]
    fn agrees_with_the_definition() {
        let fields = fields(19, 2, |t, x, y| (noise(t, x, y, 1), noise(t, x, y, 2)));
        let spectrum = spectrum(&fields);
        for (x, y) in [(0, 0), (7, 1), (18, 1)] {
            let expected = |band: usize| -> f64 {
                let part = |plane: &dyn Fn(usize) -> f32| {
                    let mean = (0..WINDOW).map(|t| f64::from(plane(t))).sum::<f64>() / 32.0;
                    let (mut re, mut im) = (0.0, 0.0);
                    for t in 0..WINDOW {
                        let angle = std::f64::consts::TAU * t as f64 / 32.0;
                        let value = (f64::from(plane(t)) - mean) * (0.5 - 0.5 * angle.cos());
                        re += value * (band as f64 * angle).cos();
                        im += value * (band as f64 * angle).sin();
                    }
                    re * re + im * im
                };
                let both = part(&|t| fields[t][0].at(x, y)) + part(&|t| fields[t][1].at(x, y));
                both * if band == 16 { 1.0 } else { 2.0 } / (32.0 * 12.0)
            };
            for (band, power) in spectrum.at(x, y).into_iter().enumerate() {
                let expected = expected(band + 1);
                assert!((f64::from(power) - expected).abs() < 1e-5 * (1.0 + expected), "{band}: {power} {expected}");
            }
        }
    }

    #[test]
    fn an_oscillation_peaks_in_its_band_and_a_constant_vanishes() {
        let wave = |t: usize| (std::f32::consts::TAU * 5.0 * t as f32 / 32.0).sin();
        let power = spectrum(&fields(4, 4, |t, _, _| (2.0 + wave(t), 0.5 * wave(t)))).cell(0, 0, 4);
        assert!((0..BANDS).all(|b| b == 4 || power[b] < power[4]), "{power:?}");
        let still = spectrum(&fields(4, 4, |_, _, _| (3.0, -2.0))).cell(0, 0, 4);
        assert!(still.iter().all(|p| *p < 1e-9), "{still:?}");
    }

    #[test]
    fn bands_sum_to_the_variance() {
        let mut sum = MotionSpectrum::new(64, 64);
        let fields = fields(64, 64, |t, x, y| (noise(t, x, y, 3), noise(t, x, y, 4)));
        sum.add_window(&fields.iter().map(|f| f.each_ref()).collect::<Vec<_>>());
        let total: f32 = (0..64)
            .step_by(16)
            .flat_map(|y| (0..64).step_by(16).map(move |x| (x, y)))
            .map(|(x, y)| sum.cell(x, y, 16).iter().sum::<f32>())
            .sum::<f32>()
            / 16.0;
        assert!((total - 2.0 / 12.0).abs() < 0.01, "{total}");
    }
}
