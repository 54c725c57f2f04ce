//! What every embedded codec offers a container: packets in, pictures out.

use crate::video::clip::Pixels;

/// Most pixels a frame may have; larger ones are refused before anything is allocated.
pub const MAX_PIXELS: usize = 1 << 26;

/// A decoded picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// The pixels.
    pub pixels: Pixels,
}

/// Why a packet gave no picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The packet is damaged.
    Damaged(String),
    /// The packet uses a part of the codec that the embedded decoder lacks.
    Unsupported(String),
}

/// One codec. A packet is what a container stores as one sample.
pub trait VideoDecoder: Send {
    /// Decodes one packet; `None` when it holds no picture to show.
    ///
    /// # Errors
    /// When the packet is damaged or beyond this decoder.
    fn decode(&mut self, packet: &[u8]) -> Result<Option<Picture>, Failure>;

    /// Forgets all earlier packets, before decoding goes on from another key frame.
    fn reset(&mut self);
}

/// Runs `decode`, turning a panic inside a codec library into a failure: a damaged file must never end the program.
pub(super) fn guarded<T>(decode: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode))
        .unwrap_or_else(|_| Err(Failure::Damaged("the decoder gave up on it".into())))
}
