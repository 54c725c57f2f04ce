//! A picture's detail carried along a static flow, in a loop: the motion of Holynski, Curless, Seitz & Szeliski 2021
//! ("Animating pictures with Eulerian motion fields") in pixels, without their network.
//!
//! In a loop of N frames, frame t is the picture carried t frames forwards mixed with the picture carried N − t frames
//! backwards. Over a long loop that shears a picture to pieces, so a loop has several periods, and places begin theirs at
//! different times: fades, which are seen, are then somewhere all the time and nowhere at once. Coarse light and shade
//! belong to the place and stay.

use std::ops::Range;

use macro_rules_attribute::apply;

use super::extrapolate::fill;
use super::mirror::Mirror;
use super::sway::Sway;
use super::trajectory::Trajectories;
use crate::base::instructions::kernel;
use crate::base::{par, rng};
use crate::flow::field::Field;
use crate::library::variant::CELL;
use crate::raster::catmull_rom;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::raster::resample::{Resizer, resize};

/// Farthest that most detail strays from its place, pixels of the working image.
const STRAY: f32 = 64.0;
/// Share of places whose speed decides that.
const MOST: f32 = 0.95;
/// Shortest period, frames at 25 a second: shorter ones flash.
const SHORTEST: f32 = 6.0;
/// Distance over which places begin their periods independently, pixels of the working image.
const APART: f32 = 160.0;
/// Window over which the two copies of a fade are compared, pixels of the working image.
const ALIKE_SIGMA: f32 = 12.0;
/// Less than this of a copy is not seen.
const FAINT: f32 = 1.0 / 1024.0;

/// Steps of detail, per unit of colour: half those of the compositor's, so that twice the range fits.
pub const STEPS: f32 = 255.0 * 128.0;
/// Detail of a pixel, three channels and a rest, in [`STEPS`].
pub type Texel = [i16; 4];

/// How a picture is carried.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Carry<'a> {
    /// Motion, pixels of the working image per frame, at working size; what it is outside the fluid does not matter.
    pub flow: &'a Field,
    /// Frames of the loop.
    pub frames: usize,
    /// Frames per second.
    pub fps: f32,
    /// Longest period, frames at 25 a second.
    pub life: f32,
    /// Share of a period in which two copies are seen, above 0 to 1.
    pub fade: f32,
    /// Seed of where periods begin.
    pub seed: u64,
}

/// Detail at output size, and how it travels.
pub struct Carried {
    size: (usize, usize),
    texels: Vec<Texel>,
    trajectories: Trajectories,
    sway: Option<Sway>,
    mirror: Mirror,
    /// Per cell: where its period begins, in periods.
    phases: Vec<f32>,
    /// Per cell: correlation of the two copies in the middle of a fade.
    alike: Vec<f32>,
    fade: f32,
    /// Periods of the loop, and its frames.
    periods: usize,
    frames: usize,
    resizer: Resizer,
    /// Luma of the detail, at working size.
    luma: Plane,
}

impl Carried {
    /// Carries `texels` of an output of `size`; `luma` is that of theirs at working size and `matte` where fluid is.
    pub fn new(texels: Vec<Texel>, size: (usize, usize), luma: Plane, matte: &Plane, carry: &Carry) -> Self {
        let &Carry { frames, fade, .. } = carry;
        let periods = carry.periods(matte);
        let flow = inside(carry.flow, matte);
        let period = frames as f32 / periods as f32;
        let trajectories = Trajectories::trace(&flow, period * (0.5 + 0.5 * fade));
        let mirror = Mirror::new(matte);
        let alike = alike(&luma, matte, &mirror, &trajectories, period);
        let cells = trajectories.size();
        let phases = (0..cells.0 * cells.1).map(|i| phase(carry.seed, i % cells.0, i / cells.0)).collect();
        let resizer = Resizer::new(cells, size);
        Self { size, texels, trajectories, sway: None, mirror, phases, alike, fade, periods, frames, resizer, luma }
    }

