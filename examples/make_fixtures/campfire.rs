//! A campfire at night: logs in a ring of stones before dark trees, with and without its flames.

use enliven::base::rng;
use enliven::raster::image::{Plane, Rgb8};

use super::canvas::{Canvas, Light, add, blend, dim};
use super::fire::{Burning, Fire};
use super::land::{Relief, Stone, boulder, broken};
use super::noise::{fbm2, noise2};
use super::numeric::{cos, exp, mix, sin, step};

/// Grey stones that firelight reaches.
const HEARTHSTONE: Stone =
    Stone { pale: [0.30, 0.26, 0.22], dark: [0.10, 0.09, 0.08], moss: [0.08, 0.09, 0.03], mossy: 0.2 };

/// The fire of the picture; lengths within it are halves of the picture's pixels.
pub fn fire() -> Fire {
    Fire { width: 768, height: 576, scale: 2.0, seed: 12, bed: (124.0, 260.0), ground: 226.0, reach: 150.0, sheets: 3 }
}

/// The place without flames, lit by them.
pub fn place(fire: &Fire) -> Canvas {
    let h = fire.height as f32;
    let hearth = (0.5 * (fire.bed.0 + fire.bed.1) * fire.scale, fire.ground * fire.scale);
    let mut canvas = Canvas::black(fire.width, fire.height);
    let horizon = 0.60 * h;
    canvas.paint(|x, y, _| {
        let sky = blend([0.004, 0.007, 0.016], [0.012, 0.016, 0.026], y / horizon);
        let leaf = step(-0.1, 0.5, fbm2(fire.seed ^ 1, x / 46.0, y / 40.0, 5) + 0.25 - 0.5 * (1.0 - y / horizon));
        let glow = exp(-((x - hearth.0) / 260.0).powi(2) - ((y - hearth.1) / 230.0).powi(2));
        blend(sky, add([0.0035, 0.005, 0.004], dim([0.10, 0.055, 0.018], glow * (0.4 + 0.5 * leaf))), leaf)
    });
    trunks(&mut canvas, fire, hearth);
    let ground = Relief::new(
        fire.width,
        fire.height,
        fire.seed ^ 5,
        |x, y| 3.0 * broken(fire.seed, x, 2.4 * y, 22.0),
        |_, _| 0.0,
    );
    let soil = ground.shade(Stone {
        pale: [0.24, 0.18, 0.12],
        dark: [0.08, 0.06, 0.04],
        moss: [0.07, 0.08, 0.02],
        mossy: 0.3,
    });
    let width = canvas.width;
    canvas.paint(|x, y, old| {
        let edge = step(-1.5, 1.5, y - horizon - 7.0 * fbm2(fire.seed ^ 2, x / 60.0, 0.5, 4) - 16.0);
        let i = (y * 2.0) as usize * width + (x * 2.0) as usize;
        blend(old, firelit(soil.data[i], hearth, x, y, 1.0), edge)
    });
    stones(&mut canvas, fire, hearth, false);
    logs(&mut canvas, fire, hearth);
    stones(&mut canvas, fire, hearth, true);
    canvas
}

fn firelit(colour: Light, hearth: (f32, f32), x: f32, y: f32, reach: f32) -> Light {
    let d2 = ((x - hearth.0) / 190.0).powi(2) + ((y - hearth.1 - 10.0) / 85.0).powi(2);
    let warm = reach * 1.5 / (1.0 + 2.2 * d2 + 1.5 * d2 * d2) + 0.02;
    [colour[0] * (1.35 * warm + 0.012), colour[1] * (0.60 * warm + 0.016), colour[2] * (0.20 * warm + 0.028)]
}

fn trunks(canvas: &mut Canvas, fire: &Fire, hearth: (f32, f32)) {
    let (w, h) = (fire.width as f32, fire.height as f32);
    for i in 0..15u64 {
        let r = |n: u64| rng::unit(rng::hash(u64::from(fire.seed), &[900, i, n]));
        let x0 = w * (i as f32 + 0.2 + 0.6 * r(0)) / 15.0;
        let half = 4.0 + 13.0 * r(1) * r(1) * (0.4 + i as f32 % 3.0);
        let lean = 0.10 * (r(2) - 0.5);
        let foot = h * (0.60 + 0.05 * r(3));
        canvas.paint(|x, y, old| {
            let off = (x - x0 - lean * (foot - y) - 2.5 * noise2(i as u32, 0.3, y / 40.0))
                / (half * (1.0 + 0.4 * step(60.0, 0.0, foot - y)));
            let cover = step(1.0, 0.9, off.abs()) * step(foot + 2.0, foot - 2.0, y);
            if cover <= 0.0 {
                return old;
            }
            let bark = 0.55 + 0.5 * fbm2(i as u32 + 7, x / 2.5, y / 14.0, 3);
            let side = (hearth.0 - x0).signum() * off;
            let lit = step(-0.3, 1.0, side)
                * exp(-((x0 - hearth.0) / 330.0).powi(2))
                * exp(-((y - hearth.1) / 250.0).powi(2));
            blend(old, dim([0.16, 0.075, 0.026], bark * (0.75 * lit + 0.015)), cover)
        });
    }
}

