//! Whole-pixel motion from frame to frame, and what is still owed.
//!
//! Patches lie on whole pixels, so a frame carried by parts of a pixel is snapped back: slow motion stands still, and fast
//! motion is blurred by interpolation. Here a frame is carried by the whole pixels of the motion alone, as an exact copy, and
//! the rest is kept for every pixel and added to its next motion (ours; LazyFluids does not say). What is shown is the frame
//! moved by what is owed, half a pixel at most.

use crate::base::par;
use crate::flow::field::Field;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;

/// Smoothing of what is owed before it is shown, pixels: it jumps by a pixel where neighbours round differently, and the
/// texture has grown together there.
const SHOWN_SIGMA: f32 = 1.5;

/// How the pixels of a frame come from the one before.
#[derive(Debug, Clone, PartialEq)]
pub struct Carry {
    width: usize,
    height: usize,
    /// Whole pixels (right, down) by which what is at a pixel has moved.
    steps: Vec<(i32, i32)>,
    /// What is still owed then, pixels.
    pub owed: Field,
}

impl Carry {
    /// From the motion that leads to the new frame, sampled there, and what was owed before it.
    pub fn new(flow: &Field, owed: &Field) -> Self {
        let (width, height) = (flow.width(), flow.height());
        let before = |x: usize, y: usize, dx: f32, dy: f32| {
            let column = (x as f32 - dx).round().clamp(0.0, width as f32 - 1.0) as usize;
            let row = (y as f32 - dy).round().clamp(0.0, height as f32 - 1.0) as usize;
            (owed.u.at(column, row), owed.v.at(column, row))
        };
        let carried = |i: usize| {
            let (x, y) = (i % width, i / width);
            let (u, v) = (flow.u.data[i], flow.v.data[i]);
            let (ou, ov) = before(x, y, u, v);
            let (du, dv) = ((u + ou).round(), (v + ov).round());
            // What is copied brings its own debt along.
            let (ou, ov) = before(x, y, du, dv);
            let rest = |v: f32| v.clamp(-1.0, 1.0);
            ((du as i32, dv as i32), rest(u + ou - du), rest(v + ov - dv))
        };
        let all = par::map(width * height, carried);
        let u = Plane::from_vec(width, height, all.iter().map(|c| c.1).collect());
        let v = Plane::from_vec(width, height, all.iter().map(|c| c.2).collect());
        let owed = Field { u, v };
        Self { width, height, steps: all.iter().map(|c| c.0).collect(), owed }
    }

    /// Where what is at a pixel was before; `None` beyond the border.
    fn origin(&self, x: usize, y: usize) -> Option<(usize, usize)> {
        let (dx, dy) = self.steps[y * self.width + x];
        let (x, y) = (x as i64 - i64::from(dx), y as i64 - i64::from(dy));
        let inside = x >= 0 && y >= 0 && x < self.width as i64 && y < self.height as i64;
        inside.then_some((x as usize, y as usize))
    }

    /// The same as a position, pixel centres at ½, as [`crate::patch::data::field::Nnf::carried`] wants it.
    pub fn position(&self, x: usize, y: usize) -> (f32, f32) {
        let (dx, dy) = self.steps[y * self.width + x];
        (x as f32 + 0.5 - dx as f32, y as f32 + 0.5 - dy as f32)
    }

    /// A plane of the frame before, carried; 0 where it comes from beyond the border.
    pub fn carried(&self, plane: &Plane) -> Plane {
        Plane::from_fn(self.width, self.height, |x, y| self.origin(x, y).map_or(0.0, |(x, y)| plane.at(x, y)))
    }

    /// 1 where there was a pixel before, 0 where it comes from beyond the border.
    pub fn known(&self) -> Plane {
        Plane::from_fn(self.width, self.height, |x, y| if self.origin(x, y).is_some() { 1.0 } else { 0.0 })
    }
}

