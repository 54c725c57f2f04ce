//! The moving outline of fire and smoke: the matte carried along by the animation's own flow (Okabe et al. 2011, §6).

use super::extrapolate::fill;
use crate::flow::field::Field;
use crate::flow::tv_l1::{Params, TvL1};
use crate::raster::image::Plane;
use crate::raster::pyramid::{expand, reduce};

/// Farthest from the matte that the fluid goes, pixels of the working image: differences exist no farther.
pub const REACH: f32 = 64.0;
/// Steps of the table that powers are taken from.
const STEPS: usize = 1024;
/// Largest power, and one over the smallest, that brings the area back.
const MAX_POWER: f32 = 16.0;
/// Brighter or darker by more than this many contrasts counts no more.
const MAX_CONTRASTS: f32 = 2.0;

/// `B_1 = α`, `B_{t+1} = τ W_t(B_t) + (1 − τ) α`, each step raised to the power that keeps `Σ B = Σ α`.
#[derive(Debug, Clone)]
pub struct Boundary {
    tau: f32,
    matte: Plane,
    /// 1 near the matte, 0 from [`REACH`] on.
    envelope: Plane,
    area: f64,
    now: Plane,
}

impl Boundary {
    /// Starts with the outline at the matte (0 to 1, working size); `tau`, 0 to 0.98, is how far it lets go of it.
    pub fn new(matte: &Plane, tau: f32) -> Self {
        let area = matte.data.iter().map(|&a| f64::from(a)).sum();
        Self { tau, matte: matte.clone(), envelope: envelope(matte), area, now: matte.clone() }
    }

    /// Frames until the start is forgotten, to half an 8-bit step: from then on the outline repeats with the flow.
    pub fn run_in(tau: f32) -> usize {
        if tau <= 0.0 { 0 } else { ((1.0f32 / 512.0).ln() / tau.ln()).ceil() as usize }
    }

    /// How much of each pixel the fluid covers now, 0 to 1.
    pub fn now(&self) -> &Plane {
        &self.now
    }

    /// Goes on by one frame, along the flow from this frame to the next, pixels of the matte per frame.
    pub fn step(&mut self, flow: &Field) {
        let Self { tau, matte, envelope, .. } = self;
        let mut next = warp(&self.now, flow);
        for ((n, a), e) in next.data.iter_mut().zip(&matte.data).zip(&envelope.data) {
            *n = (e * (*tau * *n + (1.0 - *tau) * a)).clamp(0.0, 1.0);
        }
        keep_area(&mut next, self.area);
        self.now = next;
    }
}

/// Opens and closes an outline with the texture that moves in it: to opacities B comes `flicker` · B (1 − B) · d, where d
/// tells how much brighter than the average a frame is, in units of the picture's own `contrast` (luma); 0 and 1 stay. The
/// outline alone is as smooth as the mean of many frames, flames have tongues.
pub fn flicker(outline: &mut Plane, differences: &Plane, contrast: &Plane, flicker: f32) {
    for ((o, d), c) in outline.data.iter_mut().zip(&differences.data).zip(&contrast.data) {
        let brighter = (d / c).clamp(-MAX_CONTRASTS, MAX_CONTRASTS);
        *o = (*o * (1.0 + flicker * brighter * (1.0 - *o))).clamp(0.0, 1.0);
    }
}

/// What was at `q − F(q)` is at `q` (methods, Notation).
fn warp(plane: &Plane, flow: &Field) -> Plane {
    Plane::from_fn(plane.width, plane.height, |x, y| {
        let (u, v) = (flow.u.at(x, y), flow.v.at(x, y));
        if u == 0.0 && v == 0.0 { plane.at(x, y) } else { plane.bilinear(x as f32 + 0.5 - u, y as f32 + 0.5 - v) }
    })
}

