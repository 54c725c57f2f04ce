//! What changes in a fluid besides that it flows (Okabe, Anjyo, Igarashi & Seidel 2009): differences from the average
//! image, in the frame that moves with the flow.
//!
//! With `D_t` the differences and `W` the transport by the mean flow, the residuals are `R_t = D_t − ρ W(D_{t−1})`. The
//! memory ρ is ours: it is fitted, place by place, to how much of the differences is still there a frame later, so that
//! residuals added up along a flow neither pile up nor die away.

use super::transport::Transport;
use crate::base::error::Result;
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;

/// Window over which memory is fitted, pixels (σ).
const WINDOW: f32 = 20.0;
/// Longest memory: half of a difference is forgotten within 23 frames.
const LONGEST: f32 = 0.97;
/// Differences of less energy are noise, squared luma: there is no memory of them.
const NOISE: f32 = 0.002 * 0.002;
/// Frames that are taken apart together.
const TOGETHER: usize = 8;

/// Steps of a difference, per unit of luma.
const STEPS: f32 = 8192.0;

/// Signed differences of luma, of magnitude below 4, in 16 bits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packed {
    width: usize,
    height: usize,
    data: Vec<i16>,
}

impl Packed {
    /// Rounds a plane.
    pub fn new(plane: &Plane) -> Self {
        let data = plane.data.iter().map(|v| (v * STEPS).round() as i16).collect();
        Self { width: plane.width, height: plane.height, data }
    }

    /// As a plane.
    pub fn unpacked(&self) -> Plane {
        let data = self.data.iter().map(|&v| f32::from(v) * (1.0 / STEPS)).collect();
        Plane::from_vec(self.width, self.height, data)
    }

    /// Bytes that one of `pixels` takes.
    pub fn bytes(pixels: usize) -> usize {
        pixels * size_of::<i16>()
    }
}

/// A loop of differences taken apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Residuals {
    /// ρ: share of the differences that goes on with the flow to the next frame.
    pub memory: Plane,
    /// R of every frame.
    frames: Vec<Packed>,
}

