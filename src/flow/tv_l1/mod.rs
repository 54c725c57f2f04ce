//! Dense optical flow by TV-L1 (Zach, Pock & Bischof 2007, "A duality based approach for realtime TV-L1 optical flow").
//!
//! Minimises `∫ |∇u| + |∇v| + λ |I₁(x + u) − I₀(x)|` coarse to fine. On each level the residual is linearised around
//! the present motion a few times (*warps*); the linearised problem is split into a thresholding and a total-variation
//! step coupled by θ, which alternate for a number of *iterations*, the dual variables carried on from warp to warp.
//! One thread per pair of frames; callers run pairs in parallel.

mod iterate;
mod median;
mod scale;
mod warp;

use crate::flow::field::Field;
use crate::raster::image::Plane;

use iterate::{Channel, State, Weights};
use median::Median;
use scale::{Axis, Refine};
use warp::{Linearise, Padded};

/// What the solver does, and how long. Images are luma in [0, 1], lengths pixels, motion pixels per frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Params {
    /// Weight λ of the data term, pixels of motion variation per unit of luma: 255 times the λ of implementations
    /// that work on grey levels 0–255. Larger follows the images more closely and is rougher.
    pub lambda: f32,
    /// Coupling θ between data and smoothness, pixels². Larger converges faster and blurs more.
    pub theta: f32,
    /// Dual step τ as a share of θ, at most ¼ (Chambolle 2004).
    pub tau: f32,
    /// Size of each pyramid level relative to the next finer one, 0.5 to 0.9. Larger is slower.
    pub scale: f32,
    /// The coarsest level's shorter side is not below this many pixels.
    pub min_side: usize,
    /// Linearisations per level. More is slower.
    pub warps: usize,
    /// Fused iterations per linearisation. More is slower.
    pub iterations: usize,
    /// Radius of the median filter after each warp: 0 (none), 1 (3 × 3) or 2 (5 × 5).
    pub median: usize,
    /// Share of the image gradient taken from the first frame, 0 to 1; ½ treats both frames alike.
    pub gradient_blend: f32,
}

impl Params {
    /// Accuracy first: the preset that the end-point errors on the Middlebury pairs are quoted for.
    pub fn quality() -> Self {
        Self {
            lambda: 60.0,
            theta: 0.15,
            tau: 0.24,
            scale: 0.7,
            min_side: 16,
            warps: 8,
            iterations: 50,
            median: 2,
            gradient_blend: 0.5,
        }
    }

    /// For whole libraries of clips: about 35 ms for a pair of 640 × 360 frames on one core.
    ///
    /// The counterpart of θ = 1.0, λ = 0.8 and 25 iterations of Okabe et al. 2011, §4, whose units are not given. λ is
    /// the smallest that no longer loses accuracy when a frame of a real clip is predicted from its two neighbours
    /// along the flow; above it only the roughness of whitewater grows.
    pub fn library() -> Self {
        Self { lambda: 20.0, theta: 0.3, scale: 0.5, warps: 4, iterations: 25, median: 1, ..Self::quality() }
    }
}

/// One level of the pyramid.
#[derive(Debug, Clone)]
struct Level {
    width: usize,
    height: usize,
    /// Weights from the next finer level; unused on the finest.
    shrink: (Axis, Axis),
    frames: [Vec<f32>; 2],
}

/// A solver for pairs of frames of one size; owns every buffer it needs.
#[derive(Debug, Clone)]
pub struct TvL1 {
    params: Params,
    /// Finest first.
    levels: Vec<Level>,
    state: State,
    coarse: State,
    padded: [Padded; 2],
    linearise: Linearise,
    refine: Refine,
    median: Median,
    rows: Vec<f32>,
}