/// Raises all values to one power so that they sum to `area`, or as near as a power can bring them; 0 and 1 stay.
fn keep_area(plane: &mut Plane, area: f64) {
    // The power is taken from a table between whose steps values are interpolated, so the sum over the table's steps,
    // weighted by a histogram, is the very sum over the pixels.
    let place = |v: f32| {
        let p = v * STEPS as f32;
        let i = (p as usize).min(STEPS - 1);
        (i, p - i as f32)
    };
    let mut histogram = vec![0.0f64; STEPS + 1];
    for &v in &plane.data {
        let (i, share) = place(v);
        histogram[i] += f64::from(1.0 - share);
        histogram[i + 1] += f64::from(share);
    }
    let powers = |power: f32| (0..=STEPS).map(move |i| (i as f32 / STEPS as f32).powf(power));
    let sum = |power: f32| powers(power).zip(&histogram).map(|(p, h)| f64::from(p) * h).sum::<f64>();
    let (mut low, mut high) = (-MAX_POWER.log2(), MAX_POWER.log2());
    if (sum(1.0) - area).abs() <= 1e-6 * area {
        return;
    }
    for _ in 0..24 {
        let middle = 0.5 * (low + high);
        if sum(middle.exp2()) > area { low = middle } else { high = middle }
    }
    let table: Vec<f32> = powers((0.5 * (low + high)).exp2()).collect();
    for v in &mut plane.data {
        let (i, share) = place(*v);
        *v = table[i] + share * (table[i + 1] - table[i]);
    }
}

/// 1 up to half of [`REACH`] from where the matte is not black, then smoothly to 0.
pub fn envelope(matte: &Plane) -> Plane {
    distance(matte).map(|d| {
        let t = (2.0 - 2.0 * d / REACH).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    })
}

/// Distance in pixels from where the matte is not black, measured along rows, columns and diagonals.
fn distance(matte: &Plane) -> Plane {
    const STRAIGHT: f32 = 1.0;
    const DIAGONAL: f32 = std::f32::consts::SQRT_2;
    let (width, height) = (matte.width, matte.height);
    let far = (width + height) as f32;
    let mut out = matte.map(|m| if m > 0.0 { 0.0 } else { far });
    for back in [false, true] {
        let sign = if back { 1 } else { -1 };
        for j in 0..height {
            let y = if back { height - 1 - j } else { j };
            for i in 0..width {
                let x = if back { width - 1 - i } else { i };
                let at = |dx: isize, dy: isize, step: f32| {
                    let (nx, ny) = (x.checked_add_signed(dx), y.checked_add_signed(dy));
                    match (nx, ny) {
                        (Some(nx), Some(ny)) if nx < width && ny < height => out.at(nx, ny) + step,
                        _ => far,
                    }
                };
                let rows = [(-1, DIAGONAL), (0, STRAIGHT), (1, DIAGONAL)].map(|(dx, step)| at(dx, sign, step));
                let nearest = rows.into_iter().fold(at(sign, 0, STRAIGHT), f32::min);
                *out.at_mut(x, y) = out.at(x, y).min(nearest);
            }
        }
    }
    out
}

