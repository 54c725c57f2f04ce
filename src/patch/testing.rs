//! What tests of several files of this folder need.

use super::data::channels::{Channel, Layout, Role, Stack};
use super::data::patches::Patches;
use super::data::segments::{Thresholds, labels};
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

/// The least cost of giving each of `n` rows a column of its own (Hungarian method, Jonker & Volgenant's form).
pub fn assignment(n: usize, cost: impl Fn(usize, usize) -> f64) -> f64 {
    // Column 0 is where a new row starts; rows and columns count from 1.
    let (mut rows, mut columns) = (vec![0.0; n + 1], vec![0.0; n + 1]);
    let mut row_of = vec![0usize; n + 1];
    for row in 1..=n {
        row_of[0] = row;
        let mut column = 0;
        let (mut least, mut before, mut done) = (vec![f64::INFINITY; n + 1], vec![0usize; n + 1], vec![false; n + 1]);
        while row_of[column] != 0 {
            done[column] = true;
            let here = row_of[column];
            for j in (1..=n).filter(|&j| !done[j]) {
                let reduced = cost(here - 1, j - 1) - rows[here] - columns[j];
                if reduced < least[j] {
                    (least[j], before[j]) = (reduced, column);
                }
            }
            let next = (1..=n).filter(|&j| !done[j]).min_by(|&a, &b| least[a].total_cmp(&least[b])).unwrap();
            let step = least[next];
            for j in 0..=n {
                if done[j] {
                    rows[row_of[j]] += step;
                    columns[j] -= step;
                } else {
                    least[j] -= step;
                }
            }
            column = next;
        }
        while column != 0 {
            row_of[column] = row_of[before[column]];
            column = before[column];
        }
    }
    (1..=n).map(|j| cost(row_of[j] - 1, j - 1)).sum()
}
