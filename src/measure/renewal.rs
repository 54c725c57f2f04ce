//! How long forms last, wherever they go: what tells fluid from a picture that slides.

use super::footage::{Footage, spread};
use crate::base::{par, rng};
use crate::raster::image::Plane;
use crate::raster::pyramid::{collapse, laplacian, reduce};

/// After so long forms are looked for again, frames at 25 a second.
const LAGS: [f32; 2] = [4.0, 12.0];
/// Side of a window and how far it is looked for, pixels of the halved frame.
const SIDE: usize = 16;
const REACH: usize = 24;
/// Bands of the halved frame that are looked at: coarser forms are light and shade.
const BANDS: usize = 3;
/// Frames that windows are taken from, and windows in each.
const FRAMES: usize = 6;
const WINDOWS: u64 = 48;
/// Deviation in a window below which there are no forms to find.
const FLAT: f32 = 2e-3;

/// Per lag, the mean over windows of the largest correlation with any window up to 48 pixels away after that time: 1 for
/// what stands still or slides, less the more is new. `None` when the video is too short, or flat.
pub(super) fn kept(footage: &Footage, seed: u64) -> Option<[f64; LAGS.len()]> {
    let kept = footage.kept.get(seed, || {
        let values: Option<Vec<f64>> =
            LAGS.iter().map(|lag| after(footage, lag * footage.fps() / 25.0, seed)).collect();
        values?.try_into().ok()
    });
    kept.map(|kept| *kept)
}

fn after(footage: &Footage, lag: f32, seed: u64) -> Option<f64> {
    let (lag, luma) = ((lag.round() as usize).max(1), footage.luma());
    let starts = spread(luma.len().checked_sub(lag).filter(|count| *count > 0)?, FRAMES);
    let corners = corners(footage);
    if corners.is_empty() {
        return None;
    }
    let found = par::map(starts.len(), |k| {
        let forms = |t: usize| collapse(&laplacian(&reduce(&luma[t]), BANDS).0, None);
        let (from, to) = (forms(starts[k]), forms(starts[k] + lag));
        let corner = |w: u64| corners[rng::below(rng::hash(seed, &[k as u64, w]), corners.len() as u64) as usize];
        (0..WINDOWS).filter_map(|w| largest(&from, &to, corner(w))).fold((0.0, 0usize), |(sum, n), v| (sum + v, n + 1))
    });
    let (sum, count) = found.iter().fold((0.0, 0), |(sum, count), f| (sum + f.0, count + f.1));
    (count > 0).then(|| sum / count as f64)
}

/// Top left corners of the windows that lie wholly inside, on the halved frame.
fn corners(footage: &Footage) -> Vec<(usize, usize)> {
    let (width, inside) = (footage.width(), footage.inside());
    let (w, h) = (footage.width() / 2, footage.height() / 2);
    let all = (0..(h + 1).saturating_sub(SIDE)).step_by(4);
    let all = all.flat_map(|y| (0..(w + 1).saturating_sub(SIDE)).step_by(4).map(move |x| (x, y)));
    let within = |&(x, y): &(usize, usize)| {
        let at = |dx: usize, dy: usize| inside[2 * (y + dy) * width + 2 * (x + dx)];
        (0..SIDE).step_by(3).all(|dy| (0..SIDE).step_by(3).all(|dx| at(dx, dy)))
    };
    all.filter(within).collect()
}

/// The largest correlation of a window with one near it in another frame; `None` where there are no forms.
fn largest(from: &Plane, to: &Plane, (x, y): (usize, usize)) -> Option<f64> {
    let mut window = [0.0f32; SIDE * SIDE];
    for (j, row) in window.chunks_exact_mut(SIDE).enumerate() {
        row.copy_from_slice(&from.row(y + j)[x..x + SIDE]);
    }
    let area = (SIDE * SIDE) as f32;
    let mean = window.iter().sum::<f32>() / area;
    window.iter_mut().for_each(|v| *v -= mean);
    let power = window.iter().map(|v| v * v).sum::<f32>();
    if power < area * FLAT * FLAT {
        return None;
    }
    let range = |v: usize, size: usize| v.saturating_sub(REACH)..(v + REACH + 1).min(size - SIDE + 1);
    let mut best = 0.0f32;
    for py in range(y, to.height) {
        for px in range(x, to.width) {
            let (mut dot, mut sum, mut square) = ([0.0f32; SIDE], [0.0f32; SIDE], [0.0f32; SIDE]);
            for (j, row) in window.chunks_exact(SIDE).enumerate() {
                let other = &to.row(py + j)[px..px + SIDE];
                for i in 0..SIDE {
                    dot[i] += row[i] * other[i];
                    sum[i] += other[i];
                    square[i] += other[i] * other[i];
                }
            }
            let [dot, sum, square] = [dot, sum, square].map(|v| v.iter().sum::<f32>());
            let other = square - sum * sum / area;
            if other > 0.0 {
                best = best.max(dot / (power * other).sqrt());
            }
        }
    }
    Some(f64::from(best.min(1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{hash, unit};
    use crate::raster::image::{Color, Rgb8};

    fn video(value: impl Fn(usize, usize, usize) -> f32) -> Footage {
        let frame = |t: usize| {
            let grey = Plane::from_fn(128, 96, |x, y| value(t, x, y));
            Color::from_planes(std::array::from_fn(|_| grey.clone())).to_rgb8()
        };
        Footage::new((0..24).map(frame).collect::<Vec<Rgb8>>(), 25.0, false, None).unwrap()
    }

    #[test]
    fn what_stands_or_slides_is_found_again_and_what_is_new_is_not() {
        let noise = |seed: u64, x: usize, y: usize| unit(hash(seed, &[x as u64 / 6, y as u64 / 6]));
        let still = kept(&video(|_, x, y| noise(1, x, y)), 1).unwrap();
        let slides = kept(&video(|t, x, y| noise(1, x + 200 - 2 * t, y)), 1).unwrap();
        let renews = kept(&video(|t, x, y| noise(1 + t as u64, x, y)), 1).unwrap();
        // Some windows slide out of the frame.
        assert!(still.iter().all(|v| *v > 0.99) && slides.iter().all(|v| *v > 0.8), "{still:?} {slides:?}");
        assert!(renews.iter().all(|v| *v < 0.6), "{renews:?}");
        assert_eq!(kept(&video(|_, _, _| 0.5), 1), None);
    }
}