    /// Lets it sway about its way.
    ///
    /// # Panics
    /// When the loop or the cells are others.
    pub fn sway(&mut self, sway: Sway) {
        assert_eq!((sway.size(), sway.frames()), (self.trajectories.size(), self.frames));
        self.sway = Some(sway);
    }

    /// Way of a cell `age` frames back, in frame `t`: back to where it does not sway, and from there along the flow.
    fn way(&self, t: usize, cell: usize, age: f32) -> (f32, f32) {
        let Some(sway) = &self.sway else { return self.trajectories.way(cell, age) };
        let (u, v) = sway.at(t, cell);
        let (along, down) = self.trajectories.way_near(cell, (-u, -v), age);
        (along - u, down - v)
    }

    /// What all of frame `t` shares.
    pub fn at(&self, t: usize) -> Moment<'_> {
        let (width, height) = self.trajectories.size();
        let period = self.frames as f32 / self.periods as f32;
        let time = (t % self.frames) as f32 / period;
        let mut copies: [Copy; 2] = std::array::from_fn(|_| Copy::zeros(width, height));
        for (cell, (phase, alike)) in self.phases.iter().zip(&self.alike).enumerate() {
            let now = time + phase;
            let since = now - now.floor();
            // Copies keep their number from birth to death, so that values between cells are those of one copy.
            let young = now.floor() as usize % 2;
            let ages = [since, since - 1.0];
            let weights = self.weights(since);
            let norm = (weights[0].powi(2) + weights[1].powi(2) + 2.0 * alike * weights[0] * weights[1]).sqrt();
            for ((age, weight), copy) in ages.into_iter().zip(weights).zip([young, 1 - young]) {
                let (u, v) = self.way(t % self.frames, cell, age * period);
                let copy = &mut copies[copy];
                (copy.u.data[cell], copy.v.data[cell], copy.share.data[cell]) = (u, v, weight / norm);
            }
        }
        Moment { carried: self, copies }
    }

    /// Weights of the copy that was at its place `since` periods ago and of the one that will be in the rest of one.
    fn weights(&self, since: f32) -> [f32; 2] {
        let t = (0.5 + (since - 0.5) / self.fade).clamp(0.0, 1.0);
        let next = t * t * (3.0 - 2.0 * t);
        [1.0 - next, next]
    }

    /// Detail at `(x, y)`, pixels of the output, centres at ½; Catmull–Rom, borders clamped.
    #[inline(always)]
    fn detail(&self, x: f32, y: f32) -> [f32; 3] {
        let (fx, fy) = (x - 0.5, y - 0.5);
        let (x0, y0) = (fx.floor(), fy.floor());
        let (wx, wy) = (catmull_rom::weights(fx - x0), catmull_rom::weights(fy - y0));
        let (x0, y0) = (x0 as isize - 1, y0 as isize - 1);
        let mut sum = [0.0f32; 4];
        for (j, wy) in wy.into_iter().enumerate() {
            let start = (y0 + j as isize).clamp(0, self.size.1 as isize - 1) as usize * self.size.0;
            for (i, wx) in wx.into_iter().enumerate() {
                let texel = self.texels[start + (x0 + i as isize).clamp(0, self.size.0 as isize - 1) as usize];
                sum.iter_mut().zip(texel).for_each(|(s, v)| *s += wy * wx * f32::from(v));
            }
        }
        [sum[0], sum[1], sum[2]]
    }
}

impl Carry<'_> {
    /// How many periods the loop has, so that none is longer than wanted and most detail strays no farther than
    /// [`STRAY`].
    fn periods(&self, matte: &Plane) -> usize {
        let most = matte.data.iter().fold(0.0f32, |most, m| most.max(*m));
        let inside = |(s, m): (&f32, &f32)| (*m >= 0.5 * most).then_some(*s);
        let mut speeds: Vec<f32> = self.flow.magnitude().data.iter().zip(&matte.data).filter_map(inside).collect();
        let fast = match speeds.len() {
            0 => 0.0,
            n => *speeds.select_nth_unstable_by(((n - 1) as f32 * MOST) as usize, f32::total_cmp).1,
        };
        let rate = self.fps / 25.0;
        let far = STRAY / (fast * (0.5 + 0.5 * self.fade)).max(1e-6);
        let period = far.min(self.life * rate).max(SHORTEST * rate);
        ((self.frames as f32 / period).round() as usize).max(1)
    }
}

