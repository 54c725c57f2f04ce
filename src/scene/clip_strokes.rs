//! Strokes on a clip's picture, as a person would draw them who has seen the clip.

use crate::base::error::Result;
use crate::flow::strokes::Stroke;
use crate::library::reader::Pack;
use crate::library::texture_motion::TextureMotion;
use crate::library::variant::CELL;
use crate::raster::components::Components;
use crate::raster::image::Plane;

/// Parts of the matte below this share of it get no stroke.
const LARGE: f32 = 0.1;
/// Length of a stroke, pixels.
const LENGTH: f32 = 40.0;
/// Windows that are followed for a speed begin so many pixels apart.
const SPACING: usize = 32;

/// One stroke of 40 pixels on each large part of the matte, through the pixel nearest to its middle, along the part's mean
/// motion over time in clip number `clip`. None on a part that as a whole goes nowhere. With `speeds` each tells the part's
/// speed, pixels per frame: the root mean square of the motion's length, whichever way it goes, as the texture travels where
/// that is sure and else as optical flow sees it.
///
/// # Errors
/// A damaged pack.
pub fn along_motion(pack: &Pack, clip: u32, matte: &Plane, speeds: bool) -> Result<Vec<Stroke>> {
    let grid = pack.grid(clip, 0)?;
    let cell = |&(x, y): &(usize, usize)| {
        &grid.cells[(y / CELL).min(grid.height - 1) * grid.width + (x / CELL).min(grid.width - 1)]
    };
    let motion = |place: &(usize, usize)| (cell(place).mean[0].to_f32(), cell(place).mean[1].to_f32());
    let texture = speeds.then(|| TextureMotion::read(pack, clip)).transpose()?;
    let speed = |part: &[(usize, usize)]| {
        texture.as_ref().map(|texture| speed(part, texture, |place| cell(place).activity.to_f32()))
    };
    let parts = Components::above(matte, 0.5);
    let fluid: usize = parts.sizes.iter().sum();
    let large = (1..=parts.sizes.len()).filter(|part| parts.sizes[part - 1] as f32 > LARGE * fluid as f32);
    let pixels = |part: usize| {
        let of_part = (0..matte.data.len()).filter(|&i| parts.labels[i] as usize == part);
        of_part.map(|i| (i % matte.width, i / matte.width)).collect::<Vec<_>>()
    };
    let drawn = large.filter_map(|part| {
        let pixels = pixels(part);
        Some(Stroke { speed: speed(&pixels), ..stroke(&pixels, motion, matte)? })
    });
    Ok(drawn.collect())
}

/// Root mean square of the motion's length over some pixels.
fn speed(part: &[(usize, usize)], texture: &TextureMotion, activity: impl Fn(&(usize, usize)) -> f32) -> f32 {
    let windows = part.iter().filter(|(x, y)| x % SPACING == SPACING / 2 && y % SPACING == SPACING / 2);
    let travels: Vec<f32> = windows
        .map(|place| {
            let seen = activity(place);
            let travel = texture.at(place.0 as f32 + 0.5, place.1 as f32 + 0.5).map_or(0.0, |(u, v)| u.hypot(v));
            travel.max(seen)
        })
        .collect();
    // A part so small that it holds no middle of a window is as fast as optical flow says.
    let all = if travels.is_empty() { part.iter().map(activity).collect() } else { travels };
    (all.iter().map(|speed| speed * speed).sum::<f32>() / all.len().max(1) as f32).sqrt()
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
