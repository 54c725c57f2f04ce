//! Whether a clip can serve the library: steady camera, no cut or fade, something moving, long and large enough.

use std::fmt;
use std::ops::Range;

/// Fewest frames of a usable clip, at 25 frames/s (one window of the motion spectrum and a little more).
pub const MIN_FRAMES: usize = 40;

/// Why a clip, or a part of it, cannot be used.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// The camera moves: largest distance between two of its positions, in pixels of the working size.
    CameraMoves {
        /// That distance, over the measured frames.
        pixels: f32,
        /// Frames over which it was measured.
        frames: Range<usize>,
    },
    /// The whole picture changes at once: a cut, at this frame.
    Cut {
        /// First frame after it.
        frame: usize,
    },
    /// The whole picture changes within a second: a fade or cross-fade.
    Fade {
        /// Frames it takes.
        frames: Range<usize>,
    },
    /// The picture stands still for a second or more.
    Frozen {
        /// Those frames.
        frames: Range<usize>,
    },
    /// Fewer than [`MIN_FRAMES`] frames.
    TooShort {
        /// Frames there are, at 25 frames/s.
        frames: usize,
    },
    /// The picture has no room for pieces.
    TooSmall {
        /// Working width in pixels.
        width: usize,
        /// Working height in pixels.
        height: usize,
    },
    /// No area as large as a piece changes more than noise does.
    NothingMoves {
        /// Share of the picture that changes.
        share: f32,
    },
    /// Too few different frames per second.
    RateTooLow {
        /// Different frames per second.
        rate: f32,
    },
}

/// How the camera was judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Camera {
    /// Background was followed: largest distance between two camera positions, pixels of the working size.
    Measured {
        /// That distance.
        pixels: f32,
        /// Share of the clip's frames in which background could be followed.
        coverage: f32,
    },
    /// No background stays recognisable for long (the fluid fills the frame); the clip is taken as steady.
    NotMeasurable,
}

/// The judgement of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Frames read.
    pub frames: usize,
    /// The camera.
    pub camera: Camera,
    /// Share of the picture that changes more than noise does.
    pub moving: f32,
    /// What is wrong with the whole clip; empty when it can be used from end to end.
    pub reasons: Vec<Reason>,
    /// Longest stretch of at least [`MIN_FRAMES`] frames without any of the faults; the whole clip when accepted,
    /// `None` when refused.
    pub usable: Option<Range<usize>>,
}

impl Report {
    /// True when the whole clip can be used.
    pub fn accepted(&self) -> bool {
        self.reasons.is_empty()
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::CameraMoves { pixels, frames } => {
                write!(f, "camera moves: {pixels:.1} px in frames {} to {}", frames.start, frames.end)
            }
            Self::Cut { frame } => write!(f, "cut at frame {frame}"),
            Self::Fade { frames } => write!(f, "fade in frames {} to {}", frames.start, frames.end),
            Self::Frozen { frames } => write!(f, "frozen in frames {} to {}", frames.start, frames.end),
            Self::TooShort { frames } => write!(f, "too short: {frames} frames, needs {MIN_FRAMES}"),
            Self::TooSmall { width, height } => write!(f, "too small: {width} × {height} px"),
            Self::NothingMoves { share } => write!(f, "nothing moves: {:.1} % of the picture changes", share * 100.0),
            Self::RateTooLow { rate } => write!(f, "rate too low: {rate:.1} different frames per second"),
        }
    }
}
