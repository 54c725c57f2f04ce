//! Falling water: sheets whose texture is carried along free fall, drops with a tail, spray, a pool, wet rocks.

use enliven::base::rng;
use enliven::raster::image::{Plane, Rgb8};

use super::canvas::{Canvas, Light, SS, add, blend, dim};
use super::land::{GREEN, LIMESTONE, Relief, boulder, broken, leaves, tuft};
use super::noise::{fbm2, fbm3, noise2, noise3, ridged2};
use super::numeric::{mix, step};

/// One free fall between a lip and what it falls on. Lengths in pixels, times in frames.
#[derive(Clone, Copy)]
pub struct Tier {
    /// Left end of the lip.
    pub left: f32,
    /// Right end of the lip.
    pub right: f32,
    /// Height of the lip.
    pub lip: f32,
    /// Slope of the lip, pixels down per pixel to the right.
    pub slope: f32,
    /// Where it ends.
    pub bottom: f32,
    /// Widening: 0.3 makes the foot 30 % wider than the lip.
    pub flare: f32,
    /// How much of the rock behind is covered, about 0 (threads) to 1 (a curtain).
    pub cover: f32,
}

/// A composition.
pub struct Falls {
    /// Width of the picture.
    pub width: usize,
    /// Height of the picture.
    pub height: usize,
    /// Changes every random detail.
    pub seed: u32,
    /// From the top down.
    pub tiers: Vec<Tier>,
    /// Boulders in front of the water: centre and half axes.
    pub boulders: Vec<(f32, f32, f32, f32)>,
    /// Height of the pool's far shore.
    pub pool: f32,
    /// Size of everything; 1 for the small clip.
    pub scale: f32,
    /// The two colours of the leaves.
    pub leaves: [Light; 2],
}

/// Speed at the lip, pixels per frame (times the scale).
const LIP_SPEED: f32 = 1.3;
/// Gravity, pixels per frame² (times the scale).
const GRAVITY: f32 = 0.055;

impl Tier {
    fn lip_at(&self, scale: f32, seed: u32, x: f32) -> f32 {
        let bumps = 5.0 * fbm2(seed ^ 31, x / (26.0 * scale), 0.5, 3) + 2.0 * noise2(seed ^ 32, x / (7.0 * scale), 0.5);
        self.lip + self.slope * (x - self.left) + scale * bumps
    }

    /// Lateral coordinate at the lip of the water that passes (x, y), and the frames since it left the lip.
    fn trace(&self, scale: f32, seed: u32, x: f32, y: f32) -> (f32, f32) {
        let drop = (y - self.lip_at(scale, seed, x)).max(0.0);
        let depth = drop / (self.bottom - self.lip);
        let centre = 0.5 * (self.left + self.right);
        let u = centre + (x - centre) / (1.0 + self.flare * depth);
        let (v, g) = (LIP_SPEED * scale, GRAVITY * scale);
        (u, ((v * v + 2.0 * g * drop).sqrt() - v) / g)
    }

    /// Distance fallen after `age` frames.
    fn fallen(scale: f32, age: f32) -> f32 {
        scale * (LIP_SPEED * age + 0.5 * GRAVITY * age * age)
    }

    /// 1 inside the fall, 0 outside, with soft uneven edges.
    fn envelope(&self, scale: f32, seed: u32, x: f32, y: f32) -> f32 {
        let lip = self.lip_at(scale, seed, x);
        let depth = (y - lip) / (self.bottom - self.lip);
        let (u, _) = self.trace(scale, seed, x, y);
        let wander = scale * (7.0 * fbm2(seed ^ 41, x / (20.0 * scale), y / (44.0 * scale), 3));
        let inside = (u + wander - self.left).min(self.right - u - wander) / (9.0 * scale);
        let below = step(-scale, 3.0 * scale, y - lip);
        step(0.0, 1.0, inside) * below * step(1.12, 0.98, depth)
    }
}

/// Everything that stays the same from frame to frame.
pub struct FallsRenderer<'a> {
    scene: &'a Falls,
    back: Canvas,
    front: Canvas,
    front_cover: Plane,
    envelopes: Vec<Plane>,
}

