//! Pictures of a simulation for people to look at.

use crate::raster::image::{Plane, Rgb8};

/// Temperature from which on smoke glows, and what each further colour of [`FLAMES`] needs more.
const GLOWING: f32 = 0.6;
const HOTTER: f32 = 0.35;
const ROCK: [f32; 3] = [0.36, 0.32, 0.28];
const NIGHT: [f32; 3] = [0.09, 0.10, 0.13];
const SMOKE: [f32; 3] = [0.84, 0.85, 0.87];
/// Colours of flames, from those that just glow to the hottest.
const FLAMES: [[f32; 3]; 4] = [[0.45, 0.10, 0.05], [0.95, 0.36, 0.06], [1.0, 0.68, 0.18], [1.0, 0.93, 0.66]];
const DEEP: [f32; 3] = [0.10, 0.33, 0.42];
const CREST: [f32; 3] = [0.85, 0.94, 0.95];
const FOAM: [f32; 3] = [0.96, 0.98, 0.98];

/// Smoke before the night; flames where it is hot, the redder the cooler.
pub(super) fn gas(alpha: &Plane, temperature: &Plane, solid: &[bool]) -> Rgb8 {
    paint(alpha, solid, |x, y| {
        let hot = (temperature.at(x, y) - GLOWING) / HOTTER;
        let step = |n: usize, colour| mix(colour, FLAMES[n], hot - n as f32);
        mix(NIGHT, (0..FLAMES.len()).fold(SMOKE, |colour, n| step(n, colour)), alpha.at(x, y))
    })
}

/// Water lit from the upper left, brighter where it is higher than `rest`, white where it foams.
pub(super) fn water(depth: &Plane, rest: f32, foam: &Plane, solid: &[bool]) -> Rgb8 {
    paint(depth, solid, |x, y| {
        let (x0, y0) = (x as isize, y as isize);
        let here = depth.at(x, y);
        // Walls do not count as a slope.
        let near = |dx: isize, dy: isize| match depth.clamped(x0 + dx, y0 + dy) {
            0.0 => here,
            d => d,
        };
        let slope = (near(1, 0) - near(-1, 0)) + (near(0, 1) - near(0, -1));
        let clear = mix(DEEP, CREST, 0.3 + 1.5 * (here / rest - 1.0) + 4.0 * slope / rest);
        mix(clear, FOAM, foam.at(x, y))
    })
}

fn paint(size: &Plane, solid: &[bool], colour: impl Fn(usize, usize) -> [f32; 3]) -> Rgb8 {
    let mut out = Rgb8::black(size.width, size.height);
    for (i, pixel) in out.data.chunks_exact_mut(3).enumerate() {
        let rgb = if solid[i] { ROCK } else { colour(i % size.width, i / size.width) };
        pixel.iter_mut().zip(rgb).for_each(|(p, c)| *p = (c * 255.0 + 0.5) as u8);
    }
    out
}

fn mix(a: [f32; 3], b: [f32; 3], share: f32) -> [f32; 3] {
    let share = share.clamp(0.0, 1.0);
    std::array::from_fn(|k| a[k] + share * (b[k] - a[k]))
}
