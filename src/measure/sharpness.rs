//! How much fine detail there is, and whether it lasts.

use super::definition::{Better, Measure};
use super::footage::{Footage, spread};
use super::subject::Subject;
use crate::base::par;
use crate::raster::image::Plane;

/// Frames looked at.
const FRAMES: usize = 32;

/// Detail kept.
pub const SHARPNESS_RETENTION: Measure = Measure {
    name: "sharpness retention",
    unit: "ratio",
    definition: "energy of the Laplacian of a frame over that of the picture (or reference), mean over frames",
    needs: "picture or reference",
    better: Better::One,
    compute: |subject| {
        let ratios = ratios(subject)?;
        Some(ratios.iter().map(|r| r.1).sum::<f64>() / ratios.len() as f64)
    },
};

/// Wash-out.
pub const SHARPNESS_SLOPE: Measure = Measure {
    name: "sharpness slope",
    unit: "1/s",
    definition: "slope over time of the sharpness retention, by least squares",
    needs: "picture or reference, 2 frames",
    better: Better::Zero,
    compute: |subject| slope(&ratios(subject)?),
};

/// Seconds and retention of the frames looked at.
fn ratios(subject: &Subject) -> Option<Vec<(f64, f64)>> {
    let footage = subject.footage;
    let frames = spread(footage.frames().len(), FRAMES);
    let seconds = frames.iter().map(|&t| t as f64 / f64::from(footage.fps()));
    Some(seconds.zip(at(subject, &frames)?).collect())
}

/// Retention of some frames.
pub(super) fn at(subject: &Subject, frames: &[usize]) -> Option<Vec<f64>> {
    let target = subject.appearance()?;
    let targets = spread(target.frames().len(), FRAMES);
    let whole = par::map(targets.len(), |i| energy(target, targets[i])).iter().sum::<f64>() / targets.len() as f64;
    (whole > 0.0).then(|| par::map(frames.len(), |i| energy(subject.footage, frames[i]) / whole))
}

/// Mean squared Laplacian (five points) of a frame's luma inside the matte.
fn energy(footage: &Footage, t: usize) -> f64 {
    let luma = &footage.luma()[t];
    let (mut sum, mut count) = (0.0, 0usize);
    for y in 1..luma.height.saturating_sub(1) {
        for x in (1..luma.width.saturating_sub(1)).filter(|x| footage.inside()[y * luma.width + x]) {
            sum += f64::from(laplacian_at(luma, x, y)).powi(2);
            count += 1;
        }
    }
    sum / count.max(1) as f64
}

fn laplacian_at(luma: &Plane, x: usize, y: usize) -> f32 {
    4.0 * luma.at(x, y) - luma.at(x - 1, y) - luma.at(x + 1, y) - luma.at(x, y - 1) - luma.at(x, y + 1)
}

/// Slope of y over x by least squares; `None` when all x are the same.
fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let (mx, my) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let xx: f64 = points.iter().map(|p| (p.0 - mx).powi(2)).sum();
    let xy: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    (xx > 0.0).then(|| xy / xx)
}