impl<'a> FallsRenderer<'a> {
    /// Draws the rocks and leaves.
    pub fn new(scene: &'a Falls) -> Self {
        let (w, h, k, seed) = (scene.width, scene.height, scene.scale, scene.seed);
        let wet = |x: f32, y: f32| {
            let around = scene.tiers.iter().map(|t| {
                let (u, _) = t.trace(k, seed, x, y);
                let off = (t.left - u).max(u - t.right).max(0.0) + (t.lip - 14.0 * k - y).max(0.0) * 1.5;
                step(30.0 * k, 2.0 * k, off + 8.0 * k * fbm2(seed ^ 51, x / (12.0 * k), y / (25.0 * k), 3))
            });
            around.fold(step(-22.0 * k, 2.0 * k, y - scene.pool), f32::max)
        };
        let cliff = Relief::new(w, h, seed, |x, y| k * broken(seed, x / k, y / k, 30.0), wet);
        let mut back = cliff.shade(LIMESTONE);
        let open = |x: f32, y: f32| {
            let first = &scene.tiers[0];
            let top =
                step(first.lip + 6.0 * k, first.lip - 34.0 * k, y + 10.0 * k * noise2(seed ^ 61, x / (30.0 * k), 0.0));
            let side = ((x - 0.5 * w as f32).abs() / (0.5 * w as f32) - 0.58) / 0.35;
            let fall = step(0.0, 24.0 * k, (first.left - x).max(x - first.right));
            (top.max(side * step(0.95 * scene.pool, 0.45 * scene.pool, y)) * (0.25 + 0.75 * fall)).clamp(0.0, 1.0)
        };
        let count = (w * h) as f32 * 0.34 / (k * k);
        leaves(&mut back, u64::from(seed) + 1, count as usize, 2.2 * k, scene.leaves, open);
        let (front, front_cover) = Self::foreground(scene);
        let envelopes = scene.tiers.iter().map(|tier| {
            let mut plane = Plane::zeros(w * SS, h * SS);
            for (i, value) in plane.data.iter_mut().enumerate() {
                let (x, y) = position(i, w * SS);
                *value = tier.envelope(k, seed, x, y);
            }
            plane
        });
        let envelopes = envelopes.collect();
        Self { scene, back, front, front_cover, envelopes }
    }

    fn foreground(scene: &Falls) -> (Canvas, Plane) {
        let (w, h, k, seed) = (scene.width, scene.height, scene.scale, scene.seed);
        let rise = |x: f32, y: f32| {
            let all = scene.boulders.iter().enumerate();
            all.map(|(i, b)| boulder(seed ^ (i as u32 * 97 + 5), (b.0, b.1), (b.2, b.3), x, y)).fold(-1.0, f32::max)
        };
        let relief = Relief::new(
            w,
            h,
            seed ^ 0x33,
            |x, y| rise(x, y).max(-2.0) + 0.45 * k * broken(seed ^ 9, x / k, y / k, 16.0),
            |x, y| 0.35 + 0.65 * step(-0.25, 0.25, fbm2(seed ^ 71, x / (14.0 * k), y / (14.0 * k), 2)),
        );
        let mut canvas = relief.shade(LIMESTONE);
        let mut cover = Plane::zeros(w * SS, h * SS);
        for (i, value) in cover.data.iter_mut().enumerate() {
            let (x, y) = position(i, w * SS);
            *value = step(0.0, 0.25, rise(x, y));
        }
        for (i, b) in scene.boulders.iter().enumerate() {
            if b.2 > 18.0 * k {
                tuft(&mut canvas, u64::from(seed) + i as u64, (b.0, b.1 - 0.55 * b.3), 9.0 * k, 26);
            }
        }
        (canvas, cover)
    }

    /// Soft mask of all moving water, 0 to 1, in final pixels.
    pub fn matte(&self) -> Plane {
        let (w, h, k) = (self.scene.width, self.scene.height, self.scene.scale);
        Plane::from_fn(w, h, |px, py| {
            let mut sum = 0.0;
            for sub in 0..SS * SS {
                let i = (py * SS + sub / SS) * w * SS + px * SS + sub % SS;
                let y = ((py * SS + sub / SS) as f32 + 0.5) / SS as f32;
                let fall = self.envelopes.iter().map(|e| step(0.05, 0.6, e.data[i])).fold(0.0, f32::max);
                let (x, _) = position(i, w * SS);
                let pool = self.pool_cover(x, y, k);
                sum += fall.max(pool) * (1.0 - self.front_cover.data[i]);
            }
            sum / (SS * SS) as f32
        })
    }

