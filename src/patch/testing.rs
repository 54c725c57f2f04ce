//! What tests of several files of this folder need.

use super::channels::{Channel, Layout, Role, Stack};
use super::segments::{Patches, Thresholds, labels};
use crate::base::rng::{hash, unit};
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;

/// One synthesised channel of weight 1.
pub fn grey_layout(radius: usize) -> Layout {
    Layout::new(radius, vec![Channel::new("grey", 1.0, Role::Synthesised)]).unwrap()
}

/// Everything interior.
pub fn grey_patches(plane: &Plane, radius: usize) -> Patches {
    let labels = labels((plane.width, plane.height), radius, None, Thresholds::default());
    Patches::new(Stack::from_planes(std::slice::from_ref(plane)), labels)
}

/// Soft blobs on two scales with fine grain, seen from `(offset, offset)` on.
pub fn texture(width: usize, height: usize, offset: f32) -> Plane {
    let noise = |seed: u64| {
        let at = |v: usize| v as u64 + offset as u64;
        Plane::from_fn(width + 8, height + 8, |x, y| unit(hash(seed, &[at(x), at(y)])) - 0.5)
    };
    let (coarse, fine, grain) = (gaussian(&noise(1), 4.0), gaussian(&noise(2), 1.2), noise(3));
    let value = |x: usize, y: usize| {
        0.5 + 3.5 * coarse.at(x + 4, y + 4) + 0.8 * fine.at(x + 4, y + 4) + 0.05 * grain.at(x + 4, y + 4)
    };
    Plane::from_fn(width, height, |x, y| value(x, y).clamp(0.0, 1.0))
}
