//! A synthesised fluid laid over the picture it belongs to, or over whatever is behind it.

use crate::base::par;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::premultiplied::Premultiplied;
use crate::raster::resample::Resizer;

/// Rows of a strip.
const STRIP: usize = 32;
/// Alpha below which nothing of a colour is left.
const NOTHING: f32 = 1.0 / 255.0;
/// Alpha from which a colour is sure enough to be stretched over all of its matte.
const SURE: f32 = 0.25;

/// What is seen around and behind the fluid, at output size.
#[derive(Debug, Clone)]
pub struct Overlay {
    /// The picture; where the matte is 0 its bytes stay.
    pub picture: Rgb8,
    /// How much of each pixel belongs to the fluid; none: as much as the fluid covers.
    pub matte: Option<Plane>,
    /// What is behind the fluid; without it the fluid fills the matte.
    pub behind: Option<Rgb8>,
}

impl Overlay {
    /// The frame with `fluid`, given at working size, and at output size what its colours have of finer detail.
    pub fn frame(&self, fluid: &Premultiplied, detail: Option<&[Plane; 3]>) -> Rgb8 {
        let mut out = self.picture.clone();
        self.each_row((fluid, detail), &mut out.data, 3, |y, row, colours| {
            for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
                let i = y * self.picture.width + x;
                let [red, green, blue, alpha] = colours(x);
                let matte = self.matte.as_ref().map_or(alpha, |m| m.data[i]);
                if matte <= 0.0 {
                    continue;
                }
                let cover = self.cover(alpha, matte);
                let scale = if alpha > 0.0 { cover / alpha } else { 0.0 };
                for (c, (byte, colour)) in pixel.iter_mut().zip([red, green, blue]).enumerate() {
                    let behind = self.behind.as_ref().map_or(f32::from(*byte), |b| f32::from(b.data[3 * i + c]));
                    let mixed = 255.0 * scale * colour + (matte - cover) * behind + (1.0 - matte) * f32::from(*byte);
                    *byte = (mixed.clamp(0.0, 255.0) + 0.5) as u8;
                }
            }
        });
        out
    }

    /// The fluid alone: its colours, not multiplied, black where nothing of it is seen, and how much of each pixel it
    /// covers, a byte each.
    pub fn alone(&self, fluid: &Premultiplied, detail: Option<&[Plane; 3]>) -> (Rgb8, Vec<u8>) {
        let (width, height) = (self.picture.width, self.picture.height);
        let mut bytes = vec![0; width * height * 4];
        self.each_row((fluid, detail), &mut bytes, 4, |y, row, colours| {
            for (x, pixel) in row.chunks_exact_mut(4).enumerate() {
                let [red, green, blue, alpha] = colours(x);
                let matte = self.matte.as_ref().map_or(alpha, |m| m.data[y * width + x]);
                let cover = (self.cover(alpha, matte) * 255.0 + 0.5) as u8;
                if cover > 0 {
                    let byte = |c: f32| ((c / alpha).clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
                    pixel.copy_from_slice(&[byte(red), byte(green), byte(blue), cover]);
                }
            }
        });
        let colours = bytes.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        (Rgb8 { width, height, data: colours }, bytes.iter().skip(3).step_by(4).copied().collect())
    }

    /// How much of a pixel the fluid covers.
    fn cover(&self, alpha: f32, matte: f32) -> f32 {
        match &self.behind {
            _ if alpha < NOTHING => 0.0,
            Some(_) => alpha.min(matte),
            None => matte * (alpha / SURE).min(1.0),
        }
    }

    /// Calls `f` for every row with its number, its bytes and the fluid's values in it.
    fn each_row(
        &self,
        (fluid, detail): (&Premultiplied, Option<&[Plane; 3]>),
        data: &mut [u8],
        bytes: usize,
        f: impl Fn(usize, &mut [u8], &dyn Fn(usize) -> [f32; 4]) + Sync + Send,
    ) {
        let (width, height) = (self.picture.width, self.picture.height);
        let resizer = Resizer::new(fluid.size(), (width, height));
        par::for_each_chunk(data, STRIP * width * bytes, |strip, rows| {
            let first = strip * STRIP;
            let end = (first + STRIP).min(height);
            let window = |p: &Plane| resizer.window(p, 0..width, first..end);
            let planes = fluid.planes.each_ref().map(window);
            for (j, row) in rows.chunks_exact_mut(width * bytes).enumerate() {
                let values = |x: usize| {
                    let alpha = planes[3].at(x, j).clamp(0.0, 1.0);
                    let finer = |c: usize| detail.map_or(0.0, |detail| detail[c].at(x, first + j));
                    let colour = |c: usize| (planes[c].at(x, j) + finer(c)).clamp(0.0, alpha);
                    [colour(0), colour(1), colour(2), alpha]
                };
                f(first + j, row, &values);
            }
        });
    }
}