    fn pool_cover(&self, x: f32, y: f32, k: f32) -> f32 {
        let shore = self.scene.pool + 5.0 * k * fbm2(self.scene.seed ^ 81, x / (24.0 * k), 0.0, 3);
        step(-0.5, 0.8, y - shore)
    }

    /// The picture at time `t` in frames.
    pub fn frame(&self, t: f32) -> Rgb8 {
        let mut canvas = self.back.clone();
        let width = canvas.width;
        canvas.paint(|x, y, old| {
            let i = (y * SS as f32) as usize * width + (x * SS as f32) as usize;
            let mut light = self.pool(old, x, y, t);
            for (n, tier) in self.scene.tiers.iter().enumerate() {
                let envelope = self.envelopes[n].data[i];
                if envelope > 0.0 {
                    light = self.sheet(light, tier, envelope, x, y, t);
                }
            }
            light
        });
        for (n, tier) in self.scene.tiers.iter().enumerate() {
            self.drops(&mut canvas, n as u64, tier, t);
        }
        for (n, tier) in self.scene.tiers.iter().enumerate() {
            self.splashes(&mut canvas, n as u64, tier, t);
        }
        canvas.paint(|x, y, old| {
            let i = (y * SS as f32) as usize * width + (x * SS as f32) as usize;
            let rock = blend(old, self.front.data[i], self.front_cover.data[i]);
            self.mist(rock, x, y, t)
        });
        canvas.develop(1.15)
    }

    fn sheet(&self, behind: Light, tier: &Tier, envelope: f32, x: f32, y: f32, t: f32) -> Light {
        let (k, seed) = (self.scene.scale, self.scene.seed ^ 0x0f00);
        let (u, age) = tier.trace(k, self.scene.seed, x, y);
        let carried = age - t;
        let sway = 2.5 * noise3(seed ^ 1, u / (16.0 * k), carried / 14.0, 0.013 * t) * (age / 30.0).min(1.0);
        let u = u / k + sway;
        let strands = fbm2(seed ^ 2, u / 17.0, y / (160.0 * k), 3);
        let lumps = fbm3(seed ^ 3, u / 15.0, carried / 13.0, 0.02 * t, 3);
        let ropes = noise3(seed ^ 4, u / 4.2, carried / 9.0, 0.03 * t);
        let fine = noise3(seed ^ 5, u / 2.0, carried / 5.5, 0.04 * t);
        let lit = noise3(seed ^ 4, (u - 1.2) / 4.2, carried / 9.0, 0.03 * t) - ropes;
        let young = step(16.0, 2.0, age);
        let body = tier.cover - 0.42 + 1.1 * strands + 0.75 * lumps + 0.42 * ropes + 0.28 * fine + 0.35 * young;
        let cover = step(-0.25, 0.55, body * mix(0.4, 1.0, envelope) - 0.55 * (1.0 - envelope)) * envelope.sqrt();
        let shade = 0.40 + 0.30 * lumps + 0.40 * ropes + 0.42 * fine + 0.55 * lit + 0.22 * body;
        let clear = step(12.0, 0.0, age) * 0.6;
        let foam = blend([0.10, 0.14, 0.16], [0.92, 0.96, 1.0], shade.clamp(0.02, 1.0));
        let glass = add(dim(behind, 0.6), dim([0.30, 0.36, 0.38], (0.3 + 0.9 * ropes + 0.6 * fine).max(0.0)));
        blend(dim(behind, 1.0 - 0.35 * envelope), blend(foam, glass, clear), 0.94 * cover)
    }

