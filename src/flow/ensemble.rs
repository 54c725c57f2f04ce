//! Speed of a texture by ensemble correlation: the shift at which a window of every frame resembles the next frame best,
//! over many frames at once (Meinhart, Wereley & Santiago 2000, "A PIV algorithm for estimating time-averaged velocity
//! fields").
//!
//! Dense optical flow sees hardly any motion in whitewater, which is another picture a frame later; the little that two
//! neighbouring frames share adds up over frames, the rest does not.

use macro_rules_attribute::apply;

use crate::base::instructions::kernel;
use crate::raster::image::Plane;

/// A shift and how sure it is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shift {
    /// Motion, pixels per frame, to a fraction of a pixel.
    pub motion: (f32, f32),
    /// Correlation there, −1 to 1.
    pub correlation: f32,
}

/// The shift of the window of `side` pixels about `(x, y)`, centres at ½, from each frame to the next, `reach` pixels at
/// most each way. The window is moved so that it finds `reach` all around it; `None` in frames too small for that, and
/// where nothing moves. Frames should have mean 0 over time.
pub fn shift(frames: &[Plane], (x, y): (f32, f32), side: usize, reach: usize) -> Option<Shift> {
    let first = frames.first()?;
    let corner = |centre: f32, size: usize| {
        let last = size.checked_sub(side + reach).filter(|&last| last >= reach)?;
        Some(((centre - 0.5 * side as f32).round().max(0.0) as usize).clamp(reach, last))
    };
    let (x, y) = (corner(x, first.width)?, corner(y, first.height)?);
    let across = 2 * reach + 1;
    let sums: Vec<f32> =
        (0..across * across).map(|i| resemblance(frames, (x, y), side, (i % across, i / across), reach)).collect();
    let best = (0..sums.len()).max_by(|&a, &b| sums[a].total_cmp(&sums[b]).then(b.cmp(&a)))?;
    let (bx, by) = (best % across, best / across);
    let at = |x: usize, y: usize| sums[y * across + x];
    let offset = |v: usize, of: &dyn Fn(usize) -> f32| {
        if v == 0 || v + 1 == across { 0.0 } else { summit(of(v - 1), of(v), of(v + 1)) }
    };
    let u = bx as f32 - reach as f32 + offset(bx, &|x| at(x, by));
    let v = by as f32 - reach as f32 + offset(by, &|y| at(bx, y));
    (sums[best] > 0.0).then_some(Shift { motion: (u, v), correlation: sums[best] })
}

/// Correlation of a window at `(x, y)` of every frame with that of the next frame, `(dx, dy)` less `reach` farther.
fn resemblance(frames: &[Plane], (x, y): (usize, usize), side: usize, (dx, dy): (usize, usize), reach: usize) -> f32 {
    let mut sums = [0.0f64; 3];
    for pair in frames.windows(2) {
        for j in 0..side {
            let from = &pair[0].row(y + j)[x..x + side];
            let to = &pair[1].row(y + j + dy - reach)[x + dx - reach..][..side];
            sums.iter_mut().zip(products(from, to)).for_each(|(sum, p)| *sum += f64::from(p));
        }
    }
    (sums[0] / (sums[1] * sums[2]).sqrt().max(1e-9)) as f32
}

/// Sums of `a b`, `a a` and `b b`.
#[apply(kernel)]
fn products(a: &[f32], b: &[f32]) -> [f32; 3] {
    const LANES: usize = 8;
    let mut sums = [[0.0f32; LANES]; 3];
    for (a, b) in a.chunks_exact(LANES).zip(b.chunks_exact(LANES)) {
        for k in 0..LANES {
            sums[0][k] += a[k] * b[k];
            sums[1][k] += a[k] * a[k];
            sums[2][k] += b[k] * b[k];
        }
    }
    sums.map(|lanes| lanes.iter().sum())
}

/// Where the parabola through three values, one apart, is highest, from the middle one.
fn summit(before: f32, at: f32, after: f32) -> f32 {
    let bend = before - 2.0 * at + after;
    if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{hash, unit};
    use crate::raster::filter::gaussian;

    /// Noise that moves by `(u, v)` a frame, and of which in every frame the share `new` is another one.
    fn frames((u, v): (f32, f32), new: f32) -> Vec<Plane> {
        let noise =
            |seed: u64| gaussian(&Plane::from_fn(160, 140, |x, y| unit(hash(seed, &[x as u64, y as u64])) - 0.5), 1.2);
        let still = noise(1);
        let frame = |t: usize| {
            let other = noise(2 + t as u64);
            Plane::from_fn(96, 80, |x, y| {
                let (px, py) = (x as f32 + 40.5 - u * t as f32, y as f32 + 30.5 - v * t as f32);
                (1.0 - new) * still.bilinear(px, py) + new * other.at(x, y)
            })
        };
        (0..16).map(frame).collect()
    }

    #[test]
    fn motion_is_found_to_a_fraction_and_through_noise() {
        for (motion, new) in [((2.0, -1.0), 0.0), ((-0.4, 1.3), 0.0), ((1.5, 1.0), 0.6)] {
            let found = shift(&frames(motion, new), (48.0, 40.0), 32, 6).unwrap();
            let (u, v) = (found.motion.0 - motion.0, found.motion.1 - motion.1);
            assert!(u.hypot(v) < 0.25, "{found:?} for {motion:?}");
            assert!(if new == 0.0 { found.correlation > 0.8 } else { found.correlation < 0.6 }, "{found:?}");
        }
    }

    #[test]
    fn nothing_is_found_in_nothing_or_in_frames_too_small() {
        assert_eq!(shift(&vec![Plane::zeros(96, 80); 4], (48.0, 40.0), 32, 6), None);
        assert_eq!(shift(&vec![Plane::filled(40, 80, 0.1); 4], (20.0, 40.0), 32, 6), None);
        assert_eq!(shift(&[], (20.0, 40.0), 32, 6), None);
    }
}
