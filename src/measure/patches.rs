//! How patches of pixels are distributed, in space and in space and time.

use std::sync::Arc;

use super::definition::{Better, Measure};
use super::footage::Footage;
use super::sliced::{Points, Sorted, distance, scaled_distance};
use crate::base::rng;

/// Side of a patch in pixels, and frames of a space-time patch.
const SIDE: usize = 7;
/// Patches taken from each video.
const SAMPLES: usize = 16384;
/// Fewest places a patch can lie at for its distribution to be worth a number.
const MIN_PLACES: usize = 64;

/// Still appearance.
pub const PATCH_DISTANCE: Measure = Measure {
    name: "patch distance",
    unit: "colour, 0 to 1",
    definition: "sliced Wasserstein distance between 7 × 7 colour patches of the frames and of the picture (or reference)",
    needs: "picture or reference",
    better: Better::Lower,
    compute: |subject| {
        let (a, b) = (subject.footage, subject.appearance()?);
        let (a, b) = (colours(a, subject.seed)?, colours(b, subject.seed)?);
        Some(distance(&a, &b))
    },
};

/// The motion itself.
pub const DYNAMICS_DISTANCE: Measure = Measure {
    name: "dynamics distance",
    unit: "luma, 0 to 1",
    definition: "sliced Wasserstein distance between 7 × 7 × 7 space-time patches, less each pixel's mean over time, of the frames and of the reference",
    needs: "reference",
    better: Better::Lower,
    compute: |subject| dynamics_distance(subject.footage, subject.reference?, subject.seed),
};

/// The form of the motion, whatever its strength.
pub const DYNAMICS_SHAPE: Measure = Measure {
    name: "dynamics shape distance",
    unit: "deviations",
    definition: "the dynamics distance with the deviation over time of both sides brought to 1: the form of the motion, not its strength",
    needs: "reference",
    better: Better::Lower,
    compute: |subject| {
        let (a, b) = (subject.footage, subject.reference?);
        let (a, b) = (dynamics(a, subject.seed)?, dynamics(b, subject.seed)?);
        let moves = a.deviation().min(b.deviation()) > STILL;
        moves.then(|| scaled_distance(&a, &b, [a.deviation().recip(), b.deviation().recip()]))
    },
};

/// Deviation of points about 0 below which there is no motion to compare.
const STILL: f64 = 5e-4;

/// See [`DYNAMICS_DISTANCE`].
pub(super) fn dynamics_distance(a: &Footage, b: &Footage, seed: u64) -> Option<f64> {
    Some(distance(&*dynamics(a, seed)?, &*dynamics(b, seed)?))
}

/// Deviation over time of luma, which is also the dynamics distance to a video that stands still.
pub(super) fn deviation(footage: &Footage, seed: u64) -> Option<f64> {
    Some(dynamics(footage, seed)?.deviation())
}

/// Top left corners of the patches that lie wholly inside; `None` when there are too few.
fn places(footage: &Footage) -> Option<Vec<usize>> {
    let (width, height) = (footage.width(), footage.height());
    let inside = footage.inside();
    let row = |y: usize, x: usize| inside[y * width + x..][..SIDE].iter().all(|&i| i);
    let corners =
        (0..(height + 1).saturating_sub(SIDE)).flat_map(|y| (0..(width + 1).saturating_sub(SIDE)).map(move |x| (y, x)));
    let places: Vec<usize> =
        corners.filter(|&(y, x)| (y..y + SIDE).all(|y| row(y, x))).map(|(y, x)| y * width + x).collect();
    (places.len() >= MIN_PLACES).then_some(places)
}

/// Random (frame, place) pairs, the same for equal footage: one place from every [`SAMPLES`]th part of them, the times
/// spread evenly by steps of the golden ratio, so that lively and quiet places are drawn in proportion.
fn samples(times: usize, places: &[usize], seed: u64) -> impl Iterator<Item = (usize, usize)> {
    let unit = |hash| f64::from(rng::unit(hash));
    let start = unit(rng::hash(seed, &[SAMPLES as u64, 0]));
    (0..SAMPLES).map(move |i| {
        let time = (start + i as f64 * 0.618_033_988_749_894_9).fract() * times as f64;
        let place = (i as f64 + unit(rng::hash(seed, &[i as u64, 1]))) / SAMPLES as f64 * places.len() as f64;
        ((time as usize).min(times - 1), places[(place as usize).min(places.len() - 1)])
    })
}

fn colours(footage: &Footage, seed: u64) -> Option<Arc<Sorted>> {
    footage.colours.get(seed, || Some(Sorted::new(&colour_patches(footage, seed)?, seed)))
}

fn dynamics(footage: &Footage, seed: u64) -> Option<Arc<Sorted>> {
    footage.dynamics.get(seed, || Some(Sorted::new(&moving_patches(footage, seed)?, seed)))
}

fn colour_patches(footage: &Footage, seed: u64) -> Option<Points> {
    let places = places(footage)?;
    let width = footage.width();
    let mut values = Vec::with_capacity(SAMPLES * 3 * SIDE * SIDE);
    for (t, place) in samples(footage.frames().len(), &places, seed) {
        for y in 0..SIDE {
            let row = &footage.frames()[t].data[3 * (place + y * width)..][..3 * SIDE];
            values.extend(row.iter().map(|&v| f32::from(v) / 255.0));
        }
    }
    Some(Points { dimensions: 3 * SIDE * SIDE, values })
}

fn moving_patches(footage: &Footage, seed: u64) -> Option<Points> {
    let places = places(footage)?;
    let (luma, mean, width) = (footage.luma(), footage.mean(), footage.width());
    let times = if footage.loops() { luma.len() } else { (luma.len() + 1).saturating_sub(SIDE) };
    if luma.len() < SIDE {
        return None;
    }
    let mut values = Vec::with_capacity(SAMPLES * SIDE.pow(3));
    for (time, place) in samples(times, &places, seed) {
        for t in (time..time + SIDE).map(|t| t % luma.len()) {
            for at in (0..SIDE).map(|y| place + y * width) {
                let pixels = luma[t].data[at..][..SIDE].iter().zip(&mean.data[at..][..SIDE]);
                values.extend(pixels.map(|(l, m)| l - m));
            }
        }
    }
    Some(Points { dimensions: SIDE.pow(3), values })
}
