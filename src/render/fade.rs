//! Cross-fades that keep the contrast.

use crate::base::par;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::raster::premultiplied::Premultiplied;

/// What is coarser than this many pixels is plainly mixed.
const SIGMA: f32 = 6.0;

/// `share` of `a` and the rest of `b`. A mean of two unlike textures is dull: what is finer than a low-pass mean gets the
/// contrast back that it loses, `1 / √(w² + (1 − w)² + 2 w (1 − w) ρ)`, ρ how alike the two are around a pixel.
pub fn mixed(a: &Premultiplied, b: &Premultiplied, share: f32) -> Premultiplied {
    let low = |image: &Premultiplied| par::map(4, |c| gaussian(&image.planes[c], SIGMA));
    let (low_a, low_b) = par::join(|| low(a), || low(b));
    let gain = gains((a, &low_a), (b, &low_b), share);
    let (width, height) = a.size();
    let mut out = std::array::from_fn(|_| Plane::zeros(width, height));
    for i in 0..width * height {
        let mix = |a: f32, b: f32| share * a + (1.0 - share) * b;
        let mean: [f32; 4] = std::array::from_fn(|c| mix(low_a[c].data[i], low_b[c].data[i]));
        let detail: [f32; 4] = std::array::from_fn(|c| mix(a.planes[c].data[i], b.planes[c].data[i]) - mean[c]);
        let alpha = (mean[3] + gain.data[i] * detail[3]).clamp(0.0, 1.0);
        // As much as fits between black and opaque in all channels alike, or colours would turn.
        let fits = |(m, d): (&f32, &f32)| if *d > 0.0 { (alpha - m) / d } else { m / (-d).max(1e-9) };
        let room = mean[..3].iter().zip(&detail).map(fits).fold(gain.data[i], f32::min).max(1.0);
        for (c, plane) in out.iter_mut().enumerate() {
            plane.data[i] = if c < 3 { mean[c] + room * detail[c] } else { alpha };
        }
    }
    Premultiplied::from_planes(out)
}

/// The factor at every pixel, from images and their low-pass planes.
fn gains((a, low_a): (&Premultiplied, &[Plane]), (b, low_b): (&Premultiplied, &[Plane]), share: f32) -> Plane {
    let (width, height) = a.size();
    let product = |(f, low_f): (&Premultiplied, &[Plane]), (g, low_g): (&Premultiplied, &[Plane])| {
        let detail =
            |image: &Premultiplied, low: &[Plane], c: usize, i: usize| image.planes[c].data[i] - low[c].data[i];
        let sum = |i: usize| (0..3).map(|c| detail(f, low_f, c, i) * detail(g, low_g, c, i)).sum();
        gaussian(&Plane::from_vec(width, height, (0..width * height).map(sum).collect()), SIGMA)
    };
    let (cross, (aa, bb)) = par::join(
        || product((a, low_a), (b, low_b)),
        || (product((a, low_a), (a, low_a)), product((b, low_b), (b, low_b))),
    );
    let gain = |i: usize| {
        let alike = (cross.data[i] / (aa.data[i] * bb.data[i]).sqrt().max(1e-8)).clamp(0.0, 1.0);
        (1.0 - 2.0 * share * (1.0 - share) * (1.0 - alike)).sqrt().recip()
    };
    Plane::from_vec(width, height, (0..width * height).map(gain).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    fn noise(seed: u64) -> Premultiplied {
        let plane =
            |c: u64| Plane::from_fn(64, 48, |x, y| 0.3 + 0.4 * rng::unit(rng::hash(seed, &[c, x as u64, y as u64])));
        Premultiplied::from_planes([plane(0), plane(1), plane(2), Plane::filled(64, 48, 1.0)])
    }

    fn deviation(image: &Premultiplied) -> f32 {
        let data = &image.planes[0].data;
        let mean = data.iter().sum::<f32>() / data.len() as f32;
        (data.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / data.len() as f32).sqrt()
    }

    #[test]
    fn the_contrast_stays_and_what_is_the_same_stays_the_same() {
        let (a, b) = (noise(1), noise(2));
        for share in [0.25, 0.5, 0.8] {
            let ratio = deviation(&mixed(&a, &b, share)) / deviation(&a);
            assert!((ratio - 1.0).abs() < 0.1, "{share}: {ratio}");
        }
        let same = mixed(&a, &a, 0.5);
        assert!(same.planes[1].data.iter().zip(&a.planes[1].data).all(|(s, a)| (s - a).abs() < 1e-4));
        assert!(mixed(&a, &b, 1.0).planes[2].data.iter().zip(&a.planes[2].data).all(|(s, a)| (s - a).abs() < 1e-5));
    }
}
