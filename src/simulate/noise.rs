//! Noise that is smooth over place and time: what flickers and what stirs.

use crate::base::rng::{hash, unit};

/// Values in [0, 1), ½ on average, smooth over about one unit of each of x, y and time.
pub(super) fn smooth_noise(seed: u64, [x, y, t]: [f32; 3]) -> f32 {
    // Two lattices at an angle to the pixels and to each other hide each other's lines.
    0.5 * lattice(seed, [0.8 * x + 0.6 * y, 0.8 * y - 0.6 * x, t], 0)
        + 0.5 * lattice(seed, [0.28 * x - 0.96 * y, 0.28 * y + 0.96 * x, t + 0.5], 1)
}

/// Random values at whole places, smooth between them.
fn lattice(seed: u64, at: [f32; 3], layer: u64) -> f32 {
    let between = at.map(|v| smooth(v - v.floor()));
    let corner = |i: u64| {
        let [x, y, t] = std::array::from_fn(|k| (at[k].floor() as i64 + (i >> k & 1) as i64) as u64);
        let weights = between.iter().enumerate().map(|(k, w)| if i >> k & 1 == 1 { *w } else { 1.0 - w });
        weights.product::<f32>() * unit(hash(seed, &[layer, x, y, t]))
    };
    (0..8).map(corner).sum()
}

/// From 0 to 1 without a kink at either end.
pub(super) fn smooth(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}