/// The flow of the fluid, which outside of it is as it is beside.
pub fn inside(flow: &Field, matte: &Plane) -> Field {
    let most = matte.data.iter().fold(0.0f32, |most, m| most.max(*m));
    let known = matte.map(|m| if m >= 0.5 * most { 1.0 } else { 0.0 });
    let [u, v] = fill(&[&flow.u, &flow.v], &known).try_into().expect("two planes of two");
    Field { u, v }
}

/// One of the two copies that a frame shows, on cells.
struct Copy {
    /// Way to where it is read, pixels of the working image.
    u: Plane,
    v: Plane,
    /// How much of it is seen.
    share: Plane,
}

impl Copy {
    fn zeros(width: usize, height: usize) -> Self {
        let [u, v, share] = std::array::from_fn(|_| Plane::zeros(width, height));
        Self { u, v, share }
    }
}

/// One frame of a [`Carried`].
pub struct Moment<'a> {
    carried: &'a Carried,
    copies: [Copy; 2],
}

impl Moment<'_> {
    /// Detail in a window of the output, in [`STEPS`], channel by channel; `matte` has the window's size, 255 where detail
    /// is wholly carried and 0 where it stays.
    pub fn window(&self, x: Range<usize>, y: Range<usize>, matte: &[u8]) -> [Vec<f32>; 3] {
        let carried = self.carried;
        let sized = |plane: &Plane| carried.resizer.window(plane, x.clone(), y.clone());
        let copies = self.copies.each_ref().map(|c| [sized(&c.u), sized(&c.v), sized(&c.share)]);
        let mut out: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; matte.len()]);
        let width = x.len().max(1);
        for (j, (y, matte)) in y.zip(matte.chunks_exact(width)).enumerate() {
            let rows = copies.each_ref().map(|copy| copy.each_ref().map(|plane| plane.row(j)));
            row(carried, (x.start, y), rows, matte, out.each_mut().map(|c| &mut c[j * width..][..width]));
        }
        out
    }

    /// Luma of the detail at working size, as if there were fluid everywhere.
    pub fn luma(&self) -> Plane {
        let Carried { mirror, luma, .. } = self.carried;
        let (width, height) = mirror.size();
        let sized = |plane: &Plane| resize(plane, width, height);
        let copies = self.copies.each_ref().map(|c| [sized(&c.u), sized(&c.v), sized(&c.share)]);
        Plane::from_fn(width, height, |x, y| {
            let seen = |[u, v, share]: &[Plane; 3]| {
                let (px, py) = mirror.place(x as f32 + 0.5 + u.at(x, y), y as f32 + 0.5 + v.at(x, y));
                share.at(x, y) * luma.bilinear(px, py)
            };
            copies.iter().map(seen).sum()
        })
    }
}

/// Detail of the pixels `from` one to the right; `copies` holds the ways and shares of each.
#[apply(kernel)]
fn row(carried: &Carried, from: (usize, usize), copies: [[&[f32]; 3]; 2], matte: &[u8], out: [&mut [f32]; 3]) {
    let ((left, y), [red, green, blue]) = (from, out);
    let working = (carried.mirror.size().0 as f32, carried.mirror.size().1 as f32);
    let (across, down) = (working.0 / carried.size.0 as f32, working.1 / carried.size.1 as f32);
    for (i, (((red, green), blue), &m)) in red.iter_mut().zip(green).zip(blue).zip(matte).enumerate() {
        let own = carried.texels[y * carried.size.0 + left + i];
        let mut sum = [0.0f32; 3];
        if m > 0 {
            let (x, y) = ((left + i) as f32 + 0.5, y as f32 + 0.5);
            for [u, v, share] in copies {
                if share[i].abs() > FAINT {
                    let (px, py) = carried.mirror.place(x * across + u[i], y * down + v[i]);
                    let detail = carried.detail(px / across, py / down);
                    sum.iter_mut().zip(detail).for_each(|(s, d)| *s += share[i] * d);
                }
            }
        }
        let moving = f32::from(m) * (1.0 / 255.0);
        let mixed: [f32; 3] = std::array::from_fn(|c| f32::from(own[c]) + moving * (sum[c] - f32::from(own[c])));
        [*red, *green, *blue] = mixed;
    }
}

