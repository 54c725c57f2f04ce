//! Motion as colour: hue for direction, saturation for speed.

use crate::flow::field::Field;
use crate::raster::image::Rgb8;

/// Colours a field: white at rest, saturated at `full` pixels per frame and beyond; right is red, down is
/// yellow-green, left is cyan, up is violet. Unknown motion (beyond 10⁹ or not a number) is black. A `full` of 0 or
/// less takes the field's own 99th percentile.
pub fn colour(field: &Field, full: f32) -> Rgb8 {
    let full = if full > 0.0 { full } else { percentile99(field) };
    let mut out = Rgb8::black(field.width(), field.height());
    for (pixel, (&u, &v)) in out.data.chunks_exact_mut(3).zip(field.u.data.iter().zip(&field.v.data)) {
        if u.abs() <= super::io::UNKNOWN && v.abs() <= super::io::UNKNOWN {
            pixel.copy_from_slice(&vector_colour(u / full, v / full));
        }
    }
    out
}

/// The 99th percentile of the known vectors' lengths; 1 when there is none above 0.
fn percentile99(field: &Field) -> f32 {
    let known = field.u.data.iter().zip(&field.v.data).filter(|(u, v)| super::io::is_known(**u, **v));
    let mut lengths: Vec<f32> = known.map(|(u, v)| (u * u + v * v).sqrt()).collect();
    if lengths.is_empty() {
        return 1.0;
    }
    let place = (lengths.len() - 1) * 99 / 100;
    let (_, &mut value, _) = lengths.select_nth_unstable_by(place, f32::total_cmp);
    if value > 0.0 { value } else { 1.0 }
}

/// Colour of a vector in units of full saturation.
fn vector_colour(u: f32, v: f32) -> [u8; 3] {
    let saturation = (u * u + v * v).sqrt().min(1.0);
    let turn = v.atan2(u) / std::f32::consts::TAU;
    // A smooth colour circle: each channel a raised cosine of the hue, a third of a turn apart.
    [0.0, 1.0 / 3.0, 2.0 / 3.0].map(|offset| {
        let hue = 0.5 + 0.5 * ((turn - offset) * std::f32::consts::TAU).cos();
        let value = 1.0 - saturation * (1.0 - hue);
        (value * 255.0 + 0.5) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rest_is_white_and_directions_differ() {
        let mut field = Field::zeros(4, 1);
        field.u.data = vec![0.0, 2.0, -2.0, f32::NAN];
        let image = colour(&field, 2.0);
        assert_eq!(image.pixel(0, 0), [255, 255, 255]);
        assert_eq!(image.pixel(1, 0), [255, 64, 64]);
        assert_eq!(image.pixel(2, 0), [0, 191, 191]);
        assert_eq!(image.pixel(3, 0), [0, 0, 0]);
        assert_eq!(colour(&field, 0.0).pixel(1, 0), [255, 64, 64]);
        assert_eq!(colour(&Field::default(), 0.0).data.len(), 0);
    }
}
