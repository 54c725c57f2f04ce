//! Appearance matching: frames with the picture's own distribution of detail, place by place (Heeger & Bergen 1995;
//! Okabe et al. 2011, §6).
//!
//! Luma is matched, not colour: differences are laid along the picture's own slope of colour over luma, so the frames
//! have its colours already. For each region of a regular grid and each Laplacian band, a curve takes the frames' values
//! to the picture's values of equal rank; another does so for pixels. The curves are learned once, on frames from all
//! over the loop (one's own for every frame would flicker), only from inside the matte, and are interpolated between the
//! centres of regions (each for itself would show as a grid).

use std::borrow::Cow;

use super::layout::BANDS;
use crate::base::par;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::raster::pyramid::{collapse, laplacian, reduce};

/// Rounds of matching: bands change pixels, and pixels bands.
const ROUNDS: usize = 2;
/// Points of a curve.
const KNOTS: usize = 65;
/// Bins of a histogram, a whole number to each step between knots.
const BINS: usize = (KNOTS - 1) * 8;
/// Weight, in pixels, of all regions together in the histogram of one: small regions know little of themselves.
const PRIOR: f32 = 200.0;
/// Most that the value of a pixel is moved by its own curve, in [0, 1].
const MAX_SHIFT: f32 = 0.06;
/// Window over which values inside the matte are spread outwards, pixels of the working image.
const SPREAD: f32 = 6.0;

/// How far frames are brought to the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Matching {
    /// Share of the change that is made, 0 to 1.
    pub amount: f32,
    /// Side of a region, pixels of the working image.
    pub region: usize,
    /// Largest factor on the values of a band, and one over the smallest.
    pub max_gain: f32,
}

/// Luma of one frame, at working size.
#[derive(Debug, Clone)]
pub struct Sample<'a> {
    /// What differences are added to; outside the matte what is inside must go on ([`spread`]).
    pub base: Cow<'a, Plane>,
    /// The differences.
    pub differences: Plane,
}

/// Learned curves.
#[derive(Debug, Clone, PartialEq)]
pub struct Appearance {
    /// The matte at every band.
    mattes: Vec<Plane>,
    region: usize,
    bands: Vec<Curves>,
    pixels: Curves,
}

impl Appearance {
    /// Learns from the luma of the picture and from some frames spread over the loop; all planes at working size.
    pub fn learn(picture: &Plane, matte: &Plane, samples: &[Sample], matching: &Matching) -> Self {
        let mut mattes = vec![matte.clone()];
        (1..BANDS).for_each(|k| mattes.push(reduce(&mattes[k - 1])));
        let picture = spread(picture, matte);
        let (wanted, _) = laplacian(&picture, BANDS);
        let size = (matte.width.div_ceil(matching.region).max(1), matte.height.div_ceil(matching.region).max(1));
        let bands = wanted.iter().map(|b| Curves::identity(size, extent(b))).collect();
        let pixels = Curves::identity(size, (0.0, 1.0));
        let mut out = Self { mattes, region: matching.region, bands, pixels };
        for _ in 0..ROUNDS {
            let made = par::map(samples.len(), |i| out.detailed(&samples[i]));
            let bands = par::map(BANDS, |k| {
                let of: Vec<&Plane> = made.iter().map(|m| &m.0[k]).collect();
                out.bands[k]
                    .then(&of, &wanted[k], &out.mattes[k], out.scale(k), |x, y| bounded(x, y, matching.max_gain))
            });
            out.bands = bands;
            let made = par::map(samples.len(), |i| out.collapsed(&samples[i]));
            let of: Vec<&Plane> = made.iter().collect();
            out.pixels =
                out.pixels.then(&of, &picture, matte, out.scale(0), |x, y| y.clamp(x - MAX_SHIFT, x + MAX_SHIFT));
        }
        out.bands
            .iter_mut()
            .chain([&mut out.pixels])
            .for_each(|c| c.offsets.iter_mut().for_each(|o| *o *= matching.amount));
        out
    }

    /// The differences of one frame, matched; where the matte is 0 they stay as they are.
    pub fn apply(&self, sample: &Sample) -> Plane {
        let mut luma = self.collapsed(sample);
        self.pixels.apply(&mut luma, &self.mattes[0], self.scale(0));
        let matte = &self.mattes[0];
        let pixels = luma.data.iter().zip(&sample.base.data).zip(&matte.data).zip(&sample.differences.data);
        let data = pixels.map(|(((l, b), m), d)| if *m > 0.0 { l - b } else { *d }).collect();
        Plane::from_vec(luma.width, luma.height, data)
    }

