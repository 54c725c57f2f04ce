//! Motion as colour: hue for direction, saturation for speed; as arrows; and the strokes that ask for it.

use crate::flow::field::Field;
use crate::raster::image::{Plane, Rgb8};

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

/// Arrows along the longer side of a picture.
const ARROWS: usize = 28;
/// Share of the longest arrow below which one is left out.
const SHORTEST: f32 = 0.08;
/// Half the width of an arrow, and of the dark edge that sets it off, pixels.
const HALF_WIDTH: (f32, f32) = (0.8, 0.9);
/// Half the width of a stroke, pixels.
const STROKE: f32 = 2.0;

/// Draws a field over a picture of its size, as arrows on a grid in the colours of [`colour`], the longest as long as the
/// grid is wide at the 99th percentile of the field's lengths.
pub fn arrows(picture: &mut Rgb8, field: &Field) {
    let step = (picture.width.max(picture.height) as f32 / ARROWS as f32).max(8.0);
    let full = percentile99(&moving(field));
    let centres = |size: usize| {
        let count = (size as f32 / step).floor().max(1.0);
        (0..count as usize).map(move |i| (i as f32 + 0.5) * size as f32 / count)
    };
    for y in centres(picture.height) {
        for x in centres(picture.width) {
            let at = (y as usize).min(field.height() - 1) * field.width() + (x as usize).min(field.width() - 1);
            let (u, v) = (field.u.data[at] / full, field.v.data[at] / full);
            let length = u.hypot(v);
            if length >= SHORTEST && length.is_finite() {
                let half = 0.5 * 0.95 * step * length.min(1.0) / length;
                let (tail, tip) = ((x - half * u, y - half * v), (x + half * u, y + half * v));
                arrow(picture, &[tail, tip], HALF_WIDTH.0, vector_colour(u / length, v / length));
            }
        }
    }
}

/// Draws lines of points, each `scale` times as far from the picture's corner, in white with a head at their ends.
pub fn strokes(picture: &mut Rgb8, lines: &[Vec<(f32, f32)>], scale: f32) {
    for line in lines {
        let points: Vec<(f32, f32)> = line.iter().map(|(x, y)| (scale * x, scale * y)).collect();
        arrow(picture, &points, STROKE, [255; 3]);
    }
}

/// The part of a field that moves, so that what rests does not count.
fn moving(field: &Field) -> Field {
    let moves = |i: &usize| field.u.data[*i] != 0.0 || field.v.data[*i] != 0.0;
    let places: Vec<usize> = (0..field.u.data.len()).filter(moves).collect();
    let part = |plane: &Plane| Plane::from_vec(places.len(), 1, places.iter().map(|&i| plane.data[i]).collect());
    Field { u: part(&field.u), v: part(&field.v) }
}

/// A line through points with a head at its end, and a dark edge around it.
fn arrow(picture: &mut Rgb8, points: &[(f32, f32)], half_width: f32, colour: [u8; 3]) {
    let Some((&tip, before)) = points.split_last() else { return };
    let Some(&from) = before.iter().rfind(|p| p.0 != tip.0 || p.1 != tip.1) else { return };
    let whole: f32 = points.windows(2).map(|p| (p[1].0 - p[0].0).hypot(p[1].1 - p[0].1)).sum();
    let head = (7.0 * half_width).min(0.45 * whole);
    let angle = (tip.1 - from.1).atan2(tip.0 - from.0);
    let barb = |turn: f32| (tip.0 - head * (angle + turn).cos(), tip.1 - head * (angle + turn).sin());
    let lines = points.windows(2).map(|p| (p[0], p[1])).chain([(barb(0.5), tip), (barb(-0.5), tip)]);
    let lines: Vec<_> = lines.collect();
    for (wider, colour, strength) in [(HALF_WIDTH.1, [0; 3], 0.7), (0.0, colour, 1.0)] {
        lines.iter().for_each(|&(a, b)| segment(picture, (a, b), half_width + wider, colour, strength));
    }
}

/// Lays a line of round ends over a picture.
fn segment(picture: &mut Rgb8, (a, b): ((f32, f32), (f32, f32)), half_width: f32, colour: [u8; 3], strength: f32) {
    let range = |a: f32, b: f32, size: usize| {
        let (low, high) = (a.min(b) - half_width - 1.0, a.max(b) + half_width + 1.0);
        (low.max(0.0) as usize).min(size)..(high.max(0.0) as usize).min(size)
    };
    let (du, dv) = (b.0 - a.0, b.1 - a.1);
    let squared = (du * du + dv * dv).max(1e-9);
    for y in range(a.1, b.1, picture.height) {
        for x in range(a.0, b.0, picture.width) {
            let (px, py) = (x as f32 + 0.5 - a.0, y as f32 + 0.5 - a.1);
            let along = ((px * du + py * dv) / squared).clamp(0.0, 1.0);
            let distance = (px - along * du).hypot(py - along * dv);
            let cover = strength * (half_width + 0.5 - distance).clamp(0.0, 1.0);
            let at = 3 * (y * picture.width + x);
            for (byte, &over) in picture.data[at..at + 3].iter_mut().zip(&colour) {
                *byte = (f32::from(*byte) + cover * (f32::from(over) - f32::from(*byte)) + 0.5) as u8;
            }
        }
    }
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

    #[test]
    fn arrows_stand_where_something_moves_and_are_of_its_colour() {
        let mut field = Field::zeros(120, 60);
        for y in 0..60 {
            for x in 60..120 {
                *field.v.at_mut(x, y) = 2.0;
            }
        }
        let mut picture = Rgb8::black(120, 60);
        arrows(&mut picture, &field);
        let lit = |x: std::ops::Range<usize>| {
            (0..60).flat_map(|y| x.clone().map(move |x| (x, y))).filter(|&(x, y)| picture.pixel(x, y) != [0; 3]).count()
        };
        assert_eq!(lit(0..50), 0);
        assert!(lit(60..120) > 300, "{}", lit(60..120));
        assert!(picture.data.chunks_exact(3).all(|p| p[1] >= p[0] && p[0] >= p[2]), "yellow-green is down");
        arrows(&mut Rgb8::black(3, 2), &Field::zeros(3, 2));
    }

    #[test]
    fn a_stroke_is_drawn_at_its_scale_and_points_to_its_end() {
        let mut picture = Rgb8::black(80, 40);
        strokes(&mut picture, &[vec![(20.0, 40.0), (140.0, 40.0)], vec![(5.0, 5.0)]], 0.5);
        assert_eq!((picture.pixel(40, 20), picture.pixel(40, 30)), ([255; 3], [0; 3]));
        let thick = |x: usize| (0..40).filter(|&y| picture.pixel(x, y) != [0; 3]).count();
        assert!(thick(64) > thick(40) && thick(40) == thick(15), "{} {}", thick(64), thick(40));
        strokes(&mut picture, &[vec![(-50.0, -50.0), (500.0, 900.0)]], 1.0);
    }
}
