//! Frames to two places at once.

use crate::base::error::Result;
use crate::raster::image::Rgb8;
use crate::video::clip::Sink;

/// Hands every frame to both.
pub struct Both(pub Box<dyn Sink>, pub Box<dyn Sink>);

impl Sink for Both {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        self.0.push(frame)?;
        self.1.push(frame)
    }

    fn push_with_alpha(&mut self, frame: &Rgb8, alpha: &[u8]) -> Result<()> {
        self.0.push_with_alpha(frame, alpha)?;
        self.1.push_with_alpha(frame, alpha)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.0.finish()?;
        self.1.finish()
    }
}