impl TvL1 {
    /// A solver for frames of `width` × `height` pixels.
    pub fn new(width: usize, height: usize, params: Params) -> Self {
        let mut levels = vec![Level { width, height, shrink: Default::default(), frames: Default::default() }];
        let scale = f64::from(params.scale.clamp(0.5, 0.95));
        while width.min(height) > 0 {
            let factor = scale.powi(levels.len() as i32);
            let size = |v: usize| (v as f64 * factor).round() as usize;
            let (w, h) = (size(width), size(height));
            if w.min(h) < params.min_side.max(1) {
                break;
            }
            let finer = &levels[levels.len() - 1];
            let shrink = (Axis::new(finer.width, w), Axis::new(finer.height, h));
            levels.push(Level { width: w, height: h, shrink, frames: Default::default() });
        }
        Self {
            params,
            levels,
            state: State::default(),
            coarse: State::default(),
            padded: Default::default(),
            linearise: Linearise::default(),
            refine: Refine::default(),
            median: Median::default(),
            rows: Vec::new(),
        }
    }

    /// Motion from frame `from` to frame `to` (luma in [0, 1]) into `out`, which is resized as needed.
    ///
    /// # Panics
    /// When a frame has not the size the solver was made for.
    pub fn flow(&mut self, from: &Plane, to: &Plane, out: &mut Field) {
        let (width, height) = (self.levels[0].width, self.levels[0].height);
        assert!([from, to].iter().all(|frame| (frame.width, frame.height) == (width, height)), "frame size");
        if (out.width(), out.height()) != (width, height) {
            *out = Field::zeros(width, height);
        }
        if width == 0 || height == 0 {
            return;
        }
        self.build_pyramid(from, to);
        for level in (0..self.levels.len()).rev() {
            self.enter(level);
            self.solve();
        }
        for y in 0..height {
            out.u.row_mut(y).copy_from_slice(self.state.row(Channel::U, y));
            out.v.row_mut(y).copy_from_slice(self.state.row(Channel::V, y));
        }
    }

    fn build_pyramid(&mut self, from: &Plane, to: &Plane) {
        for (i, frame) in [from, to].into_iter().enumerate() {
            self.levels[0].frames[i].clear();
            self.levels[0].frames[i].extend_from_slice(&frame.data);
            for l in 1..self.levels.len() {
                let (finer, coarser) = self.levels.split_at_mut(l);
                let (source, level) = (&finer[l - 1].frames[i], &mut coarser[0]);
                scale::resize(source, &level.shrink.0, &level.shrink.1, &mut self.rows, &mut level.frames[i]);
            }
        }
    }

    /// Starts a level from the motion of the coarser one, or from rest.
    fn enter(&mut self, level: usize) {
        let Level { width, height, .. } = self.levels[level];
        std::mem::swap(&mut self.state, &mut self.coarse);
        self.state.resize(width, height);
        if level + 1 < self.levels.len() {
            self.refine.apply(&self.coarse, &mut self.state);
        }
        for (padded, frame) in self.padded.iter_mut().zip(&self.levels[level].frames) {
            padded.fill(width, height, frame);
        }
    }

