//! Strokes painted in colour on transparency, each from its faint to its strong end.

use std::path::Path;

use super::strokes::{Stroke, check_count};
use crate::base::error::{Error, Kind, Result};
use crate::raster::components::{Components, neighbours};
use crate::raster::picture_io::{Picture, read_picture};

/// Fainter than this is no paint.
const FAINT: u8 = 8;
/// Neighbouring pixels whose channels differ by more than this belong to different strokes.
const SAME_COLOUR: u8 = 48;
/// Fewer pixels are a speck of the brush, not a stroke.
const SPECK: usize = 16;
/// Distance along a stroke between the points it becomes, pixels.
const STEP: usize = 6;
/// Least difference of opacity between the ends of a stroke, of 255.
const LEAST_RISE: f32 = 20.0;
/// The rim of a brush is faint all along; within this many pixels the strongest paint counts.
const RIM: usize = 2;

/// Reads strokes from a picture of `size` pixels. A stroke is a connected patch of one colour (neighbours whose channels
/// differ by at most 48 of 255), longer than wide, and does not touch itself; patches under 16 pixels are specks.
///
/// # Errors
/// A file that is no picture or of another size, has no transparency or no paint, or a stroke that is as strong at one
/// end as at the other.
pub fn read(path: &Path, size: (usize, usize)) -> Result<Vec<Stroke>> {
    let picture = read_picture(path)?;
    let found = (picture.rgb.width, picture.rgb.height);
    if found != size {
        let problem = format!("the strokes are {} × {} pixels, the picture {} × {}", found.0, found.1, size.0, size.1);
        return Err(Error::file(Kind::Unusable, path, problem).remedy("paint on a layer of the picture's size"));
    }
    trace(&picture, path)
}

/// The strokes of a painting; `path` names it in errors.
///
/// # Errors
/// As for [`read`].
pub fn trace(picture: &Picture, path: &Path) -> Result<Vec<Stroke>> {
    let (width, height) = (picture.rgb.width, picture.rgb.height);
    let remedy = "paint each stroke along the flow with a brush that fades in, on a transparent layer";
    let bad = |problem: &str| Error::file(Kind::Unusable, path, problem).remedy(remedy);
    let alpha = picture.alpha.as_ref().ok_or_else(|| bad("has no transparency to tell strokes from"))?;
    let near = |a: usize, b: usize| (0..3).all(|c| rgb(picture, a)[c].abs_diff(rgb(picture, b)[c]) <= SAME_COLOUR);
    let parts = Components::of(width, height, |i| alpha[i] >= FAINT, near);
    let mut pixels: Vec<Vec<usize>> = vec![Vec::new(); parts.sizes.len()];
    for (i, &label) in parts.labels.iter().enumerate().filter(|(_, l)| **l > 0) {
        pixels[label as usize - 1].push(i);
    }
    let patches: Vec<&Vec<usize>> = pixels.iter().filter(|p| p.len() >= SPECK).collect();
    if patches.is_empty() {
        return Err(bad("holds no strokes"));
    }
    check_count(patches.len(), path)?;
    let mut tracer = Tracer { alpha, parts: &parts, height, steps: vec![UNSEEN; width * height] };
    patches.iter().enumerate().map(|(i, pixels)| tracer.stroke(pixels, i + 1, &bad)).collect()
}

fn rgb(picture: &Picture, i: usize) -> &[u8] {
    &picture.rgb.data[3 * i..3 * i + 3]
}

const UNSEEN: u32 = u32::MAX;

/// Follows patches of paint from end to end.
struct Tracer<'a> {
    alpha: &'a [u8],
    parts: &'a Components,
    height: usize,
    /// Steps from where the last walk began.
    steps: Vec<u32>,
}

