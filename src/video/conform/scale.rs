//! From a decoded frame to packed RGB of the working size in one go: crop, antialiased scaling, chroma upsampling and
//! the colour matrix.
//!
//! Planes are scaled where they are small (chroma at its own resolution) and the matrix runs at the working size; both
//! are linear, so the order does not matter. Everything is integer: the same bytes on every machine.

use macro_rules_attribute::apply;

use crate::base::instructions::kernel;
use crate::raster::catmull_rom;
use crate::raster::image::Rgb8;
use crate::video::clip::{Pixels, RawFrame};
use crate::video::yuv::Decode;

/// Fractional bits of a tap's weight.
const WEIGHT_BITS: u32 = 14;
/// Fractional bits of a scaled sample.
const FRACTION: u32 = 6;

/// Which part of the source the output shows. Coordinates are continuous: pixel `i` covers `[i, i + 1)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Source column at the output's left edge.
    pub left: f64,
    /// Source row at the output's top edge.
    pub top: f64,
    /// Source pixels per output pixel, the same in x and y; at least 1 (nothing is enlarged but chroma).
    pub step: f64,
    /// Output width.
    pub width: usize,
    /// Output height.
    pub height: usize,
}

impl Window {
    /// All of a `width × height` frame as it is.
    pub fn whole(width: usize, height: usize) -> Self {
        Self { left: 0.0, top: 0.0, step: 1.0, width, height }
    }
}

/// Kernel values: Catmull–Rom where the plane shrinks or keeps its size, a triangle where it grows (chroma), which
/// cannot overshoot into false colour.
fn kernel(x: f64, grows: bool) -> f64 {
    match grows {
        true => (1.0 - x.abs()).max(0.0),
        false => catmull_rom::kernel(x),
    }
}

/// Weights of every output sample along one axis, all with the same number of taps.
#[derive(Debug, Clone)]
struct Taps {
    first: Vec<usize>,
    weights: Vec<i16>,
    count: usize,
}

impl Taps {
    /// Output `o` reads around `start + (o + ½)·step`; samples outside the `input` go to its border.
    fn new(input: usize, start: f64, step: f64, output: usize) -> Self {
        let grows = step < 0.999;
        let widen = step.max(1.0);
        let reach = if grows { 1.0 } else { 2.0 * widen };
        let last = input as isize - 1;
        let each: Vec<(usize, Vec<f64>)> = (0..output)
            .map(|o| {
                let centre = start + (o as f64 + 0.5) * step;
                let low = (centre - reach).floor() as isize;
                let high = (centre + reach).ceil() as isize;
                let first = low.clamp(0, last);
                let mut weights = vec![0.0; (high.clamp(0, last) - first + 1) as usize];
                for i in low..=high {
                    let weight = kernel((i as f64 + 0.5 - centre) / widen, grows);
                    weights[(i.clamp(0, last) - first) as usize] += weight;
                }
                trim(first as usize, weights)
            })
            .collect();
        let longest = each.iter().map(|(_, w)| w.len()).max().unwrap_or(1);
        let count = longest.next_multiple_of(4);
        let mut weights = Vec::with_capacity(count * output);
        for (_, w) in &each {
            weights.extend(quantised(w));
            weights.resize(weights.len().next_multiple_of(count), 0);
        }
        Self { first: each.into_iter().map(|(first, _)| first).collect(), weights, count }
    }

    fn of(&self, o: usize) -> &[i16] {
        &self.weights[o * self.count..(o + 1) * self.count]
    }
}

/// Drops negligible weights at both ends.
fn trim(first: usize, weights: Vec<f64>) -> (usize, Vec<f64>) {
    let small = |w: &f64| w.abs() < 1e-6;
    let skip = weights.iter().take_while(|w| small(w)).count().min(weights.len() - 1);
    let end = weights.len() - weights[skip..].iter().rev().take_while(|w| small(w)).count();
    (first + skip, weights[skip..end.max(skip + 1)].to_vec())
}

