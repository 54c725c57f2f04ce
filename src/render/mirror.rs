//! Fluid for places outside the fluid: as if its edge were a mirror.
//!
//! What is carried in over an edge has to come from somewhere. Rocks must not flow in, and one colour drawn out from the
//! edge would look like threads; the mirror image of the fluid beside the edge looks like fluid, and moves as it should.

use crate::flow::field::Field;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;

/// Matte from which on a pixel is fluid, as a share of the largest.
const INSIDE: f32 = 0.5;

/// Smoothing of the mirror, pixels.
const SMOOTH: f32 = 1.5;

/// For every place the place in the fluid that is shown instead.
#[derive(Debug, Clone, PartialEq)]
pub struct Mirror {
    /// Ways to those places, pixels of the matte; 0 in the fluid.
    ways: Field,
}

impl Mirror {
    /// For the fluid of a matte, which must not be black.
    pub fn new(matte: &Plane) -> Self {
        let least = INSIDE * matte.data.iter().fold(0.0f32, |m, v| m.max(*v));
        let inside = |x: isize, y: isize| matte.clamped(x, y) >= least;
        let (width, height) = (matte.width as isize, matte.height as isize);
        let mut ways = Field::zeros(matte.width, matte.height);
        for (i, (nx, ny)) in nearest(matte, least).into_iter().enumerate() {
            let (x, y) = (i as isize % width, i as isize / width);
            let (dx, dy) = (nx as isize - x, ny as isize - y);
            if (dx, dy) == (0, 0) {
                continue;
            }
            // As far behind the edge as the place is before it, or nearer where the fluid is narrow.
            let fits = |depth: &f32| {
                let at = |n: usize, d: isize| n as isize + (depth * d as f32).round() as isize;
                let (x, y) = (at(nx, dx), at(ny, dy));
                (0..width).contains(&x) && (0..height).contains(&y) && inside(x, y)
            };
            let depth = [1.0, 0.75, 0.5, 0.25].into_iter().find(fits).unwrap_or(0.0);
            ways.u.data[i] = (1.0 + depth) * dx as f32;
            ways.v.data[i] = (1.0 + depth) * dy as f32;
        }
        // From pixel to pixel the nearest one leaps; what is seen in the mirror must not.
        let smooth = |plane: &Plane| {
            let mut smooth = gaussian(plane, SMOOTH);
            smooth.data.iter_mut().zip(&plane.data).filter(|(_, p)| **p == 0.0).for_each(|(s, _)| *s = 0.0);
            smooth
        };
        Self { ways: Field { u: smooth(&ways.u), v: smooth(&ways.v) } }
    }

    /// Width and height of the matte.
    pub fn size(&self) -> (usize, usize) {
        (self.ways.width(), self.ways.height())
    }

    /// Where to look instead of at `(x, y)`, centres at ½; beyond the picture's borders they are mirrors too.
    #[inline(always)]
    pub fn place(&self, x: f32, y: f32) -> (f32, f32) {
        let (width, height) = (self.ways.width() as f32, self.ways.height() as f32);
        let within = |v: f32, size: f32| {
            if v < 0.0 {
                -v
            } else if v > size {
                2.0 * size - v
            } else {
                v
            }
        };
        let (x, y) = (within(x, width).clamp(0.0, width), within(y, height).clamp(0.0, height));
        (x + self.ways.u.bilinear(x, y), y + self.ways.v.bilinear(x, y))
    }
}

/// For every pixel the nearest of at least `least`, found from neighbour to neighbour (Danielsson 1980).
fn nearest(matte: &Plane, least: f32) -> Vec<(usize, usize)> {
    let (width, height) = (matte.width, matte.height);
    const NONE: (usize, usize) = (usize::MAX, usize::MAX);
    let mut found: Vec<(usize, usize)> =
        (0..width * height).map(|i| if matte.data[i] >= least { (i % width, i / width) } else { NONE }).collect();
    let squared = |(x, y): (usize, usize), to: (usize, usize)| {
        if to == NONE { usize::MAX } else { x.abs_diff(to.0).pow(2) + y.abs_diff(to.1).pow(2) }
    };
    for _ in 0..2 {
        for back in [false, true] {
            let sign = if back { 1 } else { -1 };
            for j in 0..height {
                let y = if back { height - 1 - j } else { j };
                for i in 0..2 * width {
                    // Each row once each way, so that what is beside is known as well.
                    let x = if (i < width) == back { width - 1 - i % width } else { i % width };
                    for (dx, dy) in [(-1, 0), (1, 0), (-1, sign), (0, sign), (1, sign)] {
                        let (Some(nx), Some(ny)) = (x.checked_add_signed(dx), y.checked_add_signed(dy)) else {
                            continue;
                        };
                        if nx < width && ny < height {
                            let other = found[ny * width + nx];
                            if squared((x, y), other) < squared((x, y), found[y * width + x]) {
                                found[y * width + x] = other;
                            }
                        }
                    }
                }
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outside_shows_the_mirror_image_and_inside_itself() {
        let mirror = Mirror::new(&Plane::from_fn(60, 40, |x, _| if x < 20 { 0.0 } else { 1.0 }));
        assert_eq!(mirror.place(30.3, 7.9), (30.3, 7.9));
        for x in [18.5, 12.5, 2.5] {
            let (mx, my) = mirror.place(x, 20.5);
            assert!((mx - (41.0 - x)).abs() < 2.0 && (my - 20.5).abs() < 1e-3, "{x}: {mx}, {my}");
        }
        let (x, y) = mirror.place(70.0, -5.0);
        assert_eq!((x, y), (50.0, 5.0));
    }

    #[test]
    fn narrow_fluid_is_not_left() {
        let matte = Plane::from_fn(60, 40, |x, _| if (28..32).contains(&x) { 1.0 } else { 0.0 });
        let mirror = Mirror::new(&matte);
        for x in 0..60 {
            let (mx, _) = mirror.place(x as f32 + 0.5, 20.5);
            assert!((26.0..=34.0).contains(&mx), "{x}: {mx}");
        }
    }

    #[test]
    fn nearest_is_nearest() {
        let matte =
            Plane::from_fn(31, 23, |x, y| if [(3, 4), (25, 11), (9, 20)].contains(&(x, y)) { 1.0 } else { 0.0 });
        for (i, found) in nearest(&matte, 0.5).into_iter().enumerate() {
            let squared = |(x, y): (usize, usize)| (i % 31).abs_diff(x).pow(2) + (i / 31).abs_diff(y).pow(2);
            let best = [(3, 4), (25, 11), (9, 20)].into_iter().map(squared).min();
            assert_eq!(Some(squared(found)), best, "pixel {i}");
        }
    }
}
