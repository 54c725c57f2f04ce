//! A brook that runs to the right over a stony bed, seen from its bank: waves and foam carried by a potential flow
//! round the stones.

use enliven::base::par;
use enliven::raster::image::{Plane, Rgb8};

use super::canvas::{Canvas, Light, SS, add, blend, dim};
use super::land::{GREEN, LIMESTONE, Relief, boulder, broken, leaves, tuft};
use super::noise::{fbm2, noise2, noise3, ridged2};
use super::numeric::{exp, mix, pow, sin, step};

/// A composition; lengths in pixels, times in frames.
pub struct River {
    /// Width of the picture.
    pub width: usize,
    /// Height of the picture.
    pub height: usize,
    /// Changes every random detail.
    pub seed: u32,
    /// Far bank.
    pub bank: f32,
    /// Stones: centre and half axes.
    pub stones: Vec<(f32, f32, f32, f32)>,
}

/// Frames a patch of texture lives.
const LIFE: usize = 36;

/// Everything that stays the same from frame to frame.
pub struct RiverRenderer<'a> {
    scene: &'a River,
    land: Canvas,
    dry: Plane,
    bed: Canvas,
    foamy: Plane,
    /// Where the water at a pixel was n frames ago, x and y, for n in 0..=LIFE.
    origins: Vec<(Plane, Plane)>,
}

impl River {
    /// Nearness of row `y`: the scale of all things there.
    fn near(&self, y: f32) -> f32 {
        mix(0.34, 1.0, ((y - self.bank) / (self.height as f32 - self.bank)).clamp(-0.2, 1.2))
    }

    /// Velocity in pixels per frame: a uniform stream with a doublet at each stone.
    fn velocity(&self, x: f32, y: f32) -> (f32, f32) {
        let (mut u, mut v) = (1.0, 0.05);
        let mut slow: f32 = 1.0;
        for &(cx, cy, rx, ry) in &self.stones {
            let (a, b) = ((x - cx) / (1.08 * rx), (y - cy) / (1.08 * ry));
            let r2 = (a * a + b * b).max(0.9);
            u -= (a * a - b * b) / (r2 * r2);
            v -= 2.0 * a * b / (r2 * r2) * (ry / rx);
            let wake = exp(-b * b * 1.1) * step(-0.2, 1.0, a) * exp(-a.max(0.0) / 2.6);
            slow = slow.min(1.0 - 0.75 * wake);
        }
        let edge = step(0.0, 22.0, y - self.bank) * 0.6 + 0.4;
        let speed = 3.6 * self.near(y) * edge * slow;
        (speed * u.clamp(-0.4, 1.7), speed * v.clamp(-0.9, 0.9))
    }
}

impl<'a> RiverRenderer<'a> {
    /// Draws the banks and stones and traces the flow.
    pub fn new(scene: &'a River) -> Self {
        let (w, h, seed) = (scene.width, scene.height, scene.seed);
        let rise = |x: f32, y: f32| {
            let all = scene.stones.iter().enumerate();
            all.map(|(i, s)| boulder(seed ^ (i as u32 * 89 + 3), (s.0, s.1), (s.2, s.3), x, y)).fold(-1.0, f32::max)
        };
        let shore = |x: f32| scene.bank + 7.0 * fbm2(seed ^ 1, x / 34.0, 0.0, 4);
        let wet = |x: f32, y: f32| {
            let stone = scene.stones.iter().map(|s| ((y - s.1) / s.3 - 0.05) * step(1.6, 1.0, ((x - s.0) / s.2).abs()));
            let stone = step(0.0, 0.5, stone.fold(0.0, f32::max) + 0.2 * fbm2(seed ^ 2, x / 9.0, y / 9.0, 2));
            stone.max(step(-9.0, -1.0, y - shore(x)))
        };
        let relief = Relief::new(
            w,
            h,
            seed,
            |x, y| {
                let size = 18.0 * scene.near(y).max(0.5);
                1.15 * rise(x, y).max(0.0) + 0.7 * broken(seed ^ 4, x, y, size)
            },
            wet,
        );
        let mut land = relief.shade(LIMESTONE);
        let green =
            |x: f32, y: f32| step(scene.bank - 4.0, scene.bank - 22.0, y + 9.0 * noise2(seed ^ 8, x / 24.0, 0.0));
        leaves(&mut land, u64::from(seed), w * h / 3, 2.0, GREEN, green);
        for i in 0..18 {
            let x = w as f32 * (i as f32 + 0.5) / 18.0 + 9.0 * noise2(seed ^ 15, i as f32 * 0.7, 0.3);
            tuft(&mut land, u64::from(seed) + i, (x, shore(x) - 3.0), 11.0, 18);
        }
        let mut dry = Plane::zeros(w * SS, h * SS);
        for (i, value) in dry.data.iter_mut().enumerate() {
            let (x, y) = (((i % (w * SS)) as f32 + 0.5) / SS as f32, ((i / (w * SS)) as f32 + 0.5) / SS as f32);
            *value = step(0.0, 0.35, rise(x, y)).max(step(0.7, -0.7, y - shore(x)));
        }
        Self { scene, land, dry, bed: bed(scene), foamy: foamy(scene), origins: origins(scene) }
    }

