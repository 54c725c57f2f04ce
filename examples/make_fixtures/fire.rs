//! Flames: several sheets of burning gas one behind another, coloured by what is left to burn, and sparks.

use enliven::base::{par, rng};

use super::canvas::{Canvas, Light, add, dim};
use super::fluid::Gas;
use super::noise::{fbm2, noise2, noise3};
use super::numeric::{exp, mix, sin, step};

/// Where and how it burns; lengths in pixels, times in frames.
pub struct Fire {
    /// Width of the picture.
    pub width: usize,
    /// Height of the picture.
    pub height: usize,
    /// Pixels of the picture per pixel of the lengths below: 2 makes a picture twice as large of the same fire.
    pub scale: f32,
    /// Changes every random detail.
    pub seed: u32,
    /// Left and right end of the bed of the fire.
    pub bed: (f32, f32),
    /// Height of the bed.
    pub ground: f32,
    /// Height the flames reach, about.
    pub reach: f32,
    /// Sheets, one behind another.
    pub sheets: usize,
}

/// Cells per pixel.
const CELLS: f32 = 1.25;
/// Steps a frame.
const STEPS: usize = 3;

/// The burning gas at one moment: brightness of the flames for every sheet.
pub struct Burning<'a> {
    fire: &'a Fire,
    sheets: Vec<Gas>,
    time: f32,
}

impl<'a> Burning<'a> {
    /// Lights the fire and lets it burn for `frames` frames.
    pub fn lit(fire: &'a Fire, frames: usize) -> Self {
        let (w, h) =
            ((fire.width as f32 / fire.scale * CELLS) as usize, (fire.height as f32 / fire.scale * CELLS) as usize);
        let mut burning = Self { fire, sheets: (0..fire.sheets).map(|_| Gas::still(w, h)).collect(), time: 0.0 };
        for _ in 0..frames {
            burning.advance();
        }
        burning
    }

    /// One frame on.
    pub fn advance(&mut self) {
        let (fire, time) = (self.fire, self.time);
        par::for_each_chunk(&mut self.sheets, 1, |n, sheet| {
            for step in 0..STEPS {
                burn(fire, &mut sheet[0], n as u32, time + step as f32 / STEPS as f32, 1.0 / STEPS as f32);
            }
        });
        self.time += 1.0;
    }

    /// Light of all sheets at (x, y) in pixels.
    pub fn glow(&self, x: f32, y: f32) -> Light {
        let mut light = [0.0; 3];
        for sheet in &self.sheets {
            let heat = sheet.sample(&sheet.heat, x * CELLS - 0.5, y * CELLS - 0.5);
            let fuel = sheet.sample(&sheet.soot, x * CELLS - 0.5, y * CELLS - 0.5);
            light = add(light, flame(heat, fuel));
        }
        light
    }

    /// Draws the flames and sparks over `canvas`.
    pub fn draw(&self, canvas: &mut Canvas) {
        canvas.paint(|x, y, old| add(old, self.glow(x / self.fire.scale, y / self.fire.scale)));
        self.sparks(canvas);
    }

    fn sparks(&self, canvas: &mut Canvas) {
        let fire = self.fire;
        for i in 0..26u64 {
            let life = 24.0 + 30.0 * rng::unit(rng::hash(u64::from(fire.seed), &[i, 0]));
            let offset = rng::unit(rng::hash(u64::from(fire.seed), &[i, 1])) * life * 2.5;
            let cycle = ((self.time + offset) / (2.5 * life)).floor();
            let age = self.time + offset - cycle * 2.5 * life;
            let r = |n: u64| rng::unit(rng::hash(u64::from(fire.seed), &[i, n, cycle as u64]));
            if age > life {
                continue;
            }
            let at = |a: f32| {
                let x = mix(fire.bed.0, fire.bed.1, 0.15 + 0.7 * r(2)) + 9.0 * sin(0.16 * a + 6.0 * r(3)) * (a / life);
                (x + 16.0 * (r(4) - 0.5) * a / life, fire.ground - fire.reach * 0.1 - a * (2.0 + 2.2 * r(5)))
            };
            let bright = 2.2 * (1.0 - age / life);
            let k = fire.scale;
            let (tail, head) = (at(age - 0.7), at(age));
            canvas.streak(
                (k * tail.0, k * tail.1),
                (k * head.0, k * head.1),
                0.55 * k,
                0.9,
                dim([1.0, 0.45, 0.10], bright),
            );
        }
    }
}

fn burn(fire: &Fire, gas: &mut Gas, sheet: u32, time: f32, dt: f32) {
    feed(fire, gas, sheet, time, dt);
    let lift = 0.13 * CELLS * fire.reach / 150.0;
    gas.rise(lift, 0.0, dt);
    stir(fire, gas, sheet, time, dt);
    gas.confine(0.05, dt);
    gas.project(30);
    gas.advect(2.4 * CELLS, dt);
    let cooling = 3.4 / fire.reach.max(1.0);
    for heat in &mut gas.heat {
        *heat = (*heat * (1.0 - 0.5 * cooling * dt) - cooling * dt * (0.35 + 0.9 * *heat * *heat)).max(0.0);
    }
    for fuel in &mut gas.soot {
        *fuel = (*fuel - 2.6 * cooling * dt * (0.25 + *fuel)).max(0.0);
    }
    for velocity in gas.u.iter_mut().chain(&mut gas.v) {
        *velocity *= 1.0 - 0.035 * dt;
    }
}