/// Rounded to integers that sum to exactly one; the largest tap takes the rest.
fn quantised(weights: &[f64]) -> Vec<i16> {
    let one = 1i32 << WEIGHT_BITS;
    let sum: f64 = weights.iter().sum();
    let mut out: Vec<i32> = weights.iter().map(|w| (w / sum * f64::from(one)).round() as i32).collect();
    let rest = one - out.iter().sum::<i32>();
    if let Some(largest) = out.iter_mut().max_by_key(|w| **w) {
        *largest += rest;
    }
    out.into_iter().map(|w| w as i16).collect()
}

/// Scales planes of one size.
#[derive(Debug, Clone)]
struct PlaneScaler {
    width: usize,
    height: usize,
    columns: Taps,
    rows: Taps,
    /// First and one-past-last source column that any output reads.
    span: (usize, usize),
}

impl PlaneScaler {
    fn new(width: usize, height: usize, origin: (f64, f64), step: (f64, f64), out: (usize, usize)) -> Self {
        let columns = Taps::new(width, origin.0, step.0, out.0);
        let rows = Taps::new(height, origin.1, step.1, out.1);
        let low = columns.first.iter().copied().min().unwrap_or(0);
        let high = columns.first.iter().map(|f| f + columns.count).max().unwrap_or(0).min(width);
        Self { width, height, columns, rows, span: (low, high) }
    }

    /// Output row `o` of `plane`; `sums` and `narrow` are scratch.
    fn row(&self, plane: &[u8], o: usize, sums: &mut Vec<i32>, narrow: &mut Vec<i16>, out: &mut [i16]) {
        let (low, high) = self.span;
        sums.clear();
        sums.resize(high - low, 1 << (WEIGHT_BITS - FRACTION - 1));
        for (i, &weight) in self.rows.of(o).iter().enumerate().filter(|(_, w)| **w != 0) {
            let y = self.rows.first[o] + i;
            debug_assert!(y < self.height);
            add_row(sums, &plane[y * self.width + low..y * self.width + high], i32::from(weight));
        }
        narrow.clear();
        narrow.resize(high - low + self.columns.count, 0);
        shrink_row(sums, narrow);
        match self.columns.count {
            4 => across::<4>(&self.columns, low, narrow, out),
            8 => across::<8>(&self.columns, low, narrow, out),
            12 => across::<12>(&self.columns, low, narrow, out),
            16 => across::<16>(&self.columns, low, narrow, out),
            _ => across_any(&self.columns, low, narrow, out),
        }
    }
}

#[apply(kernel)]
fn add_row(sums: &mut [i32], row: &[u8], weight: i32) {
    for (sum, &v) in sums.iter_mut().zip(row) {
        *sum += weight * i32::from(v);
    }
}

#[apply(kernel)]
fn shrink_row(sums: &[i32], out: &mut [i16]) {
    for (out, &sum) in out.iter_mut().zip(sums) {
        *out = (sum >> (WEIGHT_BITS - FRACTION)) as i16;
    }
}

#[inline(always)]
fn rounded(sum: i32) -> i16 {
    ((sum + (1 << (WEIGHT_BITS - 1))) >> WEIGHT_BITS) as i16
}

#[apply(kernel)]
fn across<const N: usize>(taps: &Taps, low: usize, row: &[i16], out: &mut [i16]) {
    for ((out, &first), weights) in out.iter_mut().zip(&taps.first).zip(taps.weights.chunks_exact(N)) {
        let samples = &row[first - low..first - low + N];
        let mut sum = 0;
        for i in 0..N {
            sum += i32::from(samples[i]) * i32::from(weights[i]);
        }
        *out = rounded(sum);
    }
}

#[apply(kernel)]
fn across_any(taps: &Taps, low: usize, row: &[i16], out: &mut [i16]) {
    for ((out, &first), weights) in out.iter_mut().zip(&taps.first).zip(taps.weights.chunks_exact(taps.count)) {
        let samples = &row[first - low..first - low + taps.count];
        let sum = samples.iter().zip(weights).map(|(&s, &w)| i32::from(s) * i32::from(w)).sum();
        *out = rounded(sum);
    }
}

