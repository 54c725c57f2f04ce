//! What changes in a fluid besides that it flows (Okabe, Anjyo, Igarashi & Seidel 2009): differences from the average
//! image, in the frame that moves with the flow.
//!
//! With `D_t` the differences and `W` the transport by the mean flow, the residuals are `R_t = D_t − ρ W(D_{t−1})`. The
//! memory ρ is ours: it is fitted, place by place and band by band, to how much of the differences is still there a frame
//! later, so that residuals added up along a flow neither pile up nor die away. Fine detail is forgotten soon and coarse
//! detail late; with one ρ for all, fine detail would trail behind itself as noise.

use super::layout::BANDS;
use super::transport::Transport;
use crate::base::error::Result;
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::raster::pyramid::{collapse, laplacian};
use crate::raster::resample::resize;

/// Window over which memory is fitted, pixels (σ).
const WINDOW: f32 = 20.0;
/// Longest memory: half of a difference is forgotten within 14 frames.
const LONGEST: f32 = 0.95;
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

/// ρ: share of the differences that goes on with the flow to the next frame, per band, each at its size; what is coarser
/// than all bands is forgotten.
#[derive(Debug, Clone, PartialEq)]
pub struct Memory(Vec<Plane>);

impl Memory {
    /// What is left of differences that were carried along.
    pub fn of(&self, carried: &Plane) -> Plane {
        let (mut bands, _) = laplacian(carried, BANDS);
        for (band, rho) in bands.iter_mut().zip(&self.0) {
            band.data.iter_mut().zip(&rho.data).for_each(|(b, rho)| *b *= rho);
        }
        collapse(&bands, None)
    }

    /// The memory elsewhere: `place` takes each band's from the size of the differences to that of another plane.
    pub fn placed(&self, place: impl Fn(&Plane) -> Plane) -> Self {
        let (width, height) = (self.0[0].width, self.0[0].height);
        let placed = |band: &Plane| place(&resize(band, width, height));
        let bands: Vec<Plane> = self.0.iter().map(placed).collect();
        let (empty, _) = laplacian(&Plane::zeros(bands[0].width, bands[0].height), BANDS);
        Self(bands.iter().zip(&empty).map(|(b, size)| resize(b, size.width, size.height)).collect())
    }

    /// Frames after which nothing is left to be seen of a difference.
    pub fn length(&self) -> usize {
        const UNSEEN: f32 = 1.0 / 256.0;
        let longest = self.0.iter().flat_map(|band| &band.data).fold(UNSEEN, |m, v| m.max(*v)).min(LONGEST);
        (UNSEEN.ln() / longest.ln()).ceil() as usize
    }
}

/// A loop of differences taken apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Residuals {
    /// How long differences go on.
    pub memory: Memory,
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
                now.data.iter_mut().zip(&memory.of(&before).data).for_each(|(d, b)| *d -= b);
                Packed::new(&now)
            };
            out.extend(par::map(TOGETHER.min(frames - begin), residual));
            observer.advance(stage, TOGETHER.min(frames - begin) as u64);
        }
        Ok(Self { memory, frames: out })
    }

    /// Number of frames.
    pub fn count(&self) -> usize {
        self.frames.len()
    }

    /// The residual of frame `t`, which goes round.
    pub fn at(&self, t: usize) -> Plane {
        self.frames[t % self.frames.len()].unpacked()
    }
}

/// Slopes of the differences over those of the frame before, carried along: the ρ that leave least.
fn memory(
    frames: usize,
    pair: &(impl Fn(usize) -> (Plane, Plane) + Sync + Send),
    observer: &dyn Observer,
) -> Result<Memory> {
    let bands = |plane: &Plane| laplacian(plane, BANDS).0;
    let mut sums: [Vec<Plane>; 2] = std::array::from_fn(|_| bands(&pair(0).0).iter().map(|b| b.map(|_| 0.0)).collect());
    for begin in (0..frames).step_by(TOGETHER) {
        observe::check(observer)?;
        let pairs = par::map(TOGETHER.min(frames - begin), |k| {
            let (now, before) = pair(begin + k);
            (bands(&now), bands(&before))
        });
        for (now, before) in &pairs {
            for (k, (now, before)) in now.iter().zip(before).enumerate() {
                for (i, (d, b)) in now.data.iter().zip(&before.data).enumerate() {
                    sums[0][k].data[i] += d * b;
                    sums[1][k].data[i] += b * b;
                }
            }
        }
    }
    let slope = |k: usize| {
        let sigma = (WINDOW / (1 << k) as f32).max(1.5);
        let [products, squares] = [0, 1].map(|i: usize| gaussian(&sums[i][k], sigma));
        let slope = |(p, s): (&f32, &f32)| (p / (s + NOISE * frames as f32)).clamp(0.0, LONGEST);
        let data = products.data.iter().zip(&squares.data).map(slope).collect();
        Plane::from_vec(products.width, products.height, data)
    };
    Ok(Memory(par::map(BANDS, slope)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::observe::Silent;
    use crate::base::rng::{hash, unit};
    use crate::flow::field::Field;
    use crate::render::transport::Inflow;

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
        let transport = Transport::along(&flow, Inflow::Border);
        let residuals = Residuals::of(FRAMES, |t| d[t].clone(), &transport, "residuals", &Silent).unwrap();
        (d, transport, residuals)
    }

    #[test]
    fn memory_is_the_share_that_goes_on() {
        for rho in [0.3, 0.8] {
            let (_, _, residuals) = taken_apart(rho);
            for band in 0..3 {
                let found = residuals.memory.0[band].at(32 >> band, 24 >> band);
                assert!((found - rho).abs() < 0.12, "{found} of {rho} in band {band}");
            }
        }
    }

    #[test]
    fn residuals_carried_along_the_flow_are_the_clip_again_and_close_the_loop() {
        let (d, transport, residuals) = taken_apart(0.8);
        let mut now = Plane::zeros(SIZE.0, SIZE.1);
        let run_in = residuals.memory.length().next_multiple_of(FRAMES);
        for t in 0..run_in + FRAMES {
            let (before, new) = (transport.apply(&now), residuals.at(t));
            now = residuals.memory.of(&before);
            now.data.iter_mut().zip(&new.data).for_each(|(d, r)| *d += r);
            if t >= run_in {
                let worst = now.data.iter().zip(&d[t % FRAMES].data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(worst < 5e-3, "frame {t}: {worst}");
            }
        }
    }

    #[test]
    fn still_water_has_neither_memory_nor_residuals() {
        let transport = Transport::along(&Field::zeros(SIZE.0, SIZE.1), Inflow::Border);
        let still = |_| Plane::zeros(SIZE.0, SIZE.1);
        let residuals = Residuals::of(5, still, &transport, "residuals", &Silent).unwrap();
        assert!(residuals.memory.0.iter().all(|band| band.data.iter().all(|&v| v == 0.0)));
        assert!(residuals.memory.length() == 1 && residuals.count() == 5);
        assert!((0..7).all(|t| residuals.at(t).data.iter().all(|&v| v == 0.0)));
    }
}
