//! What does not move: rock, boulders and leaves.

use enliven::base::{par, rng};
use enliven::raster::filter;
use enliven::raster::image::Plane;

use super::canvas::{Canvas, Light, SS, add, blend, dim};
use super::noise::{cell, cellular, fbm2, noise2, ridged2};
use super::numeric::{cos, mix, pow, sin, step};

/// Colours of a rock.
#[derive(Clone, Copy)]
pub struct Stone {
    /// Where it is bare and bright.
    pub pale: Light,
    /// In its veins and shaded parts.
    pub dark: Light,
    /// What grows on its upper sides.
    pub moss: Light,
    /// How much grows there, 0 to 1.
    pub mossy: f32,
}

/// Grey limestone with moss.
pub const LIMESTONE: Stone =
    Stone { pale: [0.34, 0.31, 0.26], dark: [0.10, 0.085, 0.07], moss: [0.085, 0.14, 0.02], mossy: 0.75 };

/// Summer leaves.
pub const GREEN: [Light; 2] = [[0.10, 0.25, 0.02], [0.30, 0.36, 0.05]];

/// Height in pixels of broken rock at (x, y), with blocks of about `block` pixels.
pub fn broken(seed: u32, x: f32, y: f32, block: f32) -> f32 {
    let warp = |s: u32, x: f32, y: f32| 0.55 * block * fbm2(seed ^ s, x / (1.4 * block), y / (1.4 * block), 4);
    let wx = x + warp(11, x, y);
    let wy = y + warp(12, x, y) + 0.25 * wx;
    let facets = |seed: u32, size: f32| {
        let near = cellular(seed, wx / (1.35 * size), wy / (0.6 * size));
        let tilt = |s: u32| 2.0 * cell(seed ^ s, near.id.0, near.id.1) - 1.0;
        let ease = step(0.0, 0.22, near.second - near.first);
        size * ease * (0.42 * near.offset.0 * tilt(1) + 0.30 * near.offset.1 * (tilt(2) - 0.5) + 0.34 * tilt(3))
    };
    let crack = step(0.86, 0.99, ridged2(seed ^ 5, wx / (1.9 * block), wy / (0.8 * block), 2));
    block * 0.55 * fbm2(seed ^ 7, x / (2.2 * block), y / (1.6 * block), 4)
        + facets(seed, 1.25 * block)
        + 0.8 * facets(seed ^ 77, 0.5 * block)
        + 0.7 * facets(seed ^ 78, 0.22 * block)
        + block * (0.16 * fbm2(seed ^ 8, wx / (0.5 * block), wy / (0.2 * block), 4) - 0.10 * crack)
        + 0.55 * fbm2(seed ^ 6, x / 3.0, y / 2.4, 3)
}

/// Height of a rounded boulder above its rim; negative outside. Centre and half axes in pixels.
pub fn boulder(seed: u32, centre: (f32, f32), half: (f32, f32), x: f32, y: f32) -> f32 {
    let (u, v) = ((x - centre.0) / half.0, (y - centre.1) / half.1);
    let warp = 0.22 * fbm2(seed ^ 1, 1.7 * u, 1.7 * v + 3.0, 3);
    let corner = (u + warp).abs().max((0.9 * v + 0.35 * u).abs()).max((0.8 * v - 0.55 * u - warp).abs());
    let r = mix(u * u + v * v, corner * corner, 0.55) + 0.40 * fbm2(seed, 1.3 * u + 7.0, 1.3 * v, 4);
    if r >= 1.0 { -1.0 } else { half.1 * (1.0 - r).sqrt() }
}

/// A rock surface: height and wetness (0 to 1) for each sample, in the order of a canvas.
pub struct Relief {
    /// Height towards the viewer, pixels.
    pub height: Plane,
    /// 1 where water darkens the stone.
    pub wet: Plane,
    /// Number that chooses the colours.
    pub seed: u32,
}

impl Relief {
    /// From functions of the position in final pixels.
    pub fn new(
        width: usize,
        height: usize,
        seed: u32,
        rise: impl Fn(f32, f32) -> f32 + Sync + Send,
        wet: impl Fn(f32, f32) -> f32 + Sync + Send,
    ) -> Self {
        let plane = |f: &(dyn Fn(f32, f32) -> f32 + Sync)| {
            let mut plane = Plane::zeros(width * SS, height * SS);
            par::for_each_chunk(&mut plane.data, width * SS, |row, values| {
                let y = (row as f32 + 0.5) / SS as f32;
                for (column, value) in values.iter_mut().enumerate() {
                    *value = f((column as f32 + 0.5) / SS as f32, y);
                }
            });
            plane
        };
        Self { height: plane(&rise), wet: plane(&wet), seed }
    }

