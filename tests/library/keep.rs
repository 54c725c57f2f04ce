//! A sink that keeps the frames.

use enliven::base::error::Result;
use enliven::raster::image::Rgb8;
use enliven::video::clip::Sink;

/// Keeps the frames.
#[derive(Default)]
pub struct Keep(pub Vec<Rgb8>);

impl Sink for Keep {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        self.0.push(frame.clone());
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}