    /// Lumps of water that fall with the sheet, born where the sheet is dense.
    fn drops(&self, canvas: &mut Canvas, layer: u64, tier: &Tier, t: f32) {
        let (k, seed) = (self.scene.scale, u64::from(self.scene.seed) * 31 + layer);
        let height = tier.bottom - tier.lip;
        let (v, g) = (LIP_SPEED * k, GRAVITY * k);
        let life = ((v * v + 2.0 * g * height).sqrt() - v) / g;
        let count = ((tier.right - tier.left) * height * 0.30 / (k * k)) as u64;
        for i in 0..count {
            let offset = rng::unit(rng::hash(seed, &[i, 0])) * life;
            let cycle = ((t + offset) / life).floor();
            let age = t + offset - cycle * life;
            let r = |n: u64| rng::unit(rng::hash(seed, &[i, n, cycle as u64]));
            let u = mix(tier.left, tier.right, r(1));
            let birth = age - t;
            let dense = fbm3((self.scene.seed ^ 0x0f00) ^ 3, u / (15.0 * k), birth / 13.0, 0.02 * t, 2);
            let strand = fbm2((self.scene.seed ^ 0x0f00) ^ 2, u / (17.0 * k), 0.4, 2);
            if r(2) > 0.5 + 1.3 * dense + 0.9 * strand {
                continue;
            }
            let age = age * (0.97 + 0.06 * r(3));
            let centre = 0.5 * (tier.left + tier.right);
            let fallen = Tier::fallen(k, age);
            let x = centre + (u - centre) * (1.0 + tier.flare * fallen / height) + k * (r(4) - 0.5) * 0.12 * age;
            let y = tier.lip_at(k, self.scene.seed, u) + fallen;
            let speed = v + g * age;
            let size = k * (0.35 + 0.75 * r(5) * r(5));
            let tail = (x - (x - centre) * 0.01, y - speed * (0.9 + 1.6 * r(6)));
            let fade = step(0.0, 5.0, age) * step(life, 0.9 * life, age);
            let edge = step(0.0, 0.12, (u - tier.left).min(tier.right - u) / (tier.right - tier.left) + 0.05 * r(8));
            canvas.streak(tail, (x, y), size, 0.55 * fade * edge * (0.4 + 0.6 * r(7)), [0.95, 0.98, 1.0]);
        }
    }

    /// Drops thrown up where the water lands.
    fn splashes(&self, canvas: &mut Canvas, layer: u64, tier: &Tier, t: f32) {
        let (k, seed) = (self.scene.scale, u64::from(self.scene.seed) * 37 + 1000 + layer);
        let count = ((tier.right - tier.left) * 5.0 / k) as u64;
        let half = 0.5 * (tier.right - tier.left) * (1.0 + tier.flare);
        for i in 0..count {
            let life = 8.0 + 12.0 * rng::unit(rng::hash(seed, &[i, 0]));
            let offset = rng::unit(rng::hash(seed, &[i, 1])) * life;
            let cycle = ((t + offset) / life).floor();
            let age = t + offset - cycle * life;
            let r = |n: u64| rng::unit(rng::hash(seed, &[i, n, cycle as u64]));
            let x0 = 0.5 * (tier.left + tier.right) + half * 1.02 * (2.0 * r(2) - 1.0);
            let (vx, vy) = (k * 2.4 * (r(3) - 0.5), -k * (0.5 + 2.0 * r(4) * r(4)));
            let y0 = tier.bottom - k * 3.0 * r(6);
            let g = 0.12 * k;
            let at = |a: f32| (x0 + vx * a, y0 + vy * a + 0.5 * g * a * a);
            let fade = (1.0 - age / life) * 0.55 * r(5);
            canvas.streak(at((age - 0.8).max(0.0)), at(age), k * (0.35 + 0.4 * r(7)), fade, [0.95, 0.98, 1.0]);
        }
    }

    fn pool(&self, behind: Light, x: f32, y: f32, t: f32) -> Light {
        let (k, seed) = (self.scene.scale, self.scene.seed ^ 0xf000);
        let cover = self.pool_cover(x, y, k);
        if cover <= 0.0 {
            return behind;
        }
        let depth = (y - self.scene.pool).max(0.0) / (self.scene.height as f32 - self.scene.pool);
        let near = 0.45 + 0.55 * depth;
        let drift = 0.55 * t;
        let (px, py) = ((x - 0.5 * self.scene.width as f32) / (k * near), (y - self.scene.pool) / (k * near * 0.42));
        let flow = |scale: f32, s: u32| noise3(seed ^ s, px / scale, (py - drift * 1.5) / scale, 0.05 * t);
        let ripple = 0.5 * flow(14.0, 1) + 0.35 * flow(6.0, 2) + 0.3 * flow(2.8, 3);
        let off = |tier: &Tier| (tier.left - x).max(x - tier.right).max(0.0) + (self.scene.pool - tier.bottom).max(0.0);
        let out = self.scene.tiers.iter().map(off).fold(f32::MAX, f32::min) / (60.0 * k);
        let white = step(0.95, 0.0, out + 1.15 * depth);
        let cells = ridged2(seed ^ 7, px / 16.0 + 0.3 * ripple, (py - drift * 1.5) / 16.0 + 0.02 * t, 3);
        let foam = step(0.55, 0.95, 0.75 * cells + 0.85 * white + 0.35 * ripple - 0.12);
        let sky = step(-0.15, 0.75, ripple + 0.12);
        let water = add(dim([0.035, 0.05, 0.045], 1.0), dim([0.26, 0.31, 0.32], sky * 0.75));
        blend(behind, blend(water, dim([0.86, 0.9, 0.92], 0.78 + 0.3 * ripple), foam * 0.92), cover)
    }

