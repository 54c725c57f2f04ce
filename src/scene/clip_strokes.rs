//! Strokes on a clip's picture, as a person would draw them who has seen the clip.

use crate::base::error::Result;
use crate::flow::strokes::Stroke;
use crate::library::reader::Pack;
use crate::library::variant::CELL;
use crate::raster::components::Components;
use crate::raster::image::Plane;

/// Parts of the matte below this share of it get no stroke.
const LARGE: f32 = 0.1;
/// Length of a stroke, pixels.
const LENGTH: f32 = 40.0;

/// One stroke of 40 pixels on each large part of the matte, through the pixel nearest to its middle, along the part's mean
/// motion over time in clip number `clip`; no speed is told. None on a part that as a whole goes nowhere.
///
/// # Errors
/// A damaged pack.
pub fn along_motion(pack: &Pack, clip: u32, matte: &Plane) -> Result<Vec<Stroke>> {
    let grid = pack.grid(clip, 0)?;
    let motion = |&(x, y): &(usize, usize)| {
        let cell = &grid.cells[(y / CELL).min(grid.height - 1) * grid.width + (x / CELL).min(grid.width - 1)];
        (cell.mean[0].to_f32(), cell.mean[1].to_f32())
    };
    let parts = Components::above(matte, 0.5);
    let fluid: usize = parts.sizes.iter().sum();
    let large = (1..=parts.sizes.len()).filter(|part| parts.sizes[part - 1] as f32 > LARGE * fluid as f32);
    let pixels = |part: usize| {
        let of_part = (0..matte.data.len()).filter(|&i| parts.labels[i] as usize == part);
        of_part.map(|i| (i % matte.width, i / matte.width)).collect::<Vec<_>>()
    };
    Ok(large.filter_map(|part| stroke(&pixels(part), motion, matte)).collect())
}

fn stroke(pixels: &[(usize, usize)], motion: impl Fn(&(usize, usize)) -> (f32, f32), matte: &Plane) -> Option<Stroke> {
    let (u, v) = mean(pixels.iter().map(motion));
    let (middle_x, middle_y) = mean(pixels.iter().map(|&(x, y)| (x as f32, y as f32)));
    let far = |&(x, y): &(usize, usize)| (x as f32 - middle_x).hypot(y as f32 - middle_y);
    let &(x, y) = pixels.iter().min_by(|a, b| far(a).total_cmp(&far(b)))?;
    let length = u.hypot(v);
    let place = |c: usize, d: f32, size: usize| (c as f32 + 0.5 * LENGTH / length * d).clamp(0.0, size as f32 - 1.0);
    let end = |sign: f32| (place(x, sign * u, matte.width), place(y, sign * v, matte.height));
    (length > 0.0).then(|| Stroke { points: vec![end(-1.0), end(1.0)], speed: None })
}

fn mean(pairs: impl ExactSizeIterator<Item = (f32, f32)>) -> (f32, f32) {
    let count = pairs.len() as f32;
    let (u, v) = pairs.fold((0.0, 0.0), |(u, v), pair| (u + pair.0, v + pair.1));
    (u / count, v / count)
}