    /// Warps and iterations of one level.
    fn solve(&mut self) {
        let Params { lambda, theta, tau, warps, iterations, median, gradient_blend, .. } = self.params;
        let weights = Weights { reach: lambda * theta, theta, dual_step: tau / theta };
        for _ in 0..warps {
            self.linearise.apply(&mut self.state, &self.padded[0], &self.padded[1], gradient_blend);
            self.state.iterate(iterations, weights);
            self.median.apply(&mut self.state, median);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth texture that has gradients everywhere, at continuous pixel coordinates.
    fn texture(x: f32, y: f32) -> f32 {
        let wave = |fx: f32, fy: f32, phase: f32| (fx * x + fy * y + phase).sin();
        0.5 + 0.1 * (wave(0.31, 0.11, 0.3) + wave(-0.13, 0.37, 1.1) + wave(0.21, -0.23, 2.0) + wave(0.05, 0.08, 0.7))
    }

    /// Frames of the texture moved by `motion(x, y)` between them.
    fn pair(width: usize, height: usize, motion: impl Fn(f32, f32) -> (f32, f32)) -> (Plane, Plane) {
        let from = Plane::from_fn(width, height, |x, y| texture(x as f32, y as f32));
        let to = Plane::from_fn(width, height, |x, y| {
            let (u, v) = motion(x as f32, y as f32);
            texture(x as f32 - u, y as f32 - v)
        });
        (from, to)
    }

    fn solve(params: Params, from: &Plane, to: &Plane) -> Field {
        let mut out = Field::default();
        TvL1::new(from.width, from.height, params).flow(from, to, &mut out);
        out
    }

    #[test]
    fn translations_are_found() {
        for params in [Params::quality(), Params::library()] {
            for (u, v) in [(0.25, -0.4), (1.0, 0.0), (-3.5, 2.25), (6.0, 5.0)] {
                let (from, to) = pair(96, 80, |_, _| (u, v));
                let flow = solve(params, &from, &to);
                for (y, x) in (12..68).flat_map(|y| (12..84).map(move |x| (y, x))) {
                    let error = (flow.u.at(x, y) - u).hypot(flow.v.at(x, y) - v);
                    assert!(error < 0.1, "{error} at {x},{y} for {u},{v}");
                }
            }
        }
    }

    #[test]
    fn identical_frames_give_exactly_zero() {
        let (frame, _) = pair(50, 37, |_, _| (0.0, 0.0));
        for params in [Params::quality(), Params::library()] {
            let flow = solve(params, &frame, &frame);
            assert!(flow.u.data.iter().chain(&flow.v.data).all(|&c| c == 0.0));
        }
    }

    #[test]
    fn a_rotation_is_found() {
        let turn = 0.03f32;
        let motion = |x: f32, y: f32| (-turn * (y - 40.0), turn * (x - 48.0));
        // What is at x in the second frame was at R⁻¹ x in the first.
        let (sin, cos) = (turn.sin(), turn.cos());
        let from = Plane::from_fn(96, 80, |x, y| texture(x as f32, y as f32));
        let to = Plane::from_fn(96, 80, |x, y| {
            let (dx, dy) = (x as f32 - 48.0, y as f32 - 40.0);
            texture(48.0 + cos * dx + sin * dy, 40.0 - sin * dx + cos * dy)
        });
        for params in [Params::quality(), Params::library()] {
            let flow = solve(params, &from, &to);
            let place = |i: usize| (8 + i % 80, 8 + i / 80);
            let errors = (0..80 * 64).map(place).map(|(x, y)| {
                let (u, v) = motion(x as f32, y as f32);
                (flow.u.at(x, y) - u).hypot(flow.v.at(x, y) - v)
            });
            let mean = errors.sum::<f32>() / (80.0 * 64.0);
            assert!(mean < 0.08, "mean error {mean}");
        }
    }

    #[test]
    fn any_size_works_and_a_solver_can_be_used_again() {
        for (width, height) in [(0, 0), (0, 5), (1, 1), (3, 2), (2, 40), (17, 5), (61, 47)] {
            let (from, to) = pair(width, height, |_, _| (0.5, 0.25));
            for params in [Params::quality(), Params::library()] {
                let mut solver = TvL1::new(width, height, params);
                let (mut first, mut second) = (Field::default(), Field::zeros(2, 2));
                solver.flow(&from, &to, &mut first);
                solver.flow(&to, &from, &mut second);
                solver.flow(&from, &to, &mut second);
                assert_eq!((first.width(), first.height()), (width, height));
                assert!(first.u.data.iter().chain(&first.v.data).all(|c| c.is_finite()));
                assert_eq!(first, second);
            }
        }
    }

    #[test]
    fn mirrored_frames_give_the_mirrored_flow() {
        let (from, to) = pair(70, 50, |x, y| (1.0 + 0.01 * y, -0.02 * x));
        let mirror = |p: &Plane| Plane::from_fn(p.width, p.height, |x, y| p.at(p.width - 1 - x, y));
        let flow = solve(Params::library(), &from, &to);
        let mirrored = solve(Params::library(), &mirror(&from), &mirror(&to));
        let error = |x: usize, y: usize| {
            (mirrored.u.at(69 - x, y) + flow.u.at(x, y)).hypot(mirrored.v.at(69 - x, y) - flow.v.at(x, y))
        };
        let mean = (0..50 * 70).map(|i| error(i % 70, i / 70)).sum::<f32>() / 3500.0;
        assert!(mean < 0.02, "mean difference {mean}");
    }
}
