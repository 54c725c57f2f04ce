//! Antialiased resizing.

use std::ops::Range;

use super::image::{Color, Plane, Rgb8, Space};

/// Weights of one output sample: first input index and taps.
struct Taps {
    first: usize,
    weights: Vec<f32>,
}

/// Catmull–Rom cubic.
fn cubic(x: f32) -> f32 {
    let x = x.abs();
    if x < 1.0 {
        (1.5 * x - 2.5) * x * x + 1.0
    } else if x < 2.0 {
        ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0
    } else {
        0.0
    }
}

/// Catmull–Rom taps for every output sample, widened when shrinking; weights outside the input go to the border.
fn taps(input: usize, output: usize) -> Vec<Taps> {
    let ratio = input as f32 / output as f32;
    let widen = ratio.max(1.0);
    let at = |o: usize| {
        let centre = (o as f32 + 0.5) * ratio;
        let low = (centre - 2.0 * widen).floor() as isize;
        let high = (centre + 2.0 * widen).ceil() as isize;
        let last = input as isize - 1;
        let first = low.clamp(0, last);
        let mut weights = vec![0.0; (high.clamp(0, last) - first + 1) as usize];
        for i in low..=high {
            weights[(i.clamp(0, last) - first) as usize] += cubic((i as f32 + 0.5 - centre) / widen);
        }
        let sum: f32 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        Taps { first: first as usize, weights }
    };
    (0..output).map(at).collect()
}

/// Resizes a plane to `width` × `height` with a Catmull–Rom kernel, widened when shrinking (antialiased). Values may
/// overshoot slightly at edges.
pub fn resize(plane: &Plane, width: usize, height: usize) -> Plane {
    if (plane.width, plane.height) == (width, height) {
        return plane.clone();
    }
    Resizer::new((plane.width, plane.height), (width, height)).window(plane, 0..width, 0..height)
}

/// [`resize`] between two sizes, window by window.
pub struct Resizer {
    horizontal: Vec<Taps>,
    vertical: Vec<Taps>,
    same: bool,
}

impl Resizer {
    /// From planes of one width and height to another.
    pub fn new(from: (usize, usize), to: (usize, usize)) -> Self {
        Self { horizontal: taps(from.0, to.0), vertical: taps(from.1, to.1), same: from == to }
    }

    /// The pixels `x`, `y` of the resized plane, as [`resize`] would give them.
    ///
    /// # Panics
    /// When the plane is smaller than it was said to be or the window reaches beyond the resized one.
    pub fn window(&self, plane: &Plane, x: Range<usize>, y: Range<usize>) -> Plane {
        if self.same {
            let data = y.clone().flat_map(|y| &plane.row(y)[x.clone()]).copied().collect();
            return Plane::from_vec(x.len(), y.len(), data);
        }
        let (horizontal, vertical) = (&self.horizontal[x], &self.vertical[y]);
        let first = vertical.first().map_or(0, |tap| tap.first);
        let end = vertical.last().map_or(0, |tap| tap.first + tap.weights.len());
        let mut narrow = Plane::zeros(horizontal.len(), end - first);
        for row in first..end {
            let source = plane.row(row);
            for (out, tap) in narrow.row_mut(row - first).iter_mut().zip(horizontal) {
                *out = source[tap.first..].iter().zip(&tap.weights).map(|(v, w)| v * w).sum();
            }
        }
        let mut out = Plane::zeros(horizontal.len(), vertical.len());
        for (y, tap) in vertical.iter().enumerate() {
            for (i, &w) in tap.weights.iter().enumerate() {
                let row = narrow.row(tap.first - first + i);
                out.row_mut(y).iter_mut().zip(row).for_each(|(o, &v)| *o += w * v);
            }
        }
        out
    }
}

/// [`resize`] on each channel.
pub fn resize_color<S: Space>(image: &Color<S>, width: usize, height: usize) -> Color<S> {
    image.map_planes(|plane| resize(plane, width, height))
}

/// [`resize`] on 8-bit RGB, rounded and clamped.
pub fn resize_rgb8(image: &Rgb8, width: usize, height: usize) -> Rgb8 {
    if (image.width, image.height) == (width, height) {
        return image.clone();
    }
    resize_color(&image.to_color(), width, height).to_rgb8()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_and_ramps_survive() {
        let flat = resize(&Plane::filled(13, 9, 0.7), 5, 20);
        assert!(flat.data.iter().all(|v| (v - 0.7).abs() < 1e-5));
        let ramp = resize(&Plane::from_fn(64, 4, |x, _| x as f32 + 0.5), 32, 4);
        for x in 4..28 {
            assert!((ramp.at(x, 1) - (x as f32 + 0.5) * 2.0).abs() < 1e-3);
        }
    }

    #[test]
    fn a_window_is_a_part_of_the_whole() {
        let plane = Plane::from_fn(31, 17, |x, y| (x * x + 3 * y) as f32);
        for (width, height) in [(70, 50), (12, 9), (31, 17)] {
            let whole = resize(&plane, width, height);
            let part = Resizer::new((31, 17), (width, height)).window(&plane, 3..9, 2..7);
            assert!((0..5).all(|y| part.row(y) == &whole.row(y + 2)[3..9]));
        }
    }

    #[test]
    fn shrinking_removes_what_the_small_image_cannot_hold() {
        let stripes = Plane::from_fn(64, 8, |x, _| (x % 2) as f32);
        let small = resize(&stripes, 16, 8);
        assert!(small.row(4)[1..15].iter().all(|v| (v - 0.5).abs() < 0.05), "{:?}", small.row(4));
    }
}