/// Where in its period a cell is in frame 0: smooth over the picture, for a leap would tear it.
fn phase(seed: u64, x: usize, y: usize) -> f32 {
    let place = |v: usize| {
        let place = (v * CELL) as f32 / APART;
        let share = place.fract();
        (place as u64, share * share * (3.0 - 2.0 * share))
    };
    let ((x, ax), (y, ay)) = (place(x), place(y));
    let at = |x: u64, y: u64| rng::unit(rng::hash(seed, &[x, y]));
    let mix = |a: f32, b: f32, share: f32| a + share * (b - a);
    mix(mix(at(x, y), at(x + 1, y), ax), mix(at(x, y + 1), at(x + 1, y + 1), ax), ay)
}

/// Per cell the correlation of what two copies half a period to either side of their place show there, 0 to 1.
fn alike(detail: &Plane, matte: &Plane, mirror: &Mirror, trajectories: &Trajectories, period: f32) -> Vec<f32> {
    let (width, height) = (detail.width, detail.height);
    let cells = trajectories.size();
    let rows = par::map(height, |y| {
        let pixel = |x: usize| {
            let cell = (y / CELL) * cells.0 + x / CELL;
            let [a, b] = [0.5, -0.5].map(|age| {
                let (u, v) = trajectories.way(cell, age * period);
                let (x, y) = mirror.place(x as f32 + 0.5 + u, y as f32 + 0.5 + v);
                detail.bilinear(x, y)
            });
            let m = matte.at(x, y);
            [m * a * b, m * (a * a + b * b) * 0.5]
        };
        (0..width).map(pixel).collect::<Vec<_>>()
    });
    let plane = |k: usize| {
        let plane = Plane::from_vec(width, height, rows.iter().flatten().map(|p| p[k]).collect());
        resize(&gaussian(&plane, ALIKE_SIGMA), cells.0, cells.1)
    };
    let (products, squares) = (plane(0), plane(1));
    products
        .data
        .iter()
        .zip(&squares.data)
        .map(|(p, s)| if *s > 1e-9 { (p / s).clamp(0.0, 1.0) } else { 1.0 })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{hash, unit};

    const SIZE: (usize, usize) = (160, 120);

    fn texel(x: usize, y: usize) -> f32 {
        unit(hash(3, &[x as u64 / 2, y as u64 / 2])) - 0.5
    }

    /// Noise carried along a flow over a matte; periods begin everywhere at once.
    fn carried(flow: &Field, matte: &Plane, life: f32) -> Carried {
        let (frames, fps) = (48, 25.0);
        let carry = Carry { flow, frames, fps, life, fade: 0.5, seed: 1 };
        let texels = (0..SIZE.0 * SIZE.1).map(|i| [(texel(i % SIZE.0, i / SIZE.0) * STEPS) as i16; 4]).collect();
        let mut carried = Carried::new(texels, SIZE, Plane::from_fn(SIZE.0, SIZE.1, texel), matte, &carry);
        carried.phases.fill(0.0);
        carried
    }

    fn uniform(u: f32, v: f32) -> Field {
        Field { u: Plane::filled(SIZE.0, SIZE.1, u), v: Plane::filled(SIZE.0, SIZE.1, v) }
    }

    fn window(carried: &Carried, t: usize) -> Vec<f32> {
        let [red, green, blue] = carried.at(t).window(20..140, 20..100, &[255; 120 * 80]);
        assert!(red == green && green == blue);
        red
    }

    fn deviation(values: &[f32]) -> f32 {
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / values.len() as f32).sqrt()
    }

    #[test]
    fn where_one_copy_is_seen_it_has_gone_as_far_as_the_flow() {
        let carried = carried(&uniform(2.0, -1.0), &Plane::filled(SIZE.0, SIZE.1, 1.0), 16.0);
        assert_eq!(carried.periods, 3);
        for t in [0, 1, 3, 16, 19, 34] {
            for (i, v) in window(&carried, t).into_iter().enumerate() {
                let (x, y) = (20 + i % 120 - 2 * (t % 16), 20 + i / 120 + t % 16);
                let expected = (texel(x, y) * STEPS).trunc();
                assert!((v - expected).abs() < 2.0, "frame {t}: {v} {expected} at {x}, {y}");
            }
        }
    }

    #[test]
    fn contrast_stays_through_fades_and_the_loop_closes() {
        let carried = carried(&uniform(1.5, 0.0), &Plane::filled(SIZE.0, SIZE.1, 1.0), 16.0);
        let whole = deviation(&window(&carried, 0));
        for t in 0..48 {
            let ratio = deviation(&window(&carried, t)) / whole;
            // Between pixels interpolation takes some of it: frames of whole pixels, and the middle of a fade.
            assert!(t % 2 == 1 || (0.94..1.06).contains(&ratio), "frame {t}: {ratio}");
        }
        assert_eq!(window(&carried, 0), window(&carried, 48));
        let step = |t: usize| {
            let (a, b) = (window(&carried, t), window(&carried, t + 1));
            a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum::<f32>()
        };
        assert!((step(47) / step(31) - 1.0).abs() < 0.01);
    }

    #[test]
    fn nothing_outside_the_fluid_flows_in() {
        // Outside, detail is 1; in the fluid it is 0.
        let matte = Plane::from_fn(SIZE.0, SIZE.1, |x, y| if x + y / 3 < 60 { 0.0 } else { 1.0 });
        let flow = uniform(3.0, 0.5);
        let carry = Carry { flow: &flow, frames: 20, fps: 25.0, life: 20.0, fade: 0.5, seed: 1 };
        let outside = matte.map(|m| 1.0 - m);
        let texels = outside.data.iter().map(|o| [(o * STEPS) as i16; 4]).collect();
        let carried = Carried::new(texels, SIZE, outside.clone(), &matte, &carry);
        for t in 0..20 {
            let [red, ..] = carried.at(t).window(0..SIZE.0, 0..SIZE.1, &[255; SIZE.0 * SIZE.1]);
            for (i, v) in red.iter().enumerate().filter(|(i, _)| i % SIZE.0 + i / SIZE.0 / 3 > 64) {
                assert!(v.abs() < 0.2 * STEPS, "frame {t}: {v} at {}, {}", i % SIZE.0, i / SIZE.0);
            }
        }
        // A matte of 0 leaves every pixel its own.
        let [still, ..] = carried.at(5).window(0..SIZE.0, 0..SIZE.1, &[0; SIZE.0 * SIZE.1]);
        assert!(still.iter().zip(&outside.data).all(|(s, o)| *s == (o * STEPS).trunc()));
    }

    #[test]
    fn fast_flow_has_short_periods_and_still_fluid_stays() {
        let matte = Plane::filled(SIZE.0, SIZE.1, 1.0);
        assert!(carried(&uniform(9.0, 0.0), &matte, 48.0).periods > 3);
        let still = carried(&uniform(0.0, 0.0), &matte, 48.0);
        assert_eq!(still.periods, 1);
        let first = window(&still, 0);
        assert!((1..48).all(|t| window(&still, t).iter().zip(&first).all(|(a, b)| (a - b).abs() < 1.0)));
    }
}