/// Motion from one frame of the fluid to the next, at the size of the matte: TV-L1 at half that size, and outside the
/// matte, where there is nothing to see and optical flow invents, what moves inside beside it.
pub fn fluid_flow(from: &Plane, to: &Plane, matte: &Plane) -> Field {
    let (from, to, weight) = (reduce(from), reduce(to), reduce(matte));
    let mut half = Field::default();
    TvL1::new(from.width, from.height, Params::library()).flow(&from, &to, &mut half);
    let full = |plane: &Plane| expand(plane, matte.width, matte.height).map(|v| 2.0 * v);
    let filled = fill(&[&half.u, &half.v], &weight);
    Field { u: full(&filled[0]), v: full(&filled[1]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn disc(radius: f32) -> Plane {
        Plane::from_fn(160, 120, |x, y| {
            let d = (x as f32 - 79.5).hypot(y as f32 - 59.5);
            (0.5 + 0.25 * (radius - d)).clamp(0.0, 1.0)
        })
    }

    fn uniform(u: f32, v: f32) -> Field {
        Field { u: Plane::filled(160, 120, u), v: Plane::filled(160, 120, v) }
    }

    fn sum(plane: &Plane) -> f64 {
        plane.data.iter().map(|&v| f64::from(v)).sum()
    }

    fn centre(plane: &Plane) -> (f64, f64) {
        let moment = |f: fn(usize, usize) -> f64| {
            let at = |i: usize| f(i % plane.width, i / plane.width) * f64::from(plane.data[i]);
            (0..plane.data.len()).map(at).sum::<f64>() / sum(plane)
        };
        (moment(|x, _| x as f64), moment(|_, y| y as f64))
    }

    #[test]
    fn a_still_flow_leaves_the_matte() {
        let matte = disc(25.0);
        let mut boundary = Boundary::new(&matte, 0.9);
        for _ in 0..5 {
            boundary.step(&uniform(0.0, 0.0));
        }
        let worst = boundary.now().data.iter().zip(&matte.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-5, "{worst}");
    }

    #[test]
    fn a_uniform_flow_displaces_the_outline_by_its_share_and_keeps_the_area() {
        let matte = disc(25.0);
        for (tau, u, v) in [(0.9, 1.0, 0.0), (0.8, 0.0, -2.0)] {
            let mut boundary = Boundary::new(&matte, tau);
            for _ in 0..Boundary::run_in(tau) {
                boundary.step(&uniform(u, v));
                assert!((sum(boundary.now()) / sum(&matte) - 1.0).abs() < 1e-3);
            }
            let ((x0, y0), (x1, y1)) = (centre(&matte), centre(boundary.now()));
            let reach = f64::from(tau / (1.0 - tau));
            let (dx, dy) = (x1 - x0, y1 - y0);
            assert!((dx - reach * f64::from(u)).abs() < 0.15 * reach.max(1.0) * f64::from(u.abs()) + 0.1, "{dx}");
            assert!((dy - reach * f64::from(v)).abs() < 0.15 * reach.max(1.0) * f64::from(v.abs()) + 0.1, "{dy}");
        }
    }

    #[test]
    fn the_outline_repeats_with_the_flow_after_the_run_in() {
        let matte = disc(25.0);
        let flow = |t: usize| {
            let phase = t as f32 / 24.0 * std::f32::consts::TAU;
            let wave = |x: usize, y: usize| 2.0 * (0.1 * x as f32 + phase).sin() * (0.07 * y as f32).cos();
            Field { u: Plane::from_fn(160, 120, wave), v: Plane::from_fn(160, 120, |x, y| wave(y, x) - 1.0) }
        };
        let mut boundary = Boundary::new(&matte, 0.9);
        let run_in = Boundary::run_in(0.9).next_multiple_of(24);
        (0..run_in).for_each(|t| boundary.step(&flow(t)));
        let first = boundary.now().clone();
        let mut moved = 0.0f32;
        for t in 0..24 {
            boundary.step(&flow(t));
            moved = boundary.now().data.iter().zip(&first.data).map(|(a, b)| (a - b).abs()).fold(moved, f32::max);
        }
        let seam = boundary.now().data.iter().zip(&first.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(seam < 1.0 / 255.0 && moved > 0.2, "seam {seam}, moved {moved}");
    }

    #[test]
    fn bright_texture_opens_the_outline_and_dark_closes_it() {
        let matte = disc(25.0);
        let differences = Plane::from_fn(160, 120, |x, _| if x < 80 { 0.1 } else { -0.1 });
        let mut outline = matte.clone();
        flicker(&mut outline, &differences, &Plane::filled(160, 120, 0.1), 1.0);
        for (i, (o, m)) in outline.data.iter().zip(&matte.data).enumerate() {
            assert!(if i % 160 < 80 { o >= m } else { o <= m });
            assert!(o == m || (*m > 0.0 && *m < 1.0));
        }
        let mut quiet = matte.clone();
        flicker(&mut quiet, &Plane::zeros(160, 120), &Plane::filled(160, 120, 0.1), 1.0);
        assert!(quiet == matte && outline != matte);
    }

    #[test]
    fn nothing_leaks_beyond_the_reach() {
        let mut boundary = Boundary::new(&disc(20.0), 0.98);
        for _ in 0..60 {
            boundary.step(&uniform(9.0, 0.0));
        }
        let distance = distance(&disc(20.0));
        assert!(boundary.now().data.iter().zip(&distance.data).all(|(b, d)| *d < REACH || *b == 0.0));
    }

    #[test]
    fn flow_outside_the_matte_is_that_inside_it() {
        let texture = |x: f32, y: f32| 0.5 + 0.2 * ((0.5 * x).sin() + (0.4 * y + 0.2 * x).sin());
        let matte = disc(25.0);
        let frame = |shift: f32| Plane::from_fn(160, 120, |x, y| matte.at(x, y) * texture(x as f32 - shift, y as f32));
        let flow = fluid_flow(&frame(0.0), &frame(1.0), &disc(20.0));
        for (x, y) in [(80, 60), (120, 60), (80, 10), (20, 110)] {
            let (u, v) = (flow.u.at(x, y), flow.v.at(x, y));
            assert!((u - 1.0).abs() < 0.4 && v.abs() < 0.4, "{u}, {v} at {x}, {y}");
        }
    }
}
