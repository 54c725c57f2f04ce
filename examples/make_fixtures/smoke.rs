//! A rising plume of smoke, lit from the upper left and shadowing itself.

use enliven::base::par;

use super::canvas::{Canvas, add, blend, dim, tint};
use super::fluid::Gas;
use super::land::{LIMESTONE, Relief, broken};
use super::noise::{fbm2, noise2, noise3};
use super::numeric::{exp, mix, step};

/// A plume; lengths in pixels, times in frames.
pub struct Plume {
    /// Width of the picture.
    pub width: usize,
    /// Height of the picture.
    pub height: usize,
    /// Changes every random detail.
    pub seed: u32,
    /// Where it leaves the ground, across.
    pub source: f32,
    /// Half the width of the source.
    pub half: f32,
}

/// Cells per pixel.
const CELLS: f32 = 1.0;
/// Steps a frame.
const STEPS: usize = 2;
/// Pixels simulated below the picture.
const CELLAR: f32 = 26.0;
/// Sheets, one behind another.
const SHEETS: usize = 3;

/// The smoke at one moment.
pub struct Smoking<'a> {
    plume: &'a Plume,
    sheets: Vec<Gas>,
    time: f32,
}

impl<'a> Smoking<'a> {
    /// Starts the source and lets it smoke for `frames` frames.
    pub fn started(plume: &'a Plume, frames: usize) -> Self {
        let size = |pixels: f32| (pixels * CELLS) as usize;
        let (w, h) = (size(plume.width as f32), size(plume.height as f32 + CELLAR));
        let mut smoking = Self { plume, sheets: (0..SHEETS).map(|_| Gas::still(w, h)).collect(), time: 0.0 };
        for _ in 0..frames {
            smoking.advance();
        }
        smoking
    }

    /// One frame on.
    pub fn advance(&mut self) {
        let (plume, time) = (self.plume, self.time);
        par::for_each_chunk(&mut self.sheets, 1, |n, sheet| {
            for step in 0..STEPS {
                puff(plume, &mut sheet[0], n as u32, time + step as f32 / STEPS as f32, 1.0 / STEPS as f32);
            }
        });
        self.time += 1.0;
    }

    /// Draws the smoke over `canvas`.
    pub fn draw(&self, canvas: &mut Canvas) {
        let sheets: Vec<(&Gas, Vec<f32>)> = self.sheets.iter().map(|gas| (gas, sunlight(gas))).collect();
        canvas.paint(|x, y, old| {
            let mut light = old;
            let (cx, cy) = (x * CELLS - 0.5, y * CELLS - 0.5);
            for (gas, sun) in &sheets {
                let thick = gas.sample(&gas.soot, cx, cy).max(0.0);
                let cover = 1.0 - exp(-1.5 * thick);
                let lit = gas.sample(sun, cx, cy);
                let ahead = gas.sample(&gas.soot, cx - 2.0, cy - 2.6);
                let relief = (0.5 + 1.6 * (thick - ahead)).clamp(0.0, 1.2);
                let colour = add(dim([0.10, 0.115, 0.14], 0.8), dim([0.88, 0.84, 0.78], lit * (0.30 + 0.62 * relief)));
                light = blend(light, colour, cover * 0.9);
            }
            light
        });
    }
}

/// Share of the light from the upper left that reaches each cell.
fn sunlight(gas: &Gas) -> Vec<f32> {
    let (w, h) = (gas.width, gas.height);
    let mut sun = vec![1.0; w * h];
    for y in 1..h {
        for x in 0..w {
            let i = y * w + x;
            let through = if x == 0 { 1.0 } else { mix(sun[i - w], sun[i - w - 1], 0.7) };
            let ambient = 0.004 * (1.0 - through);
            sun[i] = through * exp(-0.105 / CELLS * gas.soot[i].max(0.0)) + ambient;
        }
    }
    sun
}

fn puff(plume: &Plume, gas: &mut Gas, sheet: u32, time: f32, dt: f32) {
    let seed = plume.seed ^ (sheet * 0x9e37);
    let bottom = plume.height as f32 + CELLAR;
    for row in 0..gas.height {
        let y = row as f32 / CELLS;
        for column in 0..gas.width {
            let x = column as f32 / CELLS;
            let i = row * gas.width + column;
            if y > bottom - 16.0 {
                let across = (x - plume.source - 5.0 * noise2(seed, 0.5, time / 30.0)) / plume.half;
                let rough = fbm2(seed ^ 1, x / 9.0, time / 8.0, 3) + 0.35 * noise2(seed ^ 2, 0.5, time / 13.0);
                let rate = step(1.0, 0.55, across.abs() - 0.5 * rough) * (0.5 * dt).min(1.0);
                gas.heat[i] = mix(gas.heat[i], 1.0, rate);
                gas.soot[i] = mix(gas.soot[i], 1.1 + 1.1 * rough, rate).max(0.0);
                gas.v[i] = mix(gas.v[i], -1.8 * CELLS, rate);
            }
            if gas.soot[i] > 0.02 {
                let (size, drift) = (13.0, y + 1.6 * time);
                gas.u[i] += dt * 0.10 * CELLS * noise3(seed ^ 3, x / size, drift / size, time / 25.0);
                gas.v[i] += dt * 0.10 * CELLS * noise3(seed ^ 4, x / size, drift / size, time / 25.0);
            }
        }
    }
    gas.rise(0.075 * CELLS, 0.0, dt);
    gas.confine(0.10, dt);
    gas.project(24);
    gas.advect(1.5 * CELLS, dt);
    for (heat, soot) in gas.heat.iter_mut().zip(&mut gas.soot) {
        *heat *= 1.0 - 0.011 * dt;
        *soot *= 1.0 - 0.0065 * dt;
    }
    for (i, velocity) in gas.u.iter_mut().enumerate() {
        let aloft = 1.0 - (i / gas.width) as f32 / gas.height as f32;
        *velocity += dt * (0.020 * CELLS * aloft - 0.010 * *velocity);
    }
    for velocity in &mut gas.v {
        *velocity *= 1.0 - 0.012 * dt;
    }
}

/// The rock face behind the plume, at dusk: something that stands still, so that motion estimators and camera checks
/// have what to hold on to.
pub fn rock_face(plume: &Plume) -> Canvas {
    let rise = |x: f32, y: f32| broken(plume.seed ^ 0x66, x, y, 26.0);
    let mut canvas = Relief::new(plume.width, plume.height, plume.seed, rise, |_, _| 0.0).shade(LIMESTONE);
    canvas.paint(|_, y, rock| {
        let down = y / plume.height as f32;
        blend(tint(rock, [0.10, 0.13, 0.18]), tint(rock, [0.17, 0.17, 0.18]), down)
    });
    canvas
}

/// The clip of the library.
pub fn clip_scene() -> Plume {
    Plume { width: 256, height: 288, seed: 3, source: 112.0, half: 20.0 }
}