/// Brings frames of one size and kind to packed RGB. Keeps its tables between frames.
#[derive(Debug)]
pub struct Scaler {
    window: Window,
    source: (usize, usize),
    luma: PlaneScaler,
    chroma: Option<((u8, u8), PlaneScaler)>,
    sums: Vec<i32>,
    narrow: Vec<i16>,
}

impl Scaler {
    /// For frames of `width × height`.
    ///
    /// # Panics
    /// When a size is 0.
    pub fn new(width: usize, height: usize, window: Window) -> Self {
        assert!(width > 0 && height > 0 && window.width > 0 && window.height > 0);
        let out = (window.width, window.height);
        let luma = PlaneScaler::new(width, height, (window.left, window.top), (window.step, window.step), out);
        Self { window, source: (width, height), luma, chroma: None, sums: Vec::new(), narrow: Vec::new() }
    }

    /// The window's pixels. Transparent parts show black below.
    ///
    /// # Panics
    /// When the frame has another size than was promised, or its planes do not fit its size.
    pub fn apply(&mut self, frame: &RawFrame) -> Rgb8 {
        assert_eq!((frame.width, frame.height), self.source);
        match &frame.pixels {
            Pixels::Yuv { planes, subsampling, matrix, range } => {
                self.prepare_chroma(*subsampling);
                self.yuv(planes, &Decode::new(*matrix, *range))
            }
            Pixels::Rgb(data) if self.is_whole() => {
                Rgb8 { width: frame.width, height: frame.height, data: data.clone() }
            }
            Pixels::Rgb(data) => self.rgb(&split(data.chunks_exact(3), |p, c| p[c])),
            Pixels::Rgba(data) => self.rgb(&split(data.chunks_exact(4), over_black)),
        }
    }

    fn is_whole(&self) -> bool {
        self.window == Window::whole(self.source.0, self.source.1)
    }

    fn prepare_chroma(&mut self, subsampling: (u8, u8)) {
        if self.chroma.as_ref().is_some_and(|(s, _)| *s == subsampling) {
            return;
        }
        let (sx, sy) = (f64::from(subsampling.0), f64::from(subsampling.1));
        let (width, height) = self.source;
        let size = (width.div_ceil(subsampling.0.into()), height.div_ceil(subsampling.1.into()));
        // Sited left: chroma sample i lies on luma column sx·i, that is at sx·i + ½; vertically it lies between rows.
        let origin = ((self.window.left - 0.5) / sx + 0.5, self.window.top / sy);
        let step = (self.window.step / sx, self.window.step / sy);
        let out = (self.window.width, self.window.height);
        self.chroma = Some((subsampling, PlaneScaler::new(size.0, size.1, origin, step, out)));
    }

    fn yuv(&mut self, planes: &[Vec<u8>; 3], decode: &Decode) -> Rgb8 {
        let mut out = Rgb8::black(self.window.width, self.window.height);
        let mut rows = [(); 3].map(|()| vec![0i16; self.window.width]);
        let chroma = self.chroma.as_ref().map_or(&self.luma, |(_, scaler)| scaler);
        for (o, rgb) in out.data.chunks_exact_mut(3 * self.window.width).enumerate() {
            for (c, row) in rows.iter_mut().enumerate() {
                let scaler = if c == 0 { &self.luma } else { chroma };
                scaler.row(&planes[c], o, &mut self.sums, &mut self.narrow, row);
            }
            decode.row::<FRACTION>(&rows[0], &rows[1], &rows[2], rgb);
        }
        out
    }

    fn rgb(&mut self, planes: &[Vec<u8>; 3]) -> Rgb8 {
        let mut out = Rgb8::black(self.window.width, self.window.height);
        let mut row = vec![0i16; self.window.width];
        for (o, rgb) in out.data.chunks_exact_mut(3 * self.window.width).enumerate() {
            for (c, plane) in planes.iter().enumerate() {
                self.luma.row(plane, o, &mut self.sums, &mut self.narrow, &mut row);
                for (pixel, &v) in rgb.chunks_exact_mut(3).zip(&row) {
                    pixel[c] = ((v + (1 << (FRACTION - 1))) >> FRACTION).clamp(0, 255) as u8;
                }
            }
        }
        out
    }
}

