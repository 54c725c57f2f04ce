//! How a carried picture sways about its way: the fluctuation of the clips' motion, integrated elastically over a loop.
//!
//! Fluid does not only go along; it curls, surges and falls back. What a place is displaced by follows the fluctuation V′
//! of the motion there and forgets it again: `D_t(x) = ρ D_{t−1}(x − V′_t(x)) + V′_t(x)`, with ρ below 1, so that
//! excursions stay bounded however long the loop is (free advection smears a picture within a second). The fluctuation
//! repeats with the loop, and so does D once its start is forgotten.

use crate::base::par;
use crate::flow::field::Field;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;

/// Displacement that a start may leave behind, pixels: where the loop closes it cannot be seen.
const CLOSED: f32 = 0.05;
/// Largest displacement that can be stored, pixels.
const FARTHEST: f32 = 120.0;
/// Steps per pixel of what is stored.
const STEPS: f32 = 256.0;
/// Strain (how far neighbouring places are pulled apart or pushed together, as a share of their distance) from which
/// displacements are scaled down: a picture that is strained by more than 1 folds. It softens and does not bound: what is
/// flung apart ten times as strongly keeps about 2.
const STRAIN: f32 = 0.5;
/// Window over which strain is averaged, cells.
const WINDOW: f32 = 3.0;

/// Displacements of every frame of a loop, on cells, pixels of the working image.
#[derive(Debug, Clone, PartialEq)]
pub struct Sway {
    size: (usize, usize),
    /// Per frame and cell: to the right and down, in [`STEPS`].
    frames: Vec<Vec<[i16; 2]>>,
}

impl Sway {
    /// Integrates the fluctuation of a loop of `frames` frames. `fluctuation(t)` is the motion from frame t − 1 to frame t
    /// less its mean over the loop, pixels of the working image, on cells of `cell` pixels; `memory` is how many frames it
    /// takes until a displacement has shrunk to 1/e.
    pub fn integrate(frames: usize, memory: f32, cell: f32, fluctuation: impl Fn(usize) -> Field + Sync) -> Self {
        let fields = par::map(frames, &fluctuation);
        let size = (fields[0].width(), fields[0].height());
        let keep = (-1.0 / memory).exp();
        let largest = fields.iter().flat_map(|f| f.u.data.iter().chain(&f.v.data)).fold(0.0f32, |m, v| m.max(v.abs()));
        // A displacement is at most largest / (1 − ρ); of that ρⁿ is left after n frames.
        let start = (largest / (1.0 - keep)).max(CLOSED);
        let run_in = ((CLOSED / start).ln() / keep.ln()).ceil().max(0.0) as usize;
        let mut now = Field::zeros(size.0, size.1);
        let mut out = vec![Vec::new(); frames];
        // The run-in ends with the last frame of a round.
        let run_in = run_in.next_multiple_of(frames);
        for t in 0..run_in + frames {
            now = step(&now, &fields[t % frames], keep, cell);
            if t >= run_in {
                out[t - run_in] = stored(&softened(&now, cell));
            }
        }
        Self { size, frames: out }
    }

    /// Bytes that the displacements of a loop take on a working image of `size` pixels.
    pub fn bytes(frames: usize, (width, height): (usize, usize), cell: usize) -> u64 {
        frames as u64 * (width.div_ceil(cell) * height.div_ceil(cell) * size_of::<[i16; 2]>()) as u64
    }

    /// Width and height in cells.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }

    /// Frames of the loop.
    pub fn frames(&self) -> usize {
        self.frames.len()
    }

    /// Displacement of a cell, by its index, in frame `t`: what is there has come from so far away, pixels.
    pub fn at(&self, t: usize, cell: usize) -> (f32, f32) {
        let [u, v] = self.frames[t][cell];
        (f32::from(u) / STEPS, f32::from(v) / STEPS)
    }
}

fn step(now: &Field, change: &Field, keep: f32, cell: f32) -> Field {
    let (width, height) = (now.width(), now.height());
    let from = |plane: &Plane, add: &Plane| {
        let value = |x: usize, y: usize| {
            let (px, py) = (x as f32 + 0.5 - change.u.at(x, y) / cell, y as f32 + 0.5 - change.v.at(x, y) / cell);
            keep * plane.bilinear(px, py) + add.at(x, y)
        };
        Plane::from_fn(width, height, value)
    };
    Field { u: from(&now.u, &change.u), v: from(&now.v, &change.v) }
}

