//! What a decoder gives, and what a library clip is.

use serde::{Deserialize, Serialize};

use crate::base::error::{Error, Kind, Result};

/// Matrix between Y'CbCr and R'G'B'.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Matrix {
    /// ITU-R BT.601.
    Bt601,
    /// ITU-R BT.709.
    Bt709,
}

/// Range of the code values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Range {
    /// 16–235 for luma, 16–240 for chroma.
    Limited,
    /// 0–255.
    Full,
}

/// Pixels of a decoded frame as the codec stores them, planes without padding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Pixels {
    /// 8-bit Y'CbCr; chroma planes are `ceil(width / sx)` × `ceil(height / sy)`.
    Yuv {
        /// Luma, chroma blue, chroma red.
        planes: [Vec<u8>; 3],
        /// Horizontal and vertical chroma subsampling, each 1 or 2 (or 4 horizontally).
        subsampling: (u8, u8),
        /// Colour matrix, as tagged or assumed (see `ClipInfo`).
        matrix: Matrix,
        /// Range, as tagged or assumed.
        range: Range,
    },
    /// Packed 8-bit RGB with alpha.
    Rgba(Vec<u8>),
    /// Packed 8-bit RGB.
    Rgb(Vec<u8>),
}

/// One decoded frame in presentation order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawFrame {
    /// Width in stored pixels, before rotation.
    pub width: usize,
    /// Height in stored pixels, before rotation.
    pub height: usize,
    /// Presentation time in nanoseconds from the start of the edited presentation.
    pub time_ns: u64,
    /// The pixels.
    pub pixels: Pixels,
}

/// A turn to apply for display, clockwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Turn {
    /// As stored.
    #[default]
    None,
    /// 90° clockwise.
    Right,
    /// 180°.
    Half,
    /// 270° clockwise.
    Left,
}

/// What is known of a clip before its frames are decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct ClipInfo {
    /// Width in stored pixels.
    pub width: usize,
    /// Height in stored pixels.
    pub height: usize,
    /// Display rotation.
    pub turn: Turn,
    /// Frames, where the container says so.
    pub frames: Option<usize>,
    /// Duration in nanoseconds, where the container says so.
    pub duration_ns: Option<u64>,
    /// Codec, for people ("H.264 High", "VP9", "PNG folder").
    pub codec: String,
    /// Which decoder reads it ("embedded h264", "ffmpeg").
    pub decoder: &'static str,
}

/// A clip being read, frame by frame in presentation order; memory is bounded by the codec's own reordering.
pub trait Source: Send {
    /// What is known beforehand.
    fn info(&self) -> &ClipInfo;

    /// The next frame, or `None` after the last.
    ///
    /// # Errors
    /// A named error when the file is damaged; frames before the damage were delivered.
    fn next_frame(&mut self) -> Result<Option<RawFrame>>;
}

/// A place frames are written to, in order. The final name appears only on [`Sink::finish`].
pub trait Sink: Send {
    /// Writes one frame; all frames have the size given when the sink was made.
    ///
    /// # Errors
    /// When the disk is full or the encoder fails.
    fn push(&mut self, frame: &crate::raster::image::Rgb8) -> Result<()>;

    /// Writes one frame with its opacity, a byte per pixel, colours not multiplied by it; only for a sink that was made
    /// with [`SinkOptions::alpha`](super::write::options::SinkOptions::alpha).
    ///
    /// # Errors
    /// Those of [`Sink::push`]; a sink without alpha.
    fn push_with_alpha(&mut self, frame: &crate::raster::image::Rgb8, alpha: &[u8]) -> Result<()> {
        let _ = (frame, alpha);
        Err(Error::new(Kind::Unsupported, "output", "this format holds no alpha"))
    }

    /// Completes the file and gives it its final name; without this call nothing stays behind.
    ///
    /// # Errors
    /// When the file cannot be completed.
    fn finish(self: Box<Self>) -> Result<()>;
}