/// A plane moved by `offset` pixels, sampled there, with a kernel that keeps it sharp; borders clamped.
pub fn moved(plane: &Plane, offset: &Field) -> Plane {
    let (width, height) = (plane.width, plane.height);
    let mut out = Plane::zeros(width, height);
    par::for_each_chunk(&mut out.data, width, |y, row| {
        for (x, value) in row.iter_mut().enumerate() {
            let (dx, dy) = (offset.u.at(x, y), offset.v.at(x, y));
            *value = if (dx, dy) == (0.0, 0.0) { plane.at(x, y) } else { sharp(plane, x as f32 - dx, y as f32 - dy) };
        }
    });
    out
}

/// What is owed as it is shown.
pub fn shown(owed: &Field) -> Field {
    Field { u: gaussian(&owed.u, SHOWN_SIGMA), v: gaussian(&owed.v, SHOWN_SIGMA) }
}

/// Value at a place in pixels from the first one's centre, by a Lanczos kernel of three lobes: what is shown half a pixel
/// away must not be duller than what is shown in place, or slow motion would pulse.
fn sharp(plane: &Plane, x: f32, y: f32) -> f32 {
    let (x0, y0) = (x.floor(), y.floor());
    let (wx, wy) = (lanczos(x - x0), lanczos(y - y0));
    let mut sum = 0.0;
    for (j, wy) in wy.iter().enumerate() {
        let row = y0 as isize + j as isize - 2;
        let across = |(i, w): (usize, &f32)| w * plane.clamped(x0 as isize + i as isize - 2, row);
        sum += wy * wx.iter().enumerate().map(across).sum::<f32>();
    }
    sum
}

/// Weights of the six pixels around a place `f` past the third.
fn lanczos(f: f32) -> [f32; 6] {
    let sinc =
        |x: f32| if x.abs() < 1e-4 { 1.0 } else { (std::f32::consts::PI * x).sin() / (std::f32::consts::PI * x) };
    let weights: [f32; 6] = std::array::from_fn(|i| {
        let d = f + 2.0 - i as f32;
        sinc(d) * sinc(d / 3.0)
    });
    let sum: f32 = weights.iter().sum();
    weights.map(|w| w / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uniform(u: f32, v: f32) -> Field {
        Field { u: Plane::filled(24, 20, u), v: Plane::filled(24, 20, v) }
    }

    #[test]
    fn steps_and_what_is_owed_are_the_whole_motion() {
        let flow = uniform(0.3, -1.45);
        let (mut owed, mut gone) = (Field::zeros(24, 20), (0, 0));
        for t in 1..=40 {
            let carry = Carry::new(&flow, &owed);
            let step = carry.steps[12 * 24 + 12];
            gone = (gone.0 + step.0, gone.1 + step.1);
            owed = carry.owed;
            let (u, v) = (gone.0 as f32 + owed.u.at(12, 12), gone.1 as f32 + owed.v.at(12, 12));
            assert!((u - 0.3 * t as f32).abs() < 1e-3 && (v + 1.45 * t as f32).abs() < 1e-3, "{t}: {u} {v}");
            assert!(owed.u.data.iter().chain(&owed.v.data).all(|o| o.abs() <= 0.5 + 1e-4));
        }
    }

    #[test]
    fn whole_steps_copy_and_what_comes_from_outside_is_unknown() {
        let plane = Plane::from_fn(24, 20, |x, y| (x + 24 * y) as f32);
        let carry = Carry::new(&uniform(3.0, 1.0), &Field::zeros(24, 20));
        let (carried, known) = (carry.carried(&plane), carry.known());
        assert_eq!((carried.at(10, 10), known.at(10, 10)), (plane.at(7, 9), 1.0));
        assert_eq!((carried.at(2, 10), known.at(2, 10), known.at(10, 0)), (0.0, 0.0, 0.0));
        assert_eq!(carry.position(10, 10), (7.5, 9.5));
    }

    #[test]
    fn half_a_pixel_away_a_picture_is_as_sharp() {
        let plane = Plane::from_fn(24, 20, |x, _| (x as f32 * 1.2).sin());
        let half = moved(&plane, &uniform(0.5, 0.0));
        for x in 4..20 {
            assert!((half.at(x, 9) - ((x as f32 - 0.5) * 1.2).sin()).abs() < 0.05, "{x}");
        }
        assert_eq!(moved(&plane, &uniform(0.0, 0.0)), plane);
    }
}