/// Burning gas leaves the bed in uneven, wandering tongues.
fn feed(fire: &Fire, gas: &mut Gas, sheet: u32, time: f32, dt: f32) {
    let seed = fire.seed ^ (sheet * 0x9e37);
    let span = fire.bed.1 - fire.bed.0;
    for row in 0..gas.height {
        let level = (row as f32 + 0.5) / CELLS;
        if level < fire.ground - 20.0 || level > fire.ground + 5.0 {
            continue;
        }
        for column in 0..gas.width {
            let x = (column as f32 + 0.5) / CELLS;
            let y = level + 4.0 * noise2(fire.seed ^ 3, x / 13.0, 0.5);
            let place = (x - fire.bed.0) / span;
            let middle = (4.0 * place * (1.0 - place)).max(0.0);
            let tongue = fbm2(seed, x / 27.0, time / 30.0, 2) + 0.45 * noise2(seed ^ 1, x / 10.0, time / 9.0);
            let pulse = 0.25 * noise2(seed ^ 2, 0.3, time / 11.0);
            let high = 10.0 * middle.sqrt() * (0.35 + tongue);
            let here = step(0.0, 0.25, -0.06 + tongue + pulse + 0.35 * (middle - 0.6)) * step(0.0, 0.2, middle);
            let feed = here
                * step(fire.ground - high - 5.0, fire.ground - high + 2.0, y)
                * step(fire.ground + 2.0, fire.ground, y);
            let i = row * gas.width + column;
            let rate = (0.9 * dt).min(1.0) * feed;
            gas.heat[i] = mix(gas.heat[i], 1.0, rate);
            gas.soot[i] = mix(gas.soot[i], 1.0, rate);
            gas.v[i] = mix(gas.v[i], -0.8 * CELLS, 0.5 * rate);
        }
    }
}

/// Small draughts that tear the flames.
fn stir(fire: &Fire, gas: &mut Gas, sheet: u32, time: f32, dt: f32) {
    let seed = fire.seed ^ (sheet * 0x51ed) ^ 0xbeef;
    let (w, size) = (gas.width, fire.reach / 7.0);
    for row in 0..gas.height {
        let y = row as f32 / CELLS;
        for column in 0..w {
            let i = row * w + column;
            if gas.heat[i] < 0.02 {
                continue;
            }
            let x = column as f32 / CELLS;
            let drift = (y + 2.2 * time) / size;
            gas.u[i] += dt * 0.20 * CELLS * noise3(seed, x / size, drift, time / 22.0);
            gas.v[i] += dt * 0.14 * CELLS * noise3(seed ^ 7, x / size, drift, time / 22.0);
        }
    }
}

/// Colour of a sheet of flame: thin red rims, orange bodies, yellow-white where much burns.
fn flame(heat: f32, fuel: f32) -> Light {
    let body = step(0.10, 0.42, heat);
    let core = step(0.25, 0.95, heat) * (0.55 + 0.45 * fuel);
    let power = body * (0.10 + 0.95 * core * core + 0.35 * core);
    [1.05 * power + 0.10 * body, 0.36 * power * mix(0.55, 1.35, core), 0.045 * power * mix(0.3, 3.2, core * core)]
}

/// A dark clearing lit by embers: the ground under the fire of the library's clip.
pub fn hearth(fire: &Fire) -> Canvas {
    let mut canvas = Canvas::black(fire.width, fire.height);
    let centre = 0.5 * (fire.bed.0 + fire.bed.1);
    let half = 0.5 * (fire.bed.1 - fire.bed.0);
    canvas.paint(|x, y, _| {
        let below = y - fire.ground - 3.0 * fbm2(fire.seed ^ 9, x / 20.0, 0.0, 3);
        let soil = 0.5 + 0.5 * fbm2(fire.seed ^ 8, x / 6.0, y / 2.2, 4);
        let d2 = ((x - centre) / (1.5 * half)).powi(2) + ((y - fire.ground) / (0.8 * half)).powi(2);
        let lit = if below > 0.0 { 0.16 * soil * soil * exp(-1.6 * d2) } else { 0.0 };
        let coal = step(0.1, 0.5, fbm2(fire.seed ^ 5, x / 5.0, y / 3.0, 3))
            * step(1.0, 0.6, d2 * 3.2)
            * step(-2.0, 3.0, below);
        add([0.0022, 0.002, 0.0026], add(dim([1.0, 0.42, 0.14], lit), dim([1.0, 0.16, 0.02], 0.55 * coal)))
    });
    canvas
}

/// The clip of the library.
pub fn clip_scene() -> Fire {
    Fire { width: 320, height: 240, scale: 1.0, seed: 5, bed: (66.0, 254.0), ground: 222.0, reach: 150.0, sheets: 3 }
}