fn split<'a>(pixels: impl Iterator<Item = &'a [u8]> + Clone, channel: impl Fn(&[u8], usize) -> u8) -> [Vec<u8>; 3] {
    std::array::from_fn(|c| pixels.clone().map(|p| channel(p, c)).collect())
}

fn over_black(pixel: &[u8], c: usize) -> u8 {
    ((u16::from(pixel[c]) * u16::from(pixel[3]) + 127) / 255) as u8
}

/// A frame at its own size as packed RGB; transparent parts over black.
pub fn to_rgb8(frame: &RawFrame) -> Rgb8 {
    Scaler::new(frame.width, frame.height, Window::whole(frame.width, frame.height)).apply(frame)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::resample::resize_rgb8;
    use crate::video::clip::{Matrix, Range};
    use crate::video::yuv::from_rgb8;

    fn picture(width: usize, height: usize) -> Rgb8 {
        let wave = |x: usize, y: usize, k: f32| (127.0 + 100.0 * (x as f32 * k + y as f32 * 0.07).sin()) as u8;
        let data =
            (0..width * height).flat_map(|i| [0.05, 0.11, 0.03].map(|k| wave(i % width, i / width, k))).collect();
        Rgb8 { width, height, data }
    }

    fn yuv_frame(image: &Rgb8, matrix: Matrix, range: Range) -> RawFrame {
        let pixels = Pixels::Yuv { planes: from_rgb8(image, matrix, range), subsampling: (2, 2), matrix, range };
        RawFrame { width: image.width, height: image.height, time_ns: 0, pixels }
    }

    fn mean_difference(a: &Rgb8, b: &Rgb8) -> f64 {
        assert_eq!((a.width, a.height), (b.width, b.height));
        a.data.iter().zip(&b.data).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.data.len() as f64
    }

    #[test]
    fn smooth_pictures_survive_4_2_0_at_any_size() {
        for (width, height) in [(64, 48), (63, 47), (1, 1), (2, 3), (17, 1)] {
            for matrix in [Matrix::Bt601, Matrix::Bt709] {
                let image = picture(width, height);
                let back = to_rgb8(&yuv_frame(&image, matrix, Range::Full));
                let allowed = if width < 20 { 4.0 } else { 1.5 };
                assert!(mean_difference(&image, &back) < allowed, "{width}x{height}");
            }
        }
    }

    #[test]
    fn scaling_agrees_with_the_float_filter() {
        let image = picture(320, 180);
        let window = Window { left: 0.0, top: 0.0, step: 2.5, width: 128, height: 72 };
        let frame = RawFrame { width: 320, height: 180, time_ns: 0, pixels: Pixels::Rgb(image.data.clone()) };
        let small = Scaler::new(320, 180, window).apply(&frame);
        let expected = resize_rgb8(&image, 128, 72);
        assert!(small.data.iter().zip(&expected.data).all(|(a, b)| a.abs_diff(*b) <= 1));
        let from_yuv = Scaler::new(320, 180, window).apply(&yuv_frame(&image, Matrix::Bt709, Range::Limited));
        assert!(mean_difference(&from_yuv, &expected) < 1.5);
    }

    #[test]
    fn a_window_is_a_crop() {
        let image = picture(40, 30);
        let frame = RawFrame { width: 40, height: 30, time_ns: 0, pixels: Pixels::Rgb(image.data.clone()) };
        let window = Window { left: 5.0, top: 7.0, step: 1.0, width: 16, height: 16 };
        let crop = Scaler::new(40, 30, window).apply(&frame);
        for (x, y) in [(0, 0), (15, 15), (3, 9)] {
            assert_eq!(crop.pixel(x, y), image.pixel(x + 5, y + 7));
        }
    }

    #[test]
    fn transparency_is_black() {
        let frame = RawFrame {
            width: 2,
            height: 1,
            time_ns: 0,
            pixels: Pixels::Rgba(vec![200, 100, 50, 0, 200, 100, 50, 255]),
        };
        assert_eq!(to_rgb8(&frame).data, [0, 0, 0, 200, 100, 50]);
    }
}