    /// A frame's bands after their curves, and its rest.
    fn detailed(&self, sample: &Sample) -> (Vec<Plane>, Plane) {
        let mut luma = Plane::clone(&sample.base);
        for ((l, d), m) in luma.data.iter_mut().zip(&sample.differences.data).zip(&self.mattes[0].data) {
            *l += if *m > 0.0 { *d } else { 0.0 };
        }
        let (mut bands, rest) = laplacian(&luma, BANDS);
        for (k, band) in bands.iter_mut().enumerate() {
            self.bands[k].apply(band, &self.mattes[k], self.scale(k));
        }
        (bands, rest)
    }

    fn collapsed(&self, sample: &Sample) -> Plane {
        let (bands, rest) = self.detailed(sample);
        collapse(&bands, Some(&rest))
    }

    /// Regions per pixel of a band.
    fn scale(&self, band: usize) -> f32 {
        (1 << band) as f32 / self.region as f32
    }
}

/// `y`, but no more than `gain` times `x` and no less than one over it.
fn bounded(x: f32, y: f32, gain: f32) -> f32 {
    let (a, b) = (x / gain, x * gain);
    y.clamp(a.min(b), a.max(b))
}

/// Range of values that a curve is drawn over: twice the largest magnitude.
fn extent(plane: &Plane) -> (f32, f32) {
    let largest = plane.data.iter().fold(0.02f32, |m, v| m.max(v.abs()));
    (-2.0 * largest, 2.0 * largest)
}

/// The plane inside the matte, and outside of it a blur of what is inside.
pub fn spread(plane: &Plane, matte: &Plane) -> Plane {
    const FAINT: f32 = 1e-4;
    let inside =
        Plane::from_vec(plane.width, plane.height, plane.data.iter().zip(&matte.data).map(|(p, m)| p * m).collect());
    let total = matte.data.iter().sum::<f32>().max(FAINT);
    let mean = inside.data.iter().sum::<f32>() / total;
    let (sum, weight) = (gaussian(&inside, SPREAD), gaussian(matte, SPREAD));
    let value = |i: usize| {
        if matte.data[i] > 0.0 { plane.data[i] } else { (sum.data[i] + FAINT * mean) / (weight.data[i] + FAINT) }
    };
    Plane::from_vec(plane.width, plane.height, (0..plane.data.len()).map(value).collect())
}

/// Between the first two values.
fn between(values: &[f32], share: f32) -> f32 {
    values[0] + share * (values[1] - values[0])
}

/// A curve per region, as what is added to a value, at equally spaced values.
#[derive(Debug, Clone, PartialEq)]
struct Curves {
    /// Regions across and down.
    size: (usize, usize),
    low: f32,
    step: f32,
    /// `KNOTS` of each region, row by row.
    offsets: Vec<f32>,
}

/// The four regions around a pixel with their weights.
struct Around {
    regions: [usize; 4],
    weights: [f32; 4],
}

impl Curves {
    fn identity(size: (usize, usize), (low, high): (f32, f32)) -> Self {
        let step = (high - low) / (KNOTS - 1) as f32;
        Self { size, low, step, offsets: vec![0.0; size.0 * size.1 * KNOTS] }
    }

    /// The regions whose centres are nearest to the centre of pixel `(x, y)`, `scale` regions per pixel.
    fn around(&self, x: usize, y: usize, scale: f32) -> Around {
        let axis = |v: usize, size: usize| {
            let place = ((v as f32 + 0.5) * scale - 0.5).clamp(0.0, (size - 1) as f32);
            let first = place as usize;
            (first, (first + 1).min(size - 1), place - first as f32)
        };
        let ((x0, x1, ax), (y0, y1, ay)) = (axis(x, self.size.0), axis(y, self.size.1));
        let at = |x: usize, y: usize| y * self.size.0 + x;
        Around {
            regions: [at(x0, y0), at(x1, y0), at(x0, y1), at(x1, y1)],
            weights: [(1.0 - ax) * (1.0 - ay), ax * (1.0 - ay), (1.0 - ax) * ay, ax * ay],
        }
    }

    /// What `region` adds to `value`; beyond the ends as much as there.
    fn offset(&self, region: usize, value: f32) -> f32 {
        let (first, share) = self.knot(value);
        between(&self.offsets[region * KNOTS + first..], share)
    }

