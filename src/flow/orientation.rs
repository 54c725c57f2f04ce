//! Directions as colours, to be painted and read back.
//!
//! The hue is the direction (red right, yellow-green down, cyan left, violet up: its angle is the direction's angle in
//! degrees, read like a clock hand from three o'clock onwards), the colourfulness, largest minus smallest channel, is how
//! sure it is, 0 to 1. Black, white, grey and transparent say nothing.

use super::field::Field;
use crate::raster::image::{Plane, Rgb8};

/// Less colourful than this is grey with rounding.
const GREY: u8 = 4;

/// Colours directions: `field` holds vectors of length 0 (nothing said) to 1 (sure); longer ones count as 1.
pub fn encode(field: &Field) -> Rgb8 {
    let mut out = Rgb8::black(field.width(), field.height());
    for (pixel, (&u, &v)) in out.data.chunks_exact_mut(3).zip(field.u.data.iter().zip(&field.v.data)) {
        let value = 255.0 * u.hypot(v).min(1.0);
        let hue = v.atan2(u).to_degrees().rem_euclid(360.0) / 60.0;
        pixel.copy_from_slice(&[5.0, 3.0, 1.0].map(|n: f32| {
            let k = (n + hue) % 6.0;
            (value * (1.0 - k.min(4.0 - k).clamp(0.0, 1.0)) + 0.5) as u8
        }));
    }
    out
}

/// Reads directions back, as vectors of length 0 to 1; `alpha`, 255 opaque, scales their length.
pub fn decode(picture: &Rgb8, alpha: Option<&[u8]>) -> Field {
    let mut field = Field::zeros(picture.width, picture.height);
    for (i, pixel) in picture.data.chunks_exact(3).enumerate() {
        let opacity = alpha.map_or(1.0, |a| f32::from(a[i]) / 255.0);
        let (u, v) = direction([pixel[0], pixel[1], pixel[2]]);
        (field.u.data[i], field.v.data[i]) = (opacity * u, opacity * v);
    }
    field
}

fn direction(colour: [u8; 3]) -> (f32, f32) {
    let (low, high) = (colour.into_iter().min().unwrap_or(0), colour.into_iter().max().unwrap_or(0));
    if high - low < GREY {
        return (0.0, 0.0);
    }
    let [r, g, b] = colour.map(f32::from);
    let chroma = f32::from(high - low);
    let hue = if colour[0] == high {
        (g - b) / chroma
    } else if colour[1] == high {
        2.0 + (b - r) / chroma
    } else {
        4.0 + (r - g) / chroma
    };
    let (sin, cos) = (60.0 * hue).to_radians().sin_cos();
    (chroma / 255.0 * cos, chroma / 255.0 * sin)
}

/// Speeds as grey, white at `max` (above 0).
pub fn speed_picture(speed: &Plane, max: f32) -> Rgb8 {
    let grey = |v: f32| (v / max * 255.0 + 0.5).clamp(0.0, 255.0) as u8;
    Rgb8 { width: speed.width, height: speed.height, data: speed.data.iter().flat_map(|&v| [grey(v); 3]).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_come_back_within_a_degree() {
        for strength in [1.0f32, 0.6, 0.3] {
            for degrees in 0..360 {
                let (sin, cos) = (degrees as f32).to_radians().sin_cos();
                let mut field = Field::zeros(1, 1);
                (field.u.data[0], field.v.data[0]) = (strength * cos, strength * sin);
                let back = decode(&encode(&field), None);
                let (u, v) = (back.u.data[0], back.v.data[0]);
                assert!((u.hypot(v) - strength).abs() < 1.5 / 255.0, "{degrees} {strength}");
                let angle = ((u * cos + v * sin) / u.hypot(v)).min(1.0).acos().to_degrees();
                assert!(angle < 1.0, "{degrees}° came back {angle}° off at strength {strength}");
            }
        }
    }

    #[test]
    fn the_code_is_as_documented() {
        let of = |c: [u8; 3], a: u8| {
            let field = decode(&Rgb8 { width: 1, height: 1, data: c.to_vec() }, Some(&[a]));
            (field.u.data[0], field.v.data[0])
        };
        assert_eq!(of([255, 0, 0], 255), (1.0, 0.0));
        assert!(of([0, 255, 255], 255).0 < -0.999);
        assert!(of([128, 255, 0], 255).1 > 0.999 && of([128, 0, 255], 255).1 < -0.999);
        for nothing in [[0; 3], [255; 3], [90, 91, 92]] {
            assert_eq!(of(nothing, 255), (0.0, 0.0));
        }
        assert_eq!(of([255, 0, 0], 0), (0.0, 0.0));
        let picture = speed_picture(&Plane::from_vec(3, 1, vec![0.0, 2.0, 9.0]), 4.0);
        assert_eq!(picture.data, [0, 0, 0, 128, 128, 128, 255, 255, 255]);
    }
}