    /// The picture at time `t`, a whole number of frames.
    pub fn frame(&self, t: usize) -> Rgb8 {
        let surface = self.surface(t);
        let mut canvas = self.land.clone();
        let width = canvas.width;
        canvas.paint(|x, y, old| {
            let i = (y * SS as f32) as usize * width + (x * SS as f32) as usize;
            let dry = self.dry.data[i];
            if dry >= 1.0 { old } else { blend(self.water(&surface, x, y, i), old, dry) }
        });
        canvas.develop(1.12)
    }

    /// Height of the waves (0) and of the foam's filigree (1) for each sample: two generations of texture, each
    /// carried along for its life, cross-faded at constant variance.
    fn surface(&self, t: usize) -> [Plane; 2] {
        let (w, h) = (self.scene.width * SS, self.scene.height * SS);
        let mut both = vec![[0.0f32; 2]; w * h];
        par::for_each_chunk(&mut both, w, |row, cells| {
            let y = (row as f32 + 0.5) / SS as f32;
            if y < self.scene.bank - 12.0 {
                return;
            }
            for (column, cell) in cells.iter_mut().enumerate() {
                let x = (column as f32 + 0.5) / SS as f32;
                let mut norm = 0.0;
                for generation in 0..2 {
                    let clock = t + generation * LIFE / 2;
                    let age = clock % LIFE;
                    let weight = sin(std::f32::consts::PI * (age as f32 + 0.5) / LIFE as f32);
                    let seed = self.scene.seed ^ ((clock / LIFE * 2 + generation) as u32).wrapping_mul(0x9e37_79b9);
                    let (ox, oy) = &self.origins[age];
                    let [wave, foam] = self.texture(seed, ox.bilinear(x, y), oy.bilinear(x, y), t as f32);
                    cell[0] += weight * wave;
                    cell[1] += weight * foam;
                    norm += weight * weight;
                }
                cell[0] = cell[0] / norm.sqrt() + self.standing(x, y, t as f32);
                cell[1] /= norm.sqrt();
            }
        });
        [0, 1].map(|k| Plane::from_vec(w, h, both.iter().map(|c| c[k]).collect()))
    }

    /// Waves and foam pattern at a place on the water that moves along.
    fn texture(&self, seed: u32, x: f32, y: f32, t: f32) -> [f32; 2] {
        let near = self.scene.near(y);
        let (px, py) = ((x - 0.5 * self.scene.width as f32) / near, (y - self.scene.bank) / (near * 0.50));
        let wave = 3.2 * noise3(seed, px / 26.0, py / 24.0, t / 30.0)
            + 1.7 * noise3(seed ^ 1, px / 11.0, py / 12.0, t / 22.0)
            + 0.85 * noise3(seed ^ 2, px / 5.2, py / 6.0, t / 16.0)
            + 0.30 * noise2(seed ^ 3, px / 2.6, py / 3.0);
        let (qx, qy) = (px + 3.0 * wave, py + 2.0 * wave);
        let foam =
            1.1 * (ridged2(seed ^ 5, qx / 17.0, qy / 15.0, 4) - 0.62) + 0.30 * fbm2(seed ^ 6, px / 9.0, py / 9.0, 3);
        [wave, foam]
    }

    /// Waves that stand still round the stones.
    fn standing(&self, x: f32, y: f32, t: f32) -> f32 {
        let mut sum = 0.0;
        for &(cx, cy, rx, ry) in &self.scene.stones {
            let (a, b) = ((x - cx) / rx, (y - cy) / ry);
            let r = (a * a + b * b).sqrt();
            if r < 4.0 {
                let upstream = step(0.5, -1.0, a);
                let bow = upstream * exp(-(r - 1.15) * (r - 1.15) * 18.0) * 2.6;
                let v = b.abs() - 0.45 * a;
                let wake = step(0.0, 1.0, a) * exp(-v * v * 5.0) * exp(-a / 2.2);
                sum += bow + 1.5 * wake * sin(5.5 * a - 0.10 * t);
            }
        }
        sum
    }

