//! A still picture of flames with their opacity, to borrow looks from: the simulator's gas, coloured by heat.

use std::path::Path;

use anyhow::Result;
use enliven::simulate::file::parse;
use enliven::simulate::gas::Smoke;
use enliven::simulate::setup::Setup;

use super::numeric::{mix, step};

/// Width and height of the picture, pixels.
pub const SIZE: (usize, usize) = (240, 200);
/// A wide fire that fills the picture, with air drawn in from below.
const FIRE: &str = "
size = [240, 200]
vorticity = 0.05
wind = [0.0, -0.8]
drag = 0.03
sides = { left = 'open', right = 'open', top = 'open', bottom = 'open' }
[gas]
buoyancy = 0.08
cooling = 0.016
fading = 0.05
opacity = 10.0
turbulence = 0.5
eddies = 14.0
[[emitter]]
box = [20.0, 186.0, 200.0, 24.0]
soft = 24.0
rate = 0.22
temperature = 2.2
velocity = [0.0, -2.0]
flicker = 1.0
";
/// Frames that it burns before the picture is taken.
const BURNING: usize = 120;
/// Temperatures between which gas becomes visible as flame.
const GLOW: (f32, f32) = (0.45, 0.8);
/// Colours of flames by temperature.
const COLOURS: [(f32, [f32; 3]); 5] = [
    (0.5, [0.42, 0.07, 0.03]),
    (0.9, [0.86, 0.26, 0.04]),
    (1.3, [0.99, 0.52, 0.09]),
    (1.75, [1.0, 0.78, 0.28]),
    (2.3, [1.0, 0.95, 0.72]),
];

/// Red, green, blue and opacity a pixel, 8 bits each; colours not multiplied by opacity.
pub fn flames() -> Result<Vec<u8>> {
    let setup = Setup::new(parse(FIRE, Path::new("exemplar"))?, Path::new(""))?;
    let mut gas = Smoke::new(&setup);
    for frame in 0..BURNING {
        gas.push(frame as f32, 1.0)?;
        gas.carry(1.0);
    }
    let pixel = |(alpha, heat): (&f32, &f32)| {
        let [r, g, b] = colour(*heat);
        [r, g, b, alpha * step(GLOW.0, GLOW.1, *heat)].map(|v| (v * 255.0).round() as u8)
    };
    Ok(gas.alpha().data.iter().zip(&gas.temperature.data).flat_map(pixel).collect())
}

fn colour(heat: f32) -> [f32; 3] {
    COLOURS.windows(2).fold(COLOURS[0].1, |colour, pair| {
        let share = step(pair[0].0, pair[1].0, heat);
        std::array::from_fn(|k| mix(colour[k], pair[1].1[k], share))
    })
}