fn stones(canvas: &mut Canvas, fire: &Fire, hearth: (f32, f32), front: bool) {
    let ring: Vec<(f32, f32, f32, f32)> = (0..16u64)
        .map(|i| {
            let r = |n: u64| rng::unit(rng::hash(u64::from(fire.seed), &[700, i, n]));
            let angle = std::f32::consts::TAU * (i as f32 + 0.35 * r(0)) / 16.0;
            let size = 19.0 + 9.0 * r(1);
            (hearth.0 + 176.0 * cos(angle), hearth.1 + 20.0 + 40.0 * sin(angle), size, size * 0.68)
        })
        .filter(|stone| (stone.1 > hearth.1 + 20.0) == front)
        .collect();
    let seed = fire.seed ^ if front { 400 } else { 0 };
    let highest = |x: f32, y: f32| {
        let mut best = (-1.0, 0);
        for (i, s) in ring.iter().enumerate() {
            if ((x - s.0) / s.2).abs() < 1.8 && ((y - s.1) / s.3).abs() < 1.8 {
                let rise = boulder(seed ^ (i as u32 * 31), (s.0, s.1), (s.2, s.3), x, y);
                if rise > best.0 {
                    best = (rise, i);
                }
            }
        }
        best
    };
    let height = |x: f32, y: f32| match highest(x, y).0 {
        rise if rise > 0.0 => rise + 0.5 * broken(seed, x, y, 20.0),
        _ => -2.0,
    };
    let shaded = Relief::new(fire.width, fire.height, seed, height, |_, _| 0.0).shade(HEARTHSTONE);
    let width = canvas.width;
    canvas.paint(|x, y, old| {
        let (rise, i) = highest(x, y);
        if rise <= 0.0 {
            return old;
        }
        let s = ring[i];
        let j = (y * 2.0) as usize * width + (x * 2.0) as usize;
        let across = (hearth.0 - s.0) / 176.0 * (x - s.0) / s.2;
        let towards = across + (hearth.1 - s.1) / 50.0 * (y - s.1) / s.3;
        let (dark, bright) = if front { (0.12, 1.0) } else { (0.5, 1.3) };
        let reach = mix(dark, bright, step(-0.4, 0.8, towards));
        blend(old, firelit(shaded.data[j], hearth, x, y, reach), step(0.0, 0.5, rise))
    });
}

fn logs(canvas: &mut Canvas, fire: &Fire, hearth: (f32, f32)) {
    const LOGS: [(f32, f32, f32, f32, f32); 5] = [
        (-10.0, 12.0, 118.0, 17.0, -0.16),
        (20.0, 2.0, 108.0, 15.0, 0.30),
        (-45.0, -6.0, 80.0, 13.0, 0.62),
        (50.0, -10.0, 82.0, 13.0, -0.66),
        (0.0, 26.0, 100.0, 15.0, 0.06),
    ];
    for (n, (dx, dy, half, thick, angle)) in LOGS.into_iter().enumerate() {
        let (c, s) = (cos(angle), sin(angle));
        let seed = fire.seed ^ (n as u32 * 57 + 3);
        canvas.paint(|x, y, old| {
            let (px, py) = (x - hearth.0 - dx, y - hearth.1 - dy);
            let (a, b) = ((px * c + py * s) / half, (py * c - px * s) / thick);
            let rough = 0.10 * fbm2(seed, a * half / 14.0, b, 3);
            let cover = step(1.0, 0.93, b.abs() + rough) * step(1.0, 0.98, a.abs() + 0.03 * b * b);
            if cover <= 0.0 {
                return old;
            }
            let bark = 0.5 + 0.6 * fbm2(seed ^ 1, a * half / 16.0, b * 3.2, 4);
            let coal =
                step(0.22, 0.75, fbm2(seed ^ 2, a * half / 13.0, b * 1.6, 4) + 0.22 * (1.0 - a.abs()) - 0.12 * b);
            let round = (1.0 - 0.8 * b * b).max(0.0) * (0.75 - 0.35 * b);
            let char = dim([0.075, 0.036, 0.016], bark * round * 1.5);
            let ember = dim([1.0, 0.20, 0.025], 0.9 * coal * (0.5 + 0.5 * bark) * (1.0 - 0.5 * a.abs()));
            blend(old, add(char, ember), cover)
        });
    }
}

/// The picture with its flames, the picture without, and the matte of the flames.
pub struct Pictures {
    /// With flames.
    pub burning: Rgb8,
    /// Without.
    pub clean: Rgb8,
    /// 1 where flames are.
    pub matte: Plane,
}

/// Lets the fire burn, draws the last moment, and mattes what burns in it.
pub fn pictures() -> Pictures {
    let fire = fire();
    let place = place(&fire);
    let mut burning = Burning::lit(&fire, 60);
    (0..48).for_each(|_| burning.advance());
    let mut flames = Plane::zeros(fire.width, fire.height);
    for (i, value) in flames.data.iter_mut().enumerate() {
        let (x, y) = (i % fire.width, i / fire.width);
        let light = burning.glow((x as f32 + 0.5) / fire.scale, (y as f32 + 0.5) / fire.scale);
        *value = step(0.006, 0.06, light[0]);
    }
    let wide = enliven::raster::filter::gaussian(&flames, 5.0);
    let mut canvas = place.clone();
    burning.draw(&mut canvas);
    Pictures { burning: canvas.develop(1.3), clean: place.develop(1.3), matte: wide.map(|v| step(0.02, 0.45, v)) }
}
