//! Differences brought to the contrast of the picture, place by place and band by band.

use super::contrast::{FINE, Strength};
use super::layout::BANDS;
use crate::base::par;
use crate::library::variant::CELL;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::raster::pyramid::{collapse, laplacian, reduce};
use crate::raster::resample::resize;

/// Window over which contrast is measured, pixels (σ).
const WINDOW: f32 = 20.0;
/// Smallest contrast that is measured, in [0, 1].
const NOISE: f32 = 0.002;

/// Factors of differences.
#[derive(Debug, Clone, PartialEq)]
pub struct BandGains {
    /// Per band, at its size.
    factors: Vec<Plane>,
    /// Share of the picture's variance that the differences then have, per band on cells, 0 to 1.
    pub shares: [Plane; BANDS],
}

impl BandGains {
    /// Brings differences, some of which are `samples`, to the contrast of a picture's `luma` within its `matte`. Of the
    /// coarse bands only `moving` is wanted, the share of their contrast that moves in the clip: the rest is light and
    /// shade that stays.
    pub fn new(samples: &[Plane], luma: &Plane, matte: &Plane, moving: &[Plane; BANDS], strength: &Strength) -> Self {
        let mattes: Vec<Plane> = std::iter::successors(Some(matte.clone()), |m| Some(reduce(m))).take(BANDS).collect();
        let made = mean_squares(samples);
        let picture = mean_squares(std::slice::from_ref(luma));
        let (width, height) = (luma.width.div_ceil(CELL), luma.height.div_ceil(CELL));
        let bands = par::map(BANDS, |k| {
            let [made, wanted] = [&made[k], &picture[k]].map(|squares| around(squares, &mattes[k], k));
            let moving = resize(&moving[k], made.width, made.height);
            let both = |i: usize| {
                let moves = if k < FINE { 1.0 } else { moving.data[i].clamp(0.0, 1.0) };
                let (made, wanted) = (made.data[i].max(NOISE), wanted.data[i].max(NOISE));
                let bounded = strength.strength * moves * wanted / made;
                let factor = strength.bands[k] * bounded.clamp(1.0 / strength.max_gain, strength.max_gain);
                (factor, (factor * made / wanted).min(1.0).powi(2))
            };
            let both: Vec<(f32, f32)> = (0..made.data.len()).map(both).collect();
            let plane =
                |of: fn(&(f32, f32)) -> f32| Plane::from_vec(made.width, made.height, both.iter().map(of).collect());
            (plane(|b| b.0), resize(&plane(|b| b.1), width, height))
        });
        let (factors, shares): (Vec<Plane>, Vec<Plane>) = bands.into_iter().unzip();
        Self { factors, shares: shares.try_into().expect("a plane for every band") }
    }

    /// Differences with their factors; what is coarser than all bands is dropped.
    pub fn apply(&self, differences: &Plane) -> Plane {
        let (mut bands, _) = laplacian(differences, BANDS);
        for (band, factor) in bands.iter_mut().zip(&self.factors) {
            band.data.iter_mut().zip(&factor.data).for_each(|(b, f)| *b *= f);
        }
        collapse(&bands, None)
    }
}

/// Squares of every band, averaged over some planes.
pub fn mean_squares(planes: &[Plane]) -> Vec<Plane> {
    let squares = par::map(planes.len(), |i| {
        let (bands, _) = laplacian(&planes[i], BANDS);
        bands.into_iter().map(|b| b.map(|v| v * v)).collect::<Vec<_>>()
    });
    let mean = |k: usize| {
        let mut sum = Plane::zeros(squares[0][k].width, squares[0][k].height);
        for planes in &squares {
            sum.data.iter_mut().zip(&planes[k].data).for_each(|(s, v)| *s += v);
        }
        sum.map(|v| v / planes.len() as f32)
    };
    (0..BANDS).map(mean).collect()
}

/// Root mean square around every pixel of band `band`, within the matte.
fn around(squares: &Plane, matte: &Plane, band: usize) -> Plane {
    let sigma = (WINDOW / (1 << band) as f32).max(1.5);
    let weight = matte.map(|m| m.max(1e-3));
    let weighted = squares.data.iter().zip(&weight.data).map(|(s, w)| s * w).collect();
    let mut sum = gaussian(&Plane::from_vec(squares.width, squares.height, weighted), sigma);
    sum.data.iter_mut().zip(&gaussian(&weight, sigma).data).for_each(|(s, t)| *s = (*s / t).max(0.0).sqrt());
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{hash, unit};

    const SIZE: (usize, usize) = (160, 128);

    fn noise(seed: u64, contrast: impl Fn(usize) -> f32) -> Plane {
        Plane::from_fn(SIZE.0, SIZE.1, |x, y| contrast(x) * (unit(hash(seed, &[x as u64, y as u64])) - 0.5))
    }

    fn gains(strength: f32, moving: f32) -> (BandGains, Plane) {
        let picture = noise(9, |x| if x < 80 { 0.1 } else { 0.3 });
        let samples: Vec<Plane> = (0..6).map(|t| noise(t, |_| 0.15)).collect();
        let moving = std::array::from_fn(|_| Plane::filled(40, 32, moving));
        let strength = Strength { strength, max_gain: 3.0, bands: [1.0; BANDS] };
        let gains = BandGains::new(&samples, &picture, &Plane::filled(SIZE.0, SIZE.1, 1.0), &moving, &strength);
        (gains, picture)
    }

    fn contrast(plane: &Plane, columns: std::ops::Range<usize>) -> f32 {
        let squares = columns.clone().flat_map(|x| (0..SIZE.1).map(move |y| plane.at(x, y).powi(2))).sum::<f32>();
        (squares / (columns.len() * SIZE.1) as f32).sqrt()
    }

    #[test]
    fn differences_get_the_pictures_contrast_place_by_place() {
        let (gains, picture) = gains(1.0, 1.0);
        let made = gains.apply(&noise(77, |_| 0.15));
        for columns in [10..50, 110..150] {
            let ratio = contrast(&made, columns.clone()) / contrast(&picture, columns);
            assert!((ratio - 1.0).abs() < 0.15, "{ratio}");
        }
        assert!(gains.shares.iter().all(|s| s.data.iter().all(|&v| v > 0.9)));
    }

    #[test]
    fn factors_are_bounded_and_what_stays_in_the_clip_stays() {
        let (strong, _) = gains(100.0, 1.0);
        let before = noise(77, |_| 0.15);
        assert!(contrast(&strong.apply(&before), 10..150) < 3.01 * contrast(&before, 10..150));
        let (still, _) = gains(1.0, 0.4);
        assert!(still.shares[0].data.iter().all(|&v| v > 0.9) && still.shares[3].data.iter().all(|&v| v < 0.3));
    }
}
