//! How fast the texture of a clip travels, where optical flow sees next to nothing: in whitewater.

use super::reader::Pack;
use crate::base::error::Result;
use crate::flow::ensemble::{Shift, shift};
use crate::raster::image::Plane;
use crate::raster::pyramid::{collapse, laplacian, reduce};

/// Frames of a clip that are looked at.
const FRAMES: usize = 25;
/// Window that is followed and how far, pixels of the halved frame.
const SIDE: usize = 32;
const REACH: usize = 8;
/// Bands of the halved frame that are followed: coarser forms are light and shade.
const BANDS: usize = 3;
/// Less resemblance than this is chance.
const SURE: f32 = 0.2;

/// What changes in a clip, ready to be followed.
pub struct TextureMotion(Vec<Plane>);

impl TextureMotion {
    /// Side of the window that is followed, pixels of the clip.
    pub const WINDOW: usize = 2 * SIDE;

    /// Reads the first frames of a clip.
    ///
    /// # Errors
    /// A damaged pack.
    pub fn read(pack: &Pack, clip: u32) -> Result<Self> {
        let count = (pack.clips()[clip as usize].frames as usize).min(FRAMES);
        let mut reader = pack.frames(clip)?;
        let mut frames = Vec::with_capacity(count);
        // At half the size, without their average and without coarse forms.
        for t in 0..count {
            frames.push(collapse(&laplacian(&reduce(&reader.luma_at(t)?), BANDS).0, None));
        }
        let mut mean = Plane::zeros(frames[0].width, frames[0].height);
        let share = 1.0 / count as f32;
        frames.iter().for_each(|f| mean.data.iter_mut().zip(&f.data).for_each(|(m, v)| *m += share * v));
        frames.iter_mut().for_each(|f| f.data.iter_mut().zip(&mean.data).for_each(|(v, m)| *v -= m));
        Ok(Self(frames))
    }

    /// Motion of the texture around `(x, y)`, pixels of the clip per frame of it; `None` where none is found for sure.
    pub fn at(&self, x: f32, y: f32) -> Option<(f32, f32)> {
        match shift(&self.0, (0.5 * x, 0.5 * y), SIDE, REACH) {
            Some(Shift { motion: (u, v), correlation }) if correlation >= SURE => Some((2.0 * u, 2.0 * v)),
            _ => None,
        }
    }
}
