//! Patches without a place and places without a patch, equally many, matched without search.
//!
//! Both sets are halved along the feature that varies most, the lower half of one is matched within the lower half of the
//! other, and so on: a k-d tree over two sets at once. However far apart the last ones are, it takes the same time, while
//! searches from place to patch (LazyFluids §4.1) need ever more rounds for ever fewer.

use crate::base::par;
use crate::patch::data::channels::{Layout, MODULATION, Stack};
use crate::patch::data::patches::Place;
use crate::patch::level::Level;

/// Below this size both halves are done on one thread.
const PARALLEL: usize = 4096;

/// A patch: its features, and where it is.
#[derive(Debug, Clone)]
struct Described {
    features: Vec<f32>,
    at: u32,
}

/// Pairs of a target patch and a place, for as many as the shorter list has.
pub(super) fn matched(level: &Level, targets: Vec<u32>, places: Vec<Place>) -> Vec<(u32, Place)> {
    let n = targets.len().min(places.len());
    let describe = |stack: &Stack, at: u32| Described { features: features(level.layout, stack, at as usize), at };
    let mut targets = par::map(n, |i| describe(&level.target.stack, targets[i]));
    let mut places = par::map(n, |i| describe(&level.source.stack, places[i].0));
    halve(&mut targets, &mut places);
    targets.iter().zip(&places).map(|(t, p)| (t.at, Place(p.at))).collect()
}

/// Mean, slope across and slope down of every channel, weighted such that squared differences are distances.
fn features(layout: &Layout, stack: &Stack, centre: usize) -> Vec<f32> {
    let (radius, channels) = (layout.radius() as isize, stack.channels);
    let mut sums = vec![0.0; 3 * channels];
    for dy in -radius..=radius {
        for dx in -radius..=radius {
            let pixel = stack.pixel((centre as isize + dy * stack.width as isize + dx) as usize);
            for (c, &v) in pixel.iter().enumerate() {
                let v = f32::from(v);
                sums[3 * c] += v;
                sums[3 * c + 1] += v * dx as f32;
                sums[3 * c + 2] += v * dy as f32;
            }
        }
    }
    let side = layout.side() as f32;
    let slope_norm = (-radius..=radius).map(|d| (d * d) as f32).sum::<f32>() * side;
    let weights = layout.weights(MODULATION);
    for (i, sum) in sums.iter_mut().enumerate() {
        let norm = if i % 3 == 0 { side * side } else { slope_norm };
        *sum *= (f32::from(weights[i / 3]) / norm).sqrt();
    }
    sums
}

/// Orders both lists such that equal numbers belong together.
fn halve(targets: &mut [Described], places: &mut [Described]) {
    let n = targets.len();
    if n < 2 {
        return;
    }
    let axis = widest(targets, places);
    let middle = n / 2;
    let order = |a: &Described, b: &Described| a.features[axis].total_cmp(&b.features[axis]).then(a.at.cmp(&b.at));
    targets.select_nth_unstable_by(middle, order);
    places.select_nth_unstable_by(middle, order);
    let (t, p) = (targets.split_at_mut(middle), places.split_at_mut(middle));
    if n < PARALLEL {
        halve(t.0, p.0);
        halve(t.1, p.1);
    } else {
        par::join(|| halve(t.0, p.0), || halve(t.1, p.1));
    }
}

/// The feature with the greatest variance over both lists.
fn widest(targets: &[Described], places: &[Described]) -> usize {
    let count = targets[0].features.len();
    let mut sums = vec![(0.0f64, 0.0f64); count];
    for described in targets.iter().chain(places.iter()) {
        for (s, &f) in sums.iter_mut().zip(&described.features) {
            let f = f64::from(f);
            *s = (s.0 + f, s.1 + f * f);
        }
    }
    let n = 2.0 * targets.len() as f64;
    let variance = |i: usize| sums[i].1 - sums[i].0 * sums[i].0 / n;
    (0..count).max_by(|&a, &b| variance(a).total_cmp(&variance(b))).unwrap_or(0)
}