impl Residuals {
    /// Takes apart the differences `differences(t)` of `frames` frames, the last of which leads back to the first; tells
    /// `stage` of every frame.
    ///
    /// # Errors
    /// A cancel.
    pub fn of(
        frames: usize,
        differences: impl Fn(usize) -> Plane + Sync + Send,
        transport: &Transport,
        stage: &str,
        observer: &dyn Observer,
    ) -> Result<Self> {
        let pair = |t: usize| (differences(t), transport.apply(&differences((t + frames - 1) % frames)));
        let memory = memory(frames, &pair, observer)?;
        let mut out = Vec::with_capacity(frames);
        for begin in (0..frames).step_by(TOGETHER) {
            observe::check(observer)?;
            let residual = |k: usize| {
                let (mut now, before) = pair(begin + k);
                let carried = before.data.iter().zip(&memory.data);
                now.data.iter_mut().zip(carried).for_each(|(d, (b, rho))| *d -= rho * b);
                Packed::new(&now)
            };
            out.extend(par::map(TOGETHER.min(frames - begin), residual));
            observer.advance(stage, TOGETHER.min(frames - begin) as u64);
        }
        Ok(Self { memory, frames: out })
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// The residual of frame `t`, which goes round.
    pub fn at(&self, t: usize) -> Plane {
        self.frames[t % self.frames.len()].unpacked()
    }
}

/// Slope of the differences over those of the frame before, carried along: the ρ that leaves least.
fn memory(
    frames: usize,
    pair: &(impl Fn(usize) -> (Plane, Plane) + Sync + Send),
    observer: &dyn Observer,
) -> Result<Plane> {
    let (first, _) = pair(0);
    let mut sums = [Plane::zeros(first.width, first.height), Plane::zeros(first.width, first.height)];
    for begin in (0..frames).step_by(TOGETHER) {
        observe::check(observer)?;
        for (now, before) in par::map(TOGETHER.min(frames - begin), |k| pair(begin + k)) {
            for (i, (d, b)) in now.data.iter().zip(&before.data).enumerate() {
                sums[0].data[i] += d * b;
                sums[1].data[i] += b * b;
            }
        }
    }
    let [products, squares] = sums.map(|sum| gaussian(&sum, WINDOW));
    let slope = |(p, s): (&f32, &f32)| (p / (s + NOISE * frames as f32)).clamp(0.0, LONGEST);
    let data = products.data.iter().zip(&squares.data).map(slope).collect();
    Ok(Plane::from_vec(first.width, first.height, data))
}

/// Frames after which nothing is left to be seen of a difference that goes on by `memory` from frame to frame.
pub fn forgotten(memory: &Plane) -> usize {
    const UNSEEN: f32 = 1.0 / 256.0;
    let longest = memory.data.iter().fold(0.0f32, |m, v| m.max(*v)).min(LONGEST);
    if longest < UNSEEN { 1 } else { (UNSEEN.ln() / longest.ln()).ceil() as usize }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::observe::Silent;
    use crate::base::rng::{hash, unit};
    use crate::flow::field::Field;

    const SIZE: (usize, usize) = (64, 48);
    const FRAMES: usize = 40;

    /// Soft noise that sinks by a pixel a frame while a share of it is renewed, in a loop; `rho` goes on.
    fn differences(rho: f32) -> Vec<Plane> {
        let fresh = |t: usize| {
            let at = |x: usize, y: usize| unit(hash(t as u64, &[x as u64, y as u64])) - 0.5;
            gaussian(&Plane::from_fn(SIZE.0, SIZE.1, at), 1.5)
        };
        let mut now = Plane::zeros(SIZE.0, SIZE.1);
        let mut out = Vec::new();
        for t in 0..4 * FRAMES {
            let new = fresh(t % FRAMES);
            let carried = |x: usize, y: usize| now.clamped(x as isize, y as isize - 1);
            now = Plane::from_fn(SIZE.0, SIZE.1, |x, y| rho * carried(x, y) + new.at(x, y));
            out.push(now.clone());
        }
        out.split_off(3 * FRAMES)
    }

    fn taken_apart(rho: f32) -> (Vec<Plane>, Transport, Residuals) {
        let d = differences(rho);
        let flow = Field { u: Plane::zeros(SIZE.0, SIZE.1), v: Plane::filled(SIZE.0, SIZE.1, 1.0) };
        let transport = Transport::along(&flow, None);
        let residuals = Residuals::of(FRAMES, |t| d[t].clone(), &transport, "residuals", &Silent).unwrap();
        (d, transport, residuals)
    }

    #[test]
    fn memory_is_the_share_that_goes_on() {
        for rho in [0.3, 0.8] {
            let (_, _, residuals) = taken_apart(rho);
            let found = residuals.memory.at(32, 24);
            assert!((found - rho).abs() < 0.08, "{found} of {rho}");
        }
    }

    #[test]
    fn residuals_carried_along_the_flow_are_the_clip_again_and_close_the_loop() {
        let (d, transport, residuals) = taken_apart(0.8);
        let mut now = Plane::zeros(SIZE.0, SIZE.1);
        let run_in = forgotten(&residuals.memory).next_multiple_of(FRAMES);
        for t in 0..run_in + FRAMES {
            let (before, new) = (transport.apply(&now), residuals.at(t));
            let sum = (0..new.data.len()).map(|i| residuals.memory.data[i] * before.data[i] + new.data[i]);
            now = Plane::from_vec(SIZE.0, SIZE.1, sum.collect());
            if t >= run_in {
                let worst = now.data.iter().zip(&d[t % FRAMES].data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(worst < 5e-3, "frame {t}: {worst}");
            }
        }
    }

    #[test]
    fn still_water_has_neither_memory_nor_residuals() {
        let transport = Transport::along(&Field::zeros(SIZE.0, SIZE.1), None);
        let still = |_| Plane::zeros(SIZE.0, SIZE.1);
        let residuals = Residuals::of(5, still, &transport, "residuals", &Silent).unwrap();
        assert!(residuals.memory.data.iter().all(|&v| v == 0.0) && forgotten(&residuals.memory) == 1);
        assert!((0..7).all(|t| residuals.at(t).data.iter().all(|&v| v == 0.0)));
    }
}
