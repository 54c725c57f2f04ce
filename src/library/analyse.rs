//! From a clip's frames to its descriptor grids, in one streamed pass with bounded memory.
//!
//! Frames come in blocks of 16. While one block is analysed on all threads, the next is read. Per scale, each pair of
//! neighbouring frames gives a motion field; fields go into the mean motion, its mean length and, two blocks at a time,
//! the motion spectrum; frames go into the mean picture, the textureness and the temporal deviation.

use crate::base::error::Result;
use crate::raster::image::Rgb8;

use super::grid::CellGrid;
use super::variant::SCALES;

/// Where frames come from: the next frame, or `None` after the last.
pub trait Frames: Send {
    /// The next frame, all of one size.
    ///
    /// # Errors
    /// When the clip cannot be read any further.
    fn next_frame(&mut self) -> Result<Option<Rgb8>>;
}

impl<F: FnMut() -> Result<Option<Rgb8>> + Send> Frames for F {
    fn next_frame(&mut self) -> Result<Option<Rgb8>> {
        self()
    }
}

/// Mean of a clip's frames, red, green, blue, 16 bits for [0, 1].
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Average {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Three planes of `width * height` values; 65535 is 1.
    pub planes: [Vec<u16>; 3],
}

/// What the library keeps of a clip besides its frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Analysis {
    /// Frames seen.
    pub frames: usize,
    /// Mean picture ("representative image", Okabe et al. 2011, §4).
    pub average: Average,
    /// Descriptor grids, one per scale of [`SCALES`].
    pub grids: [CellGrid; SCALES.len()],
    /// Share of the pixels with significant motion, 0 to 1.
    pub significant: f32,
    /// Mean length of the motion over the significant pixels, working pixels per frame.
    pub activity: f32,
}