    /// Lit from the upper left by a bright sky, darkened in its hollows.
    pub fn shade(&self, stone: Stone) -> Canvas {
        let (w, h) = (self.height.width, self.height.height);
        let near = blur(&self.height, 3.0 * SS as f32);
        let far = blur(&self.height, 11.0 * SS as f32);
        let mut canvas = Canvas { width: w, height: h, data: vec![[0.0; 3]; w * h] };
        par::for_each_chunk(&mut canvas.data, w, |row, samples| {
            for (column, sample) in samples.iter_mut().enumerate() {
                let at = |dx: isize, dy: isize| self.height.clamped(column as isize + dx, row as isize + dy);
                let slope = 0.5 * SS as f32;
                let (nx, ny) = (-slope * (at(1, 0) - at(-1, 0)), -slope * (at(0, 1) - at(0, -1)));
                let norm = 1.0 / (nx * nx + ny * ny + 1.0).sqrt();
                let i = row * w + column;
                let hollow = (self.height.data[i] - near.data[i]) / 5.0 + (self.height.data[i] - far.data[i]) / 14.0;
                let sky = step(-1.3, 0.9, hollow);
                let sun = ((-0.55 * nx - 0.62 * ny + 0.55) * norm).max(0.0);
                let half = ((-0.3 * nx - 0.45 * ny + 0.85) * norm).max(0.0);
                let (x, y) = (column as f32 / SS as f32, row as f32 / SS as f32);
                let up = step(0.05, 0.75, -ny * norm);
                let wet = self.wet.data[i];
                let albedo = dim(self.albedo(stone, x, y, up), mix(1.0, 0.33, wet));
                let light =
                    add(dim([0.62, 0.74, 0.9], 0.55 * sky), dim([1.15, 1.05, 0.9], 1.25 * sun * mix(0.35, 1.0, sky)));
                let gloss = wet * 0.35 * pow(half, 24.0) * sky;
                *sample = add(
                    [albedo[0] * light[0], albedo[1] * light[1], albedo[2] * light[2]],
                    [0.8 * gloss, 0.9 * gloss, gloss],
                );
            }
        });
        canvas
    }

    fn albedo(&self, stone: Stone, x: f32, y: f32, up: f32) -> Light {
        let s = self.seed;
        let broad = fbm2(s ^ 21, x / 40.0, y / 34.0, 4);
        let grain = 0.5 * noise2(s ^ 22, x / 1.3, y / 1.3) + 0.5 * fbm2(s ^ 23, x / 5.0, y / 3.5, 3);
        let bare = blend(stone.dark, stone.pale, (0.62 + 0.55 * broad + 0.35 * grain).clamp(0.0, 1.15));
        let growth = up * step(-0.1, 0.45, fbm2(s ^ 24, x / 22.0, y / 16.0, 4) + 0.25 * grain + stone.mossy - 0.6);
        blend(bare, dim(stone.moss, 1.0 + 0.7 * grain), growth * stone.mossy.min(1.0))
    }
}

fn blur(plane: &Plane, sigma: f32) -> Plane {
    filter::gaussian(plane, sigma)
}

/// A mass of leaves: `count` leaves where `density(x, y)` allows, the back ones dark, the front ones lit.
pub fn leaves(
    canvas: &mut Canvas,
    seed: u64,
    count: usize,
    size: f32,
    colours: [Light; 2],
    density: impl Fn(f32, f32) -> f32,
) {
    let (w, h) = (canvas.width as f32 / SS as f32, canvas.height as f32 / SS as f32);
    let width = canvas.width;
    for (i, sample) in canvas.data.iter_mut().enumerate() {
        let (x, y) = ((i % width) as f32 / SS as f32, (i / width) as f32 / SS as f32);
        let under = step(0.25, 0.7, density(x, y) + 0.25 * noise2(seed as u32 ^ 9, x / 8.0, y / 8.0));
        *sample = blend(*sample, [0.010, 0.016, 0.006], 0.93 * under);
    }
    for i in 0..count {
        let r = |k: u64| rng::unit(rng::hash(seed, &[i as u64, k]));
        let (x, y) = (r(0) * w, r(1) * h);
        let clump = 0.32
            + 0.9 * noise2(seed as u32, x / (13.0 * size), y / (9.0 * size))
            + 0.6 * noise2(seed as u32 ^ 3, x / (4.5 * size), y / (3.5 * size));
        if r(2) >= density(x, y) * (0.65 + 0.7 * clump) {
            continue;
        }
        let depth = i as f32 / count as f32;
        let lit = depth * depth * (0.10 + 1.25 * clump.max(0.0)) * (0.35 + 0.9 * r(3));
        let angle = std::f32::consts::TAU * r(4);
        let colour = blend([0.006, 0.014, 0.004], blend(colours[0], colours[1], r(5)), (0.06 + 0.95 * lit).min(1.2));
        let length = size * (0.6 + 0.8 * r(6));
        canvas.ellipse((x, y), (length, length * (0.3 + 0.25 * r(7))), (cos(angle), sin(angle)), 0.95, |u, v| {
            dim(colour, 0.8 + 0.25 * u - 0.35 * v.abs())
        });
    }
}

/// Arching blades of grass or fern around `root`, each `length` pixels or less.
pub fn tuft(canvas: &mut Canvas, seed: u64, root: (f32, f32), length: f32, blades: usize) {
    for i in 0..blades {
        let r = |k: u64| rng::unit(rng::hash(seed, &[i as u64, k]));
        let lean = 2.2 * (r(0) - 0.5);
        let reach = length * (0.5 + 0.5 * r(1));
        let colour = blend([0.02, 0.05, 0.008], [0.20, 0.34, 0.05], (0.2 + 0.8 * i as f32 / blades as f32) * r(2));
        let base = root.0 + 0.5 * length * (r(3) - 0.5);
        for k in 0..14 {
            let s = k as f32 / 13.0;
            let x = base + lean * reach * s * s;
            let y = root.1 - reach * (s - 0.55 * lean.abs() * s * s);
            canvas.ellipse(
                (x, y),
                (0.08 * reach + 0.3, mix(1.1, 0.35, s)),
                (lean * s, -1.0 + 0.8 * lean.abs() * s),
                0.9,
                |_, v| dim(colour, 1.0 - 0.4 * v),
            );
        }
    }
}