    /// The knot below a value, and how far the value is on the way to the next.
    fn knot(&self, value: f32) -> (usize, f32) {
        let place = ((value - self.low) / self.step).clamp(0.0, (KNOTS - 1) as f32);
        let first = (place as usize).min(KNOTS - 2);
        (first, place - first as f32)
    }

    fn apply(&self, plane: &mut Plane, matte: &Plane, scale: f32) {
        let width = plane.width;
        for (y, (row, matte)) in plane.data.chunks_exact_mut(width).zip(matte.data.chunks_exact(width)).enumerate() {
            for (x, (v, m)) in row.iter_mut().zip(matte).enumerate().filter(|(_, (_, m))| **m > 0.0) {
                let Around { regions, weights } = self.around(x, y, scale);
                let (first, share) = self.knot(*v);
                let offset = |r: usize| between(&self.offsets[r * KNOTS + first..], share);
                *v += m * regions.iter().zip(weights).map(|(&r, w)| w * offset(r)).sum::<f32>();
            }
        }
    }

    /// These curves followed by those that take `made` to `wanted`, within `bound(x, y)` of where they start from.
    fn then(
        &self,
        made: &[&Plane],
        wanted: &Plane,
        matte: &Plane,
        scale: f32,
        bound: impl Fn(f32, f32) -> f32,
    ) -> Self {
        let (from, to) = (self.histograms(made, matte, scale), self.histograms(&[wanted], matte, scale));
        let mut out = self.clone();
        for region in 0..self.size.0 * self.size.1 {
            let (from, to) = (&from[region * BINS..][..BINS], &to[region * BINS..][..BINS]);
            for knot in 0..KNOTS {
                let x = self.low + knot as f32 * self.step;
                let now = x + self.offset(region, x);
                let place = ((now - self.low) / self.step * (BINS / (KNOTS - 1)) as f32).clamp(0.0, BINS as f32);
                let matched = self.low + inverse(to, rank(from, place)) * self.step / (BINS / (KNOTS - 1)) as f32;
                out.offsets[region * KNOTS + knot] = bound(x, matched) - x;
            }
        }
        out
    }

    /// Of each region the weights of its values, as a running sum that ends at 1.
    fn histograms(&self, planes: &[&Plane], matte: &Plane, scale: f32) -> Vec<f32> {
        let mut counts = vec![0.0f32; self.size.0 * self.size.1 * BINS];
        let bins = (BINS / (KNOTS - 1)) as f32 / self.step;
        for plane in planes {
            for (i, v) in plane.data.iter().enumerate().filter(|(i, _)| matte.data[*i] > 0.0) {
                let bin = (((v - self.low) * bins).max(0.0) as usize).min(BINS - 1);
                let around = self.around(i % plane.width, i / plane.width, scale);
                let weighted = around.regions.iter().zip(around.weights);
                weighted.for_each(|(r, w)| counts[r * BINS + bin] += w * matte.data[i]);
            }
        }
        let mut all = vec![0.0f32; BINS];
        counts.chunks_exact(BINS).for_each(|c| all.iter_mut().zip(c).for_each(|(a, c)| *a += c));
        let total = all.iter().sum::<f32>().max(1e-6);
        let prior = PRIOR * scale * scale * planes.len() as f32 / total;
        for region in counts.chunks_exact_mut(BINS) {
            region.iter_mut().zip(&all).for_each(|(c, a)| *c += prior * a);
            let total = region.iter().sum::<f32>().max(1e-9);
            let mut sum = 0.0;
            region.iter_mut().for_each(|c| {
                sum += *c / total;
                *c = sum;
            });
        }
        counts
    }
}

/// Share of the values below `place`, in bins.
fn rank(sums: &[f32], place: f32) -> f32 {
    let bin = (place as usize).min(sums.len() - 1);
    let before = if bin == 0 { 0.0 } else { sums[bin - 1] };
    before + (place - bin as f32) * (sums[bin] - before)
}

