//! Spectra: the pack's own transform beside rustfft, and powers of a series of any length beside the plain sum.
//!
//!     cargo bench --bench spectra

use divan::Bencher;
use enliven::base::{par, rng};
use enliven::descriptor::motion_spectrum::{BANDS, MotionSpectrum, WINDOW};
use enliven::measure::spectrum::powers;
use enliven::raster::image::Plane;
use rustfft::FftPlannerScalar;
use rustfft::num_complex::Complex;

/// Size of the fields, that of a library clip.
const SIZE: (usize, usize) = (640, 360);

fn main() {
    divan::main();
}

fn fields() -> Vec<[Plane; 2]> {
    let value = |c: u64, t: usize, x: usize, y: usize| rng::unit(rng::hash(c, &[t as u64, x as u64, y as u64])) - 0.5;
    (0..WINDOW).map(|t| [0, 1].map(|c| Plane::from_fn(SIZE.0, SIZE.1, |x, y| value(c, t, x, y)))).collect()
}

#[divan::bench(sample_count = 20, sample_size = 1)]
fn pack_own(bencher: Bencher) {
    let fields = fields();
    let fields: Vec<[&Plane; 2]> = fields.iter().map(|f| f.each_ref()).collect();
    let add = || MotionSpectrum::new(SIZE.0, SIZE.1).add_window(&fields);
    bencher.bench_local(|| par::with_threads(1, add).expect("a thread starts"));
}

/// What the pack's own transform does, by rustfft: pixel by pixel, a row at a time.
#[divan::bench(sample_count = 20, sample_size = 1)]
fn pack_rustfft(bencher: Bencher) {
    let fields = fields();
    let fft = FftPlannerScalar::<f32>::new().plan_fft_forward(WINDOW);
    let hann: Vec<f32> =
        (0..WINDOW).map(|t| 0.5 - 0.5 * (std::f32::consts::TAU * t as f32 / WINDOW as f32).cos()).collect();
    let mut row = vec![Complex::default(); WINDOW * SIZE.0];
    let mut scratch = vec![Complex::default(); fft.get_inplace_scratch_len()];
    let mut powers = vec![0.0; SIZE.0 * SIZE.1 * BANDS];
    bencher.bench_local(|| {
        for (y, powers) in powers.chunks_exact_mut(SIZE.0 * BANDS).enumerate() {
            for (x, waves) in row.chunks_exact_mut(WINDOW).enumerate() {
                let at = y * SIZE.0 + x;
                waves.iter_mut().zip(&fields).for_each(|(w, [u, v])| *w = Complex::new(u.data[at], v.data[at]));
                let mean = waves.iter().sum::<Complex<f32>>() * (1.0 / WINDOW as f32);
                waves.iter_mut().zip(&hann).for_each(|(w, hann)| *w = (*w - mean) * hann);
            }
            fft.process_with_scratch(&mut row, &mut scratch);
            for (band, powers) in powers.chunks_exact_mut(SIZE.0).enumerate() {
                let mirrored = |w: &[Complex<f32>]| w[band + 1].norm_sqr() + w[WINDOW - band - 1].norm_sqr();
                powers.iter_mut().zip(row.chunks_exact(WINDOW)).for_each(|(p, waves)| *p += mirrored(waves));
            }
        }
    });
}

fn series(length: usize) -> Vec<f64> {
    (0..length as u64).map(|t| f64::from(rng::unit(rng::hash(1, &[t])))).collect()
}

#[divan::bench(args = [120, 997, 3000])]
fn any_length_rustfft(length: usize) -> Vec<f64> {
    powers(&series(length), true)
}

#[divan::bench(args = [120, 997, 3000], sample_count = 5)]
fn any_length_sum(length: usize) -> Vec<f64> {
    let series = series(length);
    let power = |k: usize| {
        let add = |(re, im): (f64, f64), (t, v): (usize, &f64)| {
            let (sin, cos) = (std::f64::consts::TAU * ((k * t) % length) as f64 / length as f64).sin_cos();
            (re + v * cos, im + v * sin)
        };
        let (re, im) = series.iter().enumerate().fold((0.0, 0.0), add);
        re * re + im * im
    };
    (1..=length / 2).map(power).collect()
}
