//! Detail finer than a working pixel, for outputs that are larger: voted from the exemplar at its finer size, through the
//! field that made the frame.

use std::ops::Range;

use super::chain::State;
use super::whole_pixels::shown;
use crate::base::par;
use crate::patch::data::patches::{Patches, Place};
use crate::patch::engine::Image;
use crate::raster::image::Plane;
use crate::raster::premultiplied::Premultiplied;
use crate::raster::resample::resize;

/// Output larger than the working image by less than this share has no detail of its own to show.
const LEAST: f32 = 1.05;

/// Alpha up to which colours are too faint to have detail.
const FAINT: f32 = 0.1;

/// What the exemplar has that its working size lacks, turned as its copies are.
#[derive(Debug, Clone)]
pub struct Detail {
    /// Red, green and blue at the finer size, less their enlarged working size, times alpha; one image a turn.
    turns: Vec<Vec<Plane>>,
    /// Output pixels per working pixel, and finer pixels per pixel of the exemplar.
    scale: (f32, f32),
    output: (usize, usize),
}

impl Detail {
    /// From an exemplar at its finer and at its working size, for frames of `output` made at `working`; `None` where the
    /// output is hardly the larger.
    pub fn new(
        fine: &Premultiplied,
        coarse: &Premultiplied,
        turned: bool,
        (working, output): ((usize, usize), (usize, usize)),
    ) -> Option<Self> {
        let scale = output.0 as f32 / working.0 as f32;
        let (width, height) = fine.size();
        if scale < LEAST || width <= coarse.size().0 {
            return None;
        }
        let alpha = resize(coarse.alpha(), width, height);
        let planes = (0..3).map(|c| {
            let mut plane = fine.planes[c].clone();
            let low = resize(&coarse.planes[c], width, height);
            // Less the coarse colour under the fine alpha, or every outline would be a line of detail.
            for (i, value) in plane.data.iter_mut().enumerate() {
                let sure = alpha.data[i] > FAINT;
                *value = if sure {
                    *value - fine.alpha().data[i] * (low.data[i] / alpha.data[i]).clamp(0.0, 1.0)
                } else {
                    0.0
                };
            }
            plane
        });
        let image = Image { planes: planes.collect(), blurred: None };
        let turns = if turned { image.quarter_turns().map(|i| i.planes).to_vec() } else { vec![image.planes] };
        Some(Self { turns, scale: (scale, width as f32 / coarse.size().0 as f32), output })
    }

    /// The detail of a frame at output size: that of the patches at the four working pixels around.
    pub fn of(&self, state: &State, patches: &Patches) -> [Plane; 3] {
        const ROWS: usize = 16;
        let ((width, height), owed) = (self.output, shown(&state.owed));
        let mut data = vec![0.0; width * height * 3];
        par::for_each_chunk(&mut data, ROWS * width * 3, |k, rows| {
            for (j, row) in rows.chunks_exact_mut(3 * width).enumerate() {
                for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
                    let at = |v: usize| (v as f32 + 0.5) / self.scale.0;
                    let (x, y) = (at(x), at(k * ROWS + j));
                    let (u, v) = (owed.u.bilinear(x, y), owed.v.bilinear(x, y));
                    self.pixel(state, patches, (x - u, y - v), pixel);
                }
            }
        });
        std::array::from_fn(|c| Plane::from_vec(width, height, data.iter().skip(c).step_by(3).copied().collect()))
    }

    /// The detail at a place of the working image, pixel centres at ½.
    fn pixel(&self, state: &State, patches: &Patches, (x, y): (f32, f32), out: &mut [f32]) {
        let (width, height) = state.layer.size();
        let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
        for (column, row) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (cx, cy) = (left + column, top + row);
            let weight = (1.0 - (x - 0.5 - cx).abs()) * (1.0 - (y - 0.5 - cy).abs());
            let inside = |v: f32, range: Range<usize>| v >= 0.0 && range.contains(&(v as usize));
            if weight <= 0.0 || !inside(cx, 0..width) || !inside(cy, 0..height) {
                continue;
            }
            let cell = state.field.cells[cy as usize * width + cx as usize];
            if cell.place == Place::NONE {
                continue;
            }
            let (turn, sx, sy) = patches.locate(cell.place);
            let (fx, fy) = ((sx as f32 + x - cx) * self.scale.1, (sy as f32 + y - cy) * self.scale.1);
            for (out, plane) in out.iter_mut().zip(&self.turns[turn]) {
                *out += weight * plane.bilinear(fx, fy);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::image::Color;

    /// A disc of one colour, or of stripes, at twice its working size.
    fn disc(stripes: f32) -> Detail {
        let (fine, coarse) = ((64, 48), (32, 24));
        let alpha =
            Plane::from_fn(fine.0, fine.1, |x, y| (18.0 - (x as f32 - 32.0).hypot(y as f32 - 24.0)).clamp(0.0, 1.0));
        let value = |base: f32| Plane::from_fn(fine.0, fine.1, |x, _| base + stripes * (x % 2) as f32);
        let fluid = Premultiplied::new(&Color::from_planes([value(0.6), value(0.3), value(0.1)]), &alpha);
        let small = Premultiplied::from_planes(fluid.planes.each_ref().map(|p| resize(p, coarse.0, coarse.1)));
        Detail::new(&fluid, &small, false, (coarse, fine)).unwrap()
    }

    #[test]
    fn an_outline_of_one_colour_has_no_detail_and_stripes_have() {
        let most = |detail: &Detail| detail.turns[0].iter().flat_map(|p| &p.data).fold(0.0f32, |m, v| m.max(v.abs()));
        assert!(most(&disc(0.0)) < 0.04, "{}", most(&disc(0.0)));
        assert!(most(&disc(0.3)) > 0.1, "{}", most(&disc(0.3)));
    }
}