/// Place, in bins, below which there is the share `rank` of the values.
fn inverse(sums: &[f32], rank: f32) -> f32 {
    let bin = sums.partition_point(|s| *s < rank).min(sums.len() - 1);
    let before = if bin == 0 { 0.0 } else { sums[bin - 1] };
    bin as f32 + ((rank - before) / (sums[bin] - before).max(1e-9)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    const SIZE: usize = 128;

    fn noise(seed: u64, contrast: impl Fn(usize) -> f32) -> Plane {
        let at = |x: usize, y: usize| rng::unit(rng::hash(seed, &[x as u64, y as u64])) - 0.5;
        Plane::from_fn(SIZE, SIZE, |x, y| contrast(x) * at(x, y))
    }

    /// A picture of rising contrast, a flat base, differences of constant contrast, a matte without its left quarter.
    fn learn(amount: f32, change_outside: f32) -> (Appearance, Vec<Sample<'static>>, Plane) {
        let outside = |x: usize, v: f32| if x < SIZE / 4 { v + change_outside } else { v };
        let rising = noise(1, |x| 0.1 + 0.3 * x as f32 / SIZE as f32);
        let picture = Plane::from_fn(SIZE, SIZE, |x, y| outside(x, 0.5 + rising.at(x, y)));
        let matte = Plane::from_fn(SIZE, SIZE, |x, _| if x < SIZE / 4 { 0.0 } else { 1.0 });
        let base = Plane::from_fn(SIZE, SIZE, |x, _| outside(x, 0.5));
        let base = spread(&base, &matte);
        let sample = |t: u64| Sample { base: Cow::Owned(base.clone()), differences: noise(100 + t, |_| 0.2) };
        let samples: Vec<Sample> = (0..8).map(sample).collect();
        let matching = Matching { amount, region: 32, max_gain: 2.0 };
        (Appearance::learn(&picture, &matte, &samples, &matching), samples, picture)
    }

    fn contrast(plane: &Plane, columns: std::ops::Range<usize>) -> f32 {
        let squares = columns.clone().flat_map(|x| (0..SIZE).map(move |y| plane.at(x, y).powi(2))).sum::<f32>();
        (squares / (columns.len() * SIZE) as f32).sqrt()
    }

    #[test]
    fn frames_get_the_pictures_contrast_place_by_place() {
        let (appearance, samples, picture) = learn(1.0, 0.0);
        let matched = appearance.apply(&samples[3]);
        let still = picture.map(|v| v - 0.5);
        for columns in [40..56, 72..88, 104..120] {
            let wanted = contrast(&still, columns.clone());
            let (before, after) = (contrast(&samples[3].differences, columns.clone()), contrast(&matched, columns));
            assert!(
                (after / wanted - 1.0).abs() < 0.5 * (before / wanted - 1.0).abs().max(0.2),
                "{before} {after} {wanted}"
            );
        }
    }

    #[test]
    fn nothing_outside_the_matte_counts_or_changes() {
        let ((a, samples, _), (b, others, _)) = (learn(1.0, 0.0), learn(1.0, 0.3));
        let (a, b) = (a.apply(&samples[0]), b.apply(&others[0]));
        assert_eq!(a, b);
        assert!((0..SIZE).all(|y| a.row(y)[..SIZE / 4] == samples[0].differences.row(y)[..SIZE / 4]));
    }

    #[test]
    fn no_amount_changes_nothing_and_gains_are_bounded() {
        let (none, samples, _) = learn(0.0, 0.0);
        let same = none.apply(&samples[0]);
        assert!(same.data.iter().zip(&samples[0].differences.data).all(|(a, b)| (a - b).abs() < 1e-5));
        let (all, ..) = learn(1.0, 0.0);
        for curves in &all.bands {
            for (i, offset) in curves.offsets.iter().enumerate() {
                let x = curves.low + (i % KNOTS) as f32 * curves.step;
                let y = x + offset;
                assert!(y.abs() <= 2.0 * x.abs() + 1e-5 && y.abs() >= 0.5 * x.abs() - 1e-5, "{x} {y}");
            }
        }
    }

    #[test]
    fn neither_a_grid_nor_flicker() {
        let (appearance, samples, _) = learn(1.0, 0.0);
        let mean = |p: &Plane| contrast(p, 40..120);
        let matched: Vec<Plane> = samples.iter().map(|s| appearance.apply(s)).collect();
        let means: Vec<f32> = matched.iter().map(mean).collect();
        let (low, high) = means.iter().fold((f32::MAX, 0.0f32), |(l, h), m| (l.min(*m), h.max(*m)));
        assert!(high < 1.03 * low, "{low} {high}");
        let step = |x: usize| {
            matched.iter().map(|m| (0..SIZE).map(|y| (m.at(x, y) - m.at(x - 1, y)).abs()).sum::<f32>()).sum::<f32>()
        };
        for x in [64, 80, 96, 112] {
            let beside = (step(x - 2) + step(x - 1) + step(x + 1) + step(x + 2)) / 4.0;
            assert!((step(x) / beside - 1.0).abs() < 0.06, "{x}: {} {beside}", step(x));
        }
    }
}
