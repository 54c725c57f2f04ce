//! Motion blur: every pixel a mean along its motion (LazyFluids §4.5, Fig. 9).

use crate::base::par;
use crate::flow::field::Field;
use crate::raster::image::Plane;
use crate::raster::premultiplied::Premultiplied;

/// Deviations of the Gaussian on either side that are summed.
const REACH: f32 = 2.0;

/// `image` under a shutter that is open for `shutter` frames, as it moves by `flow` a frame: a line convolution with a
/// Gaussian along the motion, whose two deviations on either side make the path of the exposure.
pub fn streaked(image: &Premultiplied, flow: &Field, shutter: f32) -> Premultiplied {
    if shutter <= 0.0 {
        return image.clone();
    }
    let (width, height) = image.size();
    let planes = image.planes.each_ref().map(|plane| {
        let mut out = Plane::zeros(width, height);
        par::for_each_chunk(&mut out.data, width, |y, row| {
            for (x, value) in row.iter_mut().enumerate() {
                let path = (flow.u.at(x, y) * shutter, flow.v.at(x, y) * shutter);
                *value = along(plane, (x as f32 + 0.5, y as f32 + 0.5), path);
            }
        });
        out
    });
    Premultiplied::from_planes(planes)
}

/// Mean along a path that has its middle at `(x, y)`.
fn along(plane: &Plane, (x, y): (f32, f32), (u, v): (f32, f32)) -> f32 {
    let half = (u.hypot(v) / 2.0).ceil();
    if half < 1.0 && u.hypot(v) < 0.25 {
        return plane.bilinear(x, y);
    }
    let steps = half as i32 * 2;
    let (mut sum, mut total) = (0.0, 0.0);
    for k in -steps..=steps {
        let share = k as f32 / steps as f32;
        let weight = (-0.5 * (REACH * share).powi(2)).exp();
        sum += weight * plane.bilinear(x + 0.5 * share * u, y + 0.5 * share * v);
        total += weight;
    }
    sum / total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dot_becomes_a_streak_along_its_motion_and_nothing_is_lost() {
        let dot = Plane::from_fn(41, 31, |x, y| f32::from((x, y) == (20, 15)));
        let image = Premultiplied::from_planes([dot.clone(), dot.clone(), dot.clone(), dot]);
        let flow = Field { u: Plane::filled(41, 31, 10.0), v: Plane::zeros(41, 31) };
        let blurred = streaked(&image, &flow, 1.0);
        let alpha = blurred.alpha();
        assert!((alpha.data.iter().sum::<f32>() - 1.0).abs() < 0.02);
        assert!(
            alpha.at(17, 15) > 0.02 && alpha.at(23, 15) > 0.02 && alpha.at(28, 15) == 0.0 && alpha.at(20, 13) == 0.0
        );
        assert_eq!(streaked(&image, &flow, 0.0), image);
    }
}