    fn water(&self, surface: &[Plane; 2], x: f32, y: f32, i: usize) -> Light {
        let (w, column, row) = (surface[0].width, (i % surface[0].width) as isize, (i / surface[0].width) as isize);
        let at = |dx: isize, dy: isize| surface[0].clamped(column + dx, row + dy);
        let near = self.scene.near(y);
        let (sx, sy) = (0.80 * near * (at(1, 0) - at(-1, 0)), 0.62 * near * (at(0, 1) - at(0, -1)));
        let facing = (0.30 + 0.62 * sy + 0.26 * sx).clamp(0.0, 1.0);
        let bright = step(0.12, 0.68, facing);
        let sky = blend([0.045, 0.065, 0.035], [0.62, 0.72, 0.80], bright * bright);
        let bend = |d: f32| (d * 7.0).clamp(-8.0, 8.0) as isize;
        let (bx, by) = ((column + bend(sx)).clamp(0, w as isize - 1), row + bend(sy));
        let below = self.bed.data[by.clamp(0, self.bed.height as isize - 1) as usize * w + bx as usize];
        let mirror = (0.34 + 0.34 * (1.0 - near) + 0.30 * bright).min(1.0);
        let clear = blend(below, sky, mirror);
        let glint = 0.9 * pow((0.42 + 0.55 * sy - 0.4 * sx).clamp(0.0, 1.0), 12.0);
        let foam = surface[1].data[i] + 0.16 * surface[0].data[i] / 3.0 + 1.05 * self.foamy.bilinear(x, y) - 0.40;
        let white = dim([0.84, 0.88, 0.90], (0.62 + 0.55 * sy + 0.35 * sx + 0.25 * foam).clamp(0.25, 1.1));
        blend(add(clear, dim([1.0, 0.98, 0.92], glint)), white, 0.93 * step(0.02, 0.42, foam))
    }
}

/// The stony ground under the water, brown and dim.
fn bed(scene: &River) -> Canvas {
    let relief = Relief::new(
        scene.width,
        scene.height,
        scene.seed ^ 0x77,
        |x, y| 0.9 * broken(scene.seed ^ 0x78, x, y * 1.8, 13.0 * scene.near(y)),
        |_, _| 0.75,
    );
    let mut bed = relief.shade(LIMESTONE);
    bed.paint(|x, y, old| {
        let deep = 0.42 + 0.30 * fbm2(scene.seed ^ 0x79, x / 60.0, y / 22.0, 3);
        [0.030 + 0.62 * deep * old[0], 0.030 + 0.55 * deep * old[1], 0.014 + 0.34 * deep * old[2]]
    });
    bed
}

/// How much foam the water at each pixel carries: before and behind stones and at drops.
fn foamy(scene: &River) -> Plane {
    Plane::from_fn(scene.width, scene.height, |px, py| {
        let (x, y) = (px as f32 + 0.5, py as f32 + 0.5);
        let mut sum: f32 = 0.25 + 0.45 * fbm2(scene.seed ^ 0x99, x / 110.0, y / 15.0, 3);
        for &(cx, cy, rx, ry) in &scene.stones {
            let (a, b) = ((x - cx) / rx, (y - cy) / ry);
            let ring = exp(-((a * a + b * b).sqrt() - 1.12).powi(2) * 22.0) * 0.55;
            let spread = b / (1.0 + 0.25 * a.max(0.0));
            let tail = step(0.3, 1.1, a) * exp(-spread * spread * 1.3) * exp(-(a - 1.0).max(0.0) / 2.0) * 0.95;
            sum = sum.max(ring * step(1.4, -0.4, a)).max(tail);
        }
        sum
    })
}

fn origins(scene: &River) -> Vec<(Plane, Plane)> {
    let (w, h) = (scene.width, scene.height);
    let mut all = vec![(Plane::from_fn(w, h, |x, _| x as f32 + 0.5), Plane::from_fn(w, h, |_, y| y as f32 + 0.5))];
    for _ in 0..LIFE {
        let (px, py) = &all[all.len() - 1];
        let (mut nx, mut ny) = (px.clone(), py.clone());
        for (x, y) in nx.data.iter_mut().zip(&mut ny.data) {
            for _ in 0..4 {
                let (u, v) = scene.velocity(*x, *y);
                (*x, *y) = (*x - 0.25 * u, *y - 0.25 * v);
            }
        }
        all.push((nx, ny));
    }
    all
}

/// The clip of the library.
pub fn clip_scene() -> River {
    River {
        width: 384,
        height: 256,
        seed: 41,
        bank: 58.0,
        stones: vec![
            (96.0, 78.0, 13.0, 6.0),
            (250.0, 84.0, 17.0, 7.5),
            (330.0, 72.0, 10.0, 4.5),
            (164.0, 112.0, 22.0, 11.0),
            (318.0, 130.0, 25.0, 13.0),
            (52.0, 142.0, 26.0, 14.0),
            (226.0, 178.0, 34.0, 19.0),
            (104.0, 208.0, 32.0, 18.0),
            (136.0, 221.0, 16.0, 8.5),
            (187.0, 104.0, 10.0, 5.5),
            (281.0, 122.0, 11.0, 6.0),
            (262.0, 190.0, 13.0, 7.5),
            (20.0, 88.0, 18.0, 7.0),
            (352.0, 226.0, 40.0, 22.0),
        ],
    }
}