/// Displacements scaled down where their strain, root mean square over the window, is not small beside [`STRAIN`].
fn softened(sway: &Field, cell: f32) -> Field {
    let strain = |x: usize, y: usize| {
        let (left, right) = (x.saturating_sub(1), (x + 1).min(sway.width() - 1));
        let (up, down) = (y.saturating_sub(1), (y + 1).min(sway.height() - 1));
        let slope = |p: &Plane| {
            let across = (p.at(right, y) - p.at(left, y)) / (right - left).max(1) as f32;
            across.powi(2) + ((p.at(x, down) - p.at(x, up)) / (down - up).max(1) as f32).powi(2)
        };
        (slope(&sway.u) + slope(&sway.v)) / (cell * cell)
    };
    let strain = gaussian(&Plane::from_fn(sway.width(), sway.height(), strain), WINDOW);
    let scale = strain.map(|s| 1.0 / (1.0 + s / (STRAIN * STRAIN)).sqrt());
    let scaled =
        |p: &Plane| Plane::from_vec(p.width, p.height, p.data.iter().zip(&scale.data).map(|(v, s)| v * s).collect());
    Field { u: scaled(&sway.u), v: scaled(&sway.v) }
}

fn stored(sway: &Field) -> Vec<[i16; 2]> {
    let step = |v: f32| (v.clamp(-FARTHEST, FARTHEST) * STEPS).round() as i16;
    sway.u.data.iter().zip(&sway.v.data).map(|(u, v)| [step(*u), step(*v)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::TAU;

    const CELL: f32 = 4.0;

    fn uniform(u: f32, v: f32) -> Field {
        Field { u: Plane::filled(20, 15, u), v: Plane::filled(20, 15, v) }
    }

    #[test]
    fn a_swing_is_followed_and_the_loop_closes() {
        let frames = 40;
        let wave = |t: usize| 1.5 * (TAU * t as f32 / frames as f32).sin();
        let sway = Sway::integrate(frames, 12.0, CELL, |t| uniform(wave(t), 0.0));
        // The same, number by number, from any start long ago.
        let keep = (-1.0f32 / 12.0).exp();
        let mut now = 0.0;
        for t in 0..6 * frames {
            now = keep * now + wave(t % frames);
        }
        for t in 0..frames {
            now = keep * now + wave(t);
            let (u, v) = sway.at(t, 77);
            assert!((u - now).abs() < CLOSED && v == 0.0, "frame {t}: {u} {now}");
        }
        let (last, first) = (sway.at(frames - 1, 77).0, sway.at(0, 77).0);
        assert!((keep * last + wave(0) - first).abs() < CLOSED);
    }

    #[test]
    fn what_does_not_fluctuate_does_not_sway() {
        let sway = Sway::integrate(12, 12.0, CELL, |_| uniform(0.0, 0.0));
        assert!((0..12).all(|t| (0..300).all(|cell| sway.at(t, cell) == (0.0, 0.0))));
    }

    /// The largest difference between cells beside each other in a row, as a share of their distance.
    fn strain(u: &Plane) -> f32 {
        let row = |y: usize| u.row(y).windows(2).map(|pair| (pair[1] - pair[0]).abs() / CELL).fold(0.0, f32::max);
        (0..u.height).map(row).fold(0.0, f32::max)
    }

    /// Strain of a loop in which columns are flung this way and that: as it would be, and as it is stored.
    fn strains(fling: impl Fn(usize) -> f32 + Sync) -> [f32; 2] {
        let swing = |t: usize| (TAU * t as f32 / 16.0).cos();
        let field = |t: usize| Field { u: Plane::from_fn(20, 15, |x, _| fling(x) * swing(t)), v: Plane::zeros(20, 15) };
        let (mut now, mut free) = (Field::zeros(20, 15), 0.0f32);
        for t in 0..96 {
            now = step(&now, &field(t % 16), (-1.0f32 / 12.0).exp(), CELL);
            free = if t < 80 { 0.0 } else { free.max(strain(&now.u)) };
        }
        let sway = Sway::integrate(16, 12.0, CELL, field);
        let shown = |t: usize| strain(&Plane::from_vec(20, 15, (0..300).map(|cell| sway.at(t, cell).0).collect()));
        [free, (0..16).map(shown).fold(0.0, f32::max)]
    }

    #[test]
    fn strong_strain_is_softened_and_gentle_strain_left() {
        // Pulled apart evenly, and two halves flung apart.
        for [free, shown] in [strains(|x| 2.0 * (x as f32 - 9.5)), strains(|x| if x < 10 { -9.0 } else { 9.0 })] {
            assert!(free > 3.0 && shown < 0.5 * free, "{free} {shown}");
        }
        let [free, shown] = strains(|x| 0.1 * (x as f32 - 9.5));
        assert!(free < 0.2 && shown > 0.9 * free, "{free} {shown}");
    }
}
