//! What every format is told before the first frame, and what it checks of each.

use std::path::Path;

use crate::base::error::{Error, Kind, Result};
use crate::raster::image::Rgb8;

/// Frames per second as a fraction in lowest terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRate {
    numerator: u32,
    denominator: u32,
}

impl FrameRate {
    /// The rate `fps`: whole numbers and the television rates (23.976, 29.97, 59.94… = 1000/1001 of a whole number)
    /// exactly, others to 1/1000.
    ///
    /// # Errors
    /// A rate outside 1 to 240.
    pub fn new(fps: f64) -> Result<Self> {
        if !(1.0..=240.0).contains(&fps) {
            return Err(Error::new(Kind::Usage, "frame rate", format!("{fps} frames per second")).allowed("1 to 240"));
        }
        let near = |n: f64, d: f64| (fps - n / d).abs() < 0.005;
        let (whole, television) = (fps.round(), (fps * 1.001).round() * 1000.0);
        let (numerator, denominator) = if (fps - whole).abs() < 0.0005 {
            (whole, 1.0)
        } else if near(television, 1001.0) {
            (television, 1001.0)
        } else {
            ((fps * 1000.0).round(), 1000.0)
        };
        let (numerator, denominator) = (numerator as u32, denominator as u32);
        let divisor = gcd(numerator, denominator);
        Ok(Self { numerator: numerator / divisor, denominator: denominator / divisor })
    }

    /// Numerator of the fraction.
    pub fn numerator(self) -> u32 {
        self.numerator
    }

    /// Denominator of the fraction.
    pub fn denominator(self) -> u32 {
        self.denominator
    }

    /// Frames per second.
    pub fn fps(self) -> f64 {
        f64::from(self.numerator) / f64::from(self.denominator)
    }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// What a sink has to know before the first frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SinkOptions {
    /// Width of every frame in pixels.
    pub width: usize,
    /// Height of every frame in pixels.
    pub height: usize,
    /// Frames per second.
    pub rate: FrameRate,
    /// Whether a player should start again at the end, where the format can say so (GIF, WebP, APNG).
    pub loops: bool,
    /// Whether every frame comes with its opacity; only PNG, WebP, APNG, NumPy arrays and (in one bit) GIF hold it.
    pub alpha: bool,
}

/// Refuses a frame of another size than was promised.
pub(super) fn check_frame(path: &Path, frame: &Rgb8, options: SinkOptions) -> Result<()> {
    let (width, height) = (options.width, options.height);
    if (frame.width, frame.height) == (width, height) && frame.data.len() == width * height * 3 {
        return Ok(());
    }
    let problem = format!("a frame of {} × {} pixels came", frame.width, frame.height);
    Err(Error::file(Kind::Data, path, problem).allowed(format!("{width} × {height}")))
}

/// Refuses opacity that was not announced, or that is of another size than the frame.
pub(super) fn check_alpha(path: &Path, frame: &Rgb8, alpha: &[u8], options: SinkOptions) -> Result<()> {
    if options.alpha && alpha.len() == frame.width * frame.height {
        return Ok(());
    }
    let problem = format!("opacity of {} pixels came with a frame of {} × {}", alpha.len(), frame.width, frame.height);
    Err(Error::file(Kind::Data, path, problem).allowed(if options.alpha { "one byte a pixel" } else { "none" }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_exact_fractions() {
        for (fps, fraction) in [
            (25.0, (25, 1)),
            (24.0, (24, 1)),
            (23.976, (24000, 1001)),
            (24000.0 / 1001.0, (24000, 1001)),
            (29.97, (30000, 1001)),
            (59.94, (60000, 1001)),
            (60.0, (60, 1)),
            (12.5, (25, 2)),
            (14.985, (15000, 1001)),
            (7.3, (73, 10)),
        ] {
            let rate = FrameRate::new(fps).unwrap();
            assert_eq!((rate.numerator(), rate.denominator()), fraction, "{fps}");
        }
        for fps in [0.0, -1.0, f64::NAN, f64::INFINITY, 1000.0] {
            assert_eq!(FrameRate::new(fps).unwrap_err().kind(), Kind::Usage);
        }
    }
}