impl Tracer<'_> {
    /// The line through a patch, from its faint to its strong end.
    fn stroke(&mut self, pixels: &[usize], number: usize, bad: &impl Fn(&str) -> Error) -> Result<Stroke> {
        let (x, y) = self.place(pixels[0]);
        let name = format!("stroke {number}, near ({x:.0}, {y:.0}),");
        // The farthest pixel from anywhere is an end; the farthest from there is the other.
        let end = self.walk(pixels, pixels[0]);
        self.walk(pixels, end);
        let farthest = pixels.iter().map(|&i| self.steps[i] as usize).max().unwrap_or(0);
        if farthest < STEP {
            return Err(bad(&format!("{name} is a dot, not a line")));
        }
        let bins = (farthest / STEP).max(2);
        let mut sums = vec![[0.0f32; 4]; bins];
        for &i in pixels {
            let sum = &mut sums[(self.steps[i] as usize * bins / (farthest + 1)).min(bins - 1)];
            let (x, y) = self.place(i);
            [x, y, self.strongest(i), 1.0].iter().zip(sum).for_each(|(v, s)| *s += v);
        }
        let mean: Vec<[f32; 3]> = sums.iter().filter(|s| s[3] > 0.0).map(|s| [0, 1, 2].map(|c| s[c] / s[3])).collect();
        let third = mean.len().div_ceil(3);
        let opacity = |bins: &[[f32; 3]]| bins.iter().map(|b| b[2]).sum::<f32>() / bins.len() as f32;
        let rise = opacity(&mean[mean.len() - third..]) - opacity(&mean[..third]);
        if rise.abs() < LEAST_RISE {
            return Err(bad(&format!("{name} is as strong at one end as at the other, so it has no direction")));
        }
        let mut points: Vec<(f32, f32)> = mean.iter().map(|m| (m[0], m[1])).collect();
        if rise < 0.0 {
            points.reverse();
        }
        Ok(Stroke { points, speed: None })
    }

    /// Counts the steps from `start` to every pixel of the patch; the farthest one.
    fn walk(&mut self, pixels: &[usize], start: usize) -> usize {
        pixels.iter().for_each(|&i| self.steps[i] = UNSEEN);
        self.steps[start] = 0;
        let mut queue = std::collections::VecDeque::from([start]);
        let mut last = start;
        while let Some(i) = queue.pop_front() {
            last = i;
            for j in self.beside(i) {
                if self.steps[j] == UNSEEN {
                    self.steps[j] = self.steps[i] + 1;
                    queue.push_back(j);
                }
            }
        }
        last
    }

    /// The neighbours of a pixel in its own patch.
    fn beside(&self, i: usize) -> Vec<usize> {
        let same = |&j: &usize| self.parts.labels[j] == self.parts.labels[i];
        neighbours(i, self.parts.width, self.height).filter(same).collect()
    }

    /// Strongest paint of the patch round a pixel, 0 to 255.
    fn strongest(&self, i: usize) -> f32 {
        let (x, y) = (i % self.parts.width, i / self.parts.width);
        let xs = x.saturating_sub(RIM)..(x + RIM + 1).min(self.parts.width);
        let ys = y.saturating_sub(RIM)..(y + RIM + 1).min(self.height);
        let around = ys.flat_map(|y| xs.clone().map(move |x| y * self.parts.width + x));
        let own = around.filter(|&j| self.parts.labels[j] == self.parts.labels[i]);
        f32::from(own.map(|j| self.alpha[j]).max().unwrap_or(0))
    }

    /// Centre of a pixel.
    fn place(&self, i: usize) -> (f32, f32) {
        ((i % self.parts.width) as f32 + 0.5, (i / self.parts.width) as f32 + 0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::image::Rgb8;

    const SIZE: (usize, usize) = (120, 90);

    fn blank() -> Picture {
        let data = vec![0; SIZE.0 * SIZE.1 * 3];
        Picture { rgb: Rgb8 { width: SIZE.0, height: SIZE.1, data }, alpha: Some(vec![0; SIZE.0 * SIZE.1]) }
    }

    /// A brush of radius 4 with a soft rim along `at(s)`, s from 0 to 1, of opacity `strength(s)`.
    fn paint(picture: &mut Picture, colour: [u8; 3], at: impl Fn(f32) -> (f32, f32), strength: impl Fn(f32) -> f32) {
        for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))) {
            let distance = |s: f32| (at(s).0 - x as f32 - 0.5).hypot(at(s).1 - y as f32 - 0.5);
            let nearest = (0..=400).map(|k| k as f32 / 400.0).min_by(|a, b| distance(*a).total_cmp(&distance(*b)));
            let s = nearest.unwrap();
            let opacity = 255.0 * strength(s) * (4.0 - distance(s)).clamp(0.0, 1.0);
            let i = y * SIZE.0 + x;
            if opacity > 1.0 {
                picture.alpha.as_mut().unwrap()[i] = opacity as u8;
                picture.rgb.data[3 * i..3 * i + 3].copy_from_slice(&colour);
            }
        }
    }

    fn trace_it(picture: &Picture) -> Result<Vec<Stroke>> {
        trace(picture, Path::new("s.png"))
    }

    #[test]
    fn strokes_run_from_faint_to_strong_round_bends_and_across_each_other() {
        let mut picture = blank();
        paint(&mut picture, [255, 0, 0], |s| (20.0 + 70.0 * s, 20.0), |s| 1.0 - 0.8 * s);
        let bend = |s: f32| (60.0 - 40.0 * (3.0 * s).cos(), 40.0 + 40.0 * (3.0 * s).sin());
        paint(&mut picture, [0, 200, 0], bend, |s| 0.2 + 0.8 * s);
        let strokes = trace_it(&picture).unwrap();
        assert_eq!(strokes.len(), 2);
        let ends = |s: &Stroke| (s.points[0], *s.points.last().unwrap());
        let near = |a: (f32, f32), b: (f32, f32)| (a.0 - b.0).hypot(a.1 - b.1) < 5.0;
        let (from, to) = ends(&strokes[0]);
        assert!(near(from, (90.0, 20.0)) && near(to, (20.0, 20.0)), "{from:?} {to:?}");
        let (from, to) = ends(&strokes[1]);
        assert!(near(from, bend(0.0)) && near(to, bend(1.0)), "{from:?} {to:?}");
        assert!(strokes[1].length() > 100.0 && strokes[1].length() < 135.0, "{}", strokes[1].length());
    }

    #[test]
    fn what_is_no_stroke_is_named() {
        let problem = |picture: &Picture| trace_it(picture).unwrap_err().to_string();
        assert!(problem(&blank()).contains("holds no strokes"));
        assert!(problem(&Picture { alpha: None, ..blank() }).contains("no transparency"));
        let mut picture = blank();
        paint(&mut picture, [0, 0, 255], |s| (20.0 + 70.0 * s, 50.0), |_| 0.9);
        assert!(problem(&picture).contains("stroke 1, near ("), "{}", problem(&picture));
        assert!(problem(&picture).contains("as strong at one end as at the other"));
        let mut dot = blank();
        paint(&mut dot, [0, 0, 255], |_| (50.0, 50.0), |_| 0.9);
        assert!(problem(&dot).contains("as strong at one end") || problem(&dot).contains("is a dot"));
    }
}
