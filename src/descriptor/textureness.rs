//! Strength of texture per scale: a four-level Laplacian scale space, not decimated, averaged over frames
//! (Okabe et al. 2011, §5.2 and Fig. 7).

use macro_rules_attribute::apply;

use crate::base::instructions::kernel;
use crate::raster::image::Plane;

/// Levels of the scale space, fine to coarse.
pub const LEVELS: usize = 4;

/// Sums of the absolute Laplacian per pixel and level.
///
/// Level k is the difference of two successive smoothings with the cubic B-spline (1, 4, 6, 4, 1)/16, its taps 2ᵏ
/// pixels apart: Burt & Adelson's pyramid without its decimation. Borders are clamped.
#[derive(Debug, Clone, PartialEq)]
pub struct Textureness {
    sums: [Plane; LEVELS],
    frames: usize,
    padded: Vec<f32>,
    narrow: Plane,
    smooth: [Plane; 2],
}

impl Textureness {
    /// No frames yet, for frames of `width` × `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        let plane = || Plane::zeros(width, height);
        Self {
            sums: std::array::from_fn(|_| plane()),
            frames: 0,
            padded: vec![0.0; width + 4 * (1 << (LEVELS - 1))],
            narrow: plane(),
            smooth: [plane(), plane()],
        }
    }

    /// Adds a frame's luma, in [0, 1].
    ///
    /// # Panics
    /// When its size differs.
    pub fn add(&mut self, luma: &Plane) {
        assert_eq!((luma.width, luma.height), (self.narrow.width, self.narrow.height));
        let [a, b] = &mut self.smooth;
        a.data.copy_from_slice(&luma.data);
        for (level, sum) in self.sums.iter_mut().enumerate() {
            let step = 1 << level;
            for y in 0..a.height {
                smooth_row(a.row(y), step, &mut self.padded, self.narrow.row_mut(y));
            }
            for y in 0..a.height {
                let row = |offset: isize| {
                    let y = (y as isize + offset * step as isize).clamp(0, a.height as isize - 1);
                    self.narrow.row(y as usize)
                };
                let rows = [row(-2), row(-1), row(0), row(1), row(2)];
                smooth_column(rows, a.row(y), b.row_mut(y), sum.row_mut(y));
            }
            std::mem::swap(a, b);
        }
        self.frames += 1;
    }

    /// Takes over the sums of `other`, which saw other frames of the same clip.
    pub fn merge(&mut self, other: &Self) {
        for (mine, theirs) in self.sums.iter_mut().zip(&other.sums) {
            mine.data.iter_mut().zip(&theirs.data).for_each(|(a, b)| *a += b);
        }
        self.frames += other.frames;
    }

    /// Mean absolute Laplacian per level at pixel `(x, y)`, fine to coarse, of luma in [0, 1].
    pub fn at(&self, x: usize, y: usize) -> [f32; LEVELS] {
        self.cell(x, y, 1)
    }

    /// Its mean over the square of `side` pixels at `(x, y)`.
    pub fn cell(&self, x: usize, y: usize, side: usize) -> [f32; LEVELS] {
        let scale = 1.0 / (self.frames.max(1) * side * side) as f32;
        self.sums.each_ref().map(|sum| (y..y + side).map(|y| mirror_sum(&sum.row(y)[x..x + side])).sum::<f32>() * scale)
    }
}

/// Sum of a short row, first with last and so on inwards: the same for the mirrored row, to the last bit.
pub(crate) fn mirror_sum(row: &[f32]) -> f32 {
    let n = row.len();
    let pairs: f32 = (0..n / 2).map(|i| row[i] + row[n - 1 - i]).sum();
    if n % 2 == 1 { pairs + row[n / 2] } else { pairs }
}

/// B-spline along a row, taps `step` apart; `padded` holds at least `row.len() + 4 * step` values.
#[apply(kernel)]
fn smooth_row(row: &[f32], step: usize, padded: &mut [f32], out: &mut [f32]) {
    let n = row.len();
    let padded = &mut padded[..n + 4 * step];
    padded[..2 * step].fill(row[0]);
    padded[2 * step..2 * step + n].copy_from_slice(row);
    padded[2 * step + n..].fill(row[n - 1]);
    let (a, b, c) = (&padded[..n], &padded[step..step + n], &padded[2 * step..2 * step + n]);
    let (d, e) = (&padded[3 * step..3 * step + n], &padded[4 * step..4 * step + n]);
    let out = &mut out[..n];
    for i in 0..n {
        out[i] = 0.375 * c[i] + 0.25 * (b[i] + d[i]) + 0.0625 * (a[i] + e[i]);
    }
}

/// B-spline across rows into `out`; adds what the smoothing took away from `before` to `sum`, absolutely.
#[apply(kernel)]
fn smooth_column(rows: [&[f32]; 5], before: &[f32], out: &mut [f32], sum: &mut [f32]) {
    let n = out.len();
    let [a, b, c, d, e] = rows.map(|row| &row[..n]);
    let (before, sum) = (&before[..n], &mut sum[..n]);
    for i in 0..n {
        let value = 0.375 * c[i] + 0.25 * (b[i] + d[i]) + 0.0625 * (a[i] + e[i]);
        out[i] = value;
        sum[i] += (before[i] - value).abs();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    fn of(plane: &Plane) -> Textureness {
        let mut textureness = Textureness::new(plane.width, plane.height);
        textureness.add(plane);
        textureness
    }

    #[test]
    fn flat_has_none_and_stripes_sit_in_the_level_of_their_width() {
        assert_eq!(of(&Plane::filled(48, 48, 0.5)).cell(0, 0, 48), [0.0; LEVELS]);
        let level_of = |period: f32| {
            let wave = |x: usize| 0.5 + 0.5 * (std::f32::consts::TAU * (x as f32 + 0.5) / period).sin();
            let cell = of(&Plane::from_fn(256, 64, |x, _| wave(x))).cell(96, 0, 64);
            (0..LEVELS).max_by(|a, b| cell[*a].total_cmp(&cell[*b])).unwrap()
        };
        assert_eq!([2.0, 6.0, 12.0, 24.0].map(level_of), [0, 1, 2, 3]);
    }

    #[test]
    fn a_mirrored_frame_gives_mirrored_values_exactly() {
        let noise = Plane::from_fn(40, 24, |x, y| rng::unit(rng::hash(3, &[x as u64, y as u64])));
        let mirrored = Plane::from_fn(40, 24, |x, y| noise.at(39 - x, y));
        let (a, b) = (of(&noise), of(&mirrored));
        for (x, y) in [(0, 0), (4, 8), (36, 20)] {
            assert_eq!(a.cell(x, y, 4), b.cell(36 - x, y, 4));
        }
    }

    #[test]
    fn contrast_scales_it_and_merging_averages() {
        let noise = Plane::from_fn(32, 32, |x, y| rng::unit(rng::hash(5, &[x as u64, y as u64])));
        let mut half = of(&noise.map(|v| 0.5 * v));
        let full = of(&noise);
        half.merge(&full);
        for (mean, full) in half.cell(8, 8, 4).iter().zip(full.cell(8, 8, 4)) {
            assert!((mean - 0.75 * full).abs() < 1e-6);
        }
    }
}