    fn mist(&self, behind: Light, x: f32, y: f32, t: f32) -> Light {
        let (k, seed) = (self.scene.scale, self.scene.seed ^ 0xaaaa);
        let last = |tier: &Tier| tier.bottom > self.scene.pool;
        let mut thick: f32 = 0.0;
        for tier in &self.scene.tiers {
            let half = 0.5 * (tier.right - tier.left) * (1.0 + tier.flare);
            let off = ((x - 0.5 * (tier.left + tier.right)).abs() - half).max(0.0) / (22.0 * k);
            let above = (tier.bottom - y) / ((if last(tier) { 34.0 } else { 12.0 }) * k);
            let shape = step(1.0, 0.0, off) * if above > 0.0 { step(1.0, 0.0, above) } else { step(-0.55, 0.0, above) };
            let part = if last(tier) { 1.0 } else { 0.55 };
            thick = thick.max(part * shape);
        }
        if thick <= 0.0 {
            return behind;
        }
        let (px, py) = (x / k, (y + 0.45 * k * t) / k);
        let puffs = fbm3(seed, px / 24.0, py / 22.0, 0.035 * t, 4);
        blend(behind, [0.80, 0.86, 0.90], (thick * (0.22 + 0.50 * puffs)).clamp(0.0, 0.7))
    }
}

fn position(index: usize, width: usize) -> (f32, f32) {
    (((index % width) as f32 + 0.5) / SS as f32, ((index / width) as f32 + 0.5) / SS as f32)
}

/// The clip of the library.
pub fn clip_scene() -> Falls {
    Falls {
        width: 384,
        height: 256,
        seed: 20,
        tiers: vec![
            Tier { left: 138.0, right: 236.0, lip: 30.0, slope: 0.03, bottom: 118.0, flare: 0.25, cover: 0.50 },
            Tier { left: 104.0, right: 284.0, lip: 118.0, slope: 0.02, bottom: 214.0, flare: 0.12, cover: 0.42 },
        ],
        boulders: vec![
            (169.0, 131.0, 13.0, 17.0),
            (268.0, 131.0, 27.0, 18.0),
            (112.0, 128.0, 13.0, 14.0),
            (92.0, 206.0, 34.0, 24.0),
            (226.0, 204.0, 20.0, 17.0),
            (318.0, 208.0, 42.0, 26.0),
            (40.0, 246.0, 58.0, 26.0),
            (372.0, 250.0, 44.0, 24.0),
            (150.0, 219.0, 15.0, 8.0),
        ],
        pool: 206.0,
        scale: 1.0,
        leaves: GREEN,
    }
}

/// The picture that is to be painted: wider, with other falls under autumn leaves.
pub fn picture_scene() -> Falls {
    Falls {
        width: 960,
        height: 640,
        seed: 7,
        tiers: vec![
            Tier { left: 470.0, right: 640.0, lip: 92.0, slope: -0.05, bottom: 278.0, flare: 0.30, cover: 0.50 },
            Tier { left: 392.0, right: 690.0, lip: 262.0, slope: 0.03, bottom: 520.0, flare: 0.18, cover: 0.40 },
            Tier { left: 216.0, right: 300.0, lip: 205.0, slope: 0.08, bottom: 512.0, flare: 0.35, cover: 0.34 },
        ],
        boulders: vec![
            (424.0, 284.0, 36.0, 34.0),
            (664.0, 282.0, 44.0, 36.0),
            (350.0, 512.0, 62.0, 46.0),
            (560.0, 528.0, 44.0, 34.0),
            (760.0, 520.0, 100.0, 70.0),
            (150.0, 530.0, 96.0, 60.0),
            (60.0, 620.0, 130.0, 64.0),
            (900.0, 622.0, 150.0, 60.0),
            (300.0, 570.0, 34.0, 18.0),
        ],
        pool: 505.0,
        scale: 1.9,
        leaves: [[0.36, 0.11, 0.015], [0.52, 0.34, 0.03]],
    }
}
