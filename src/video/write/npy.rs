//! Frames as one NumPy array `(t, y, x, channel)` of bytes: red, green, blue, and opacity where there is any.

use std::path::{Path, PathBuf};

use super::options::{SinkOptions, check_alpha, check_frame};
use crate::base::error::{Error, Kind, Result};
use crate::raster::image::Rgb8;
use crate::raster::npy;
use crate::video::clip::Sink;

/// Writes an `.npy` file, frame by frame.
#[derive(Debug)]
pub struct NpyWriter {
    out: npy::Writer<u8>,
    path: PathBuf,
    options: SinkOptions,
    frames: usize,
}

impl NpyWriter {
    /// Opens a file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn create(path: &Path, options: SinkOptions) -> Result<Self> {
        let channels = if options.alpha { 4 } else { 3 };
        let out = npy::Writer::create(path, &[options.height, options.width, channels])?;
        Ok(Self { out, path: path.to_owned(), options, frames: 0 })
    }
}

impl Sink for NpyWriter {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        check_frame(&self.path, frame, self.options)?;
        self.frames += 1;
        self.out.push(&frame.data)
    }

    fn push_with_alpha(&mut self, frame: &Rgb8, alpha: &[u8]) -> Result<()> {
        check_frame(&self.path, frame, self.options)?;
        check_alpha(&self.path, frame, alpha, self.options)?;
        self.frames += 1;
        let pixels = frame.data.chunks_exact(3).zip(alpha);
        self.out.push(&pixels.flat_map(|(p, &a)| [p[0], p[1], p[2], a]).collect::<Vec<u8>>())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        if self.frames == 0 {
            return Err(Error::file(Kind::Unusable, &self.path, "no frame was written"));
        }
        self.out.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::video::write::options::FrameRate;
    use crate::video::write::sink::create;

    #[test]
    fn frames_and_opacity_are_read_back_as_one_array() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let rate = FrameRate::new(25.0).unwrap();
        let frame = |t: usize| Rgb8 { width: 4, height: 3, data: (0..36).map(|i| (5 * i + 40 * t) as u8).collect() };
        for alpha in [false, true] {
            let mut sink = create(&path, SinkOptions { width: 4, height: 3, rate, loops: true, alpha }).unwrap();
            for t in 0..2 {
                match alpha {
                    true => sink.push_with_alpha(&frame(t), &[200; 12]).unwrap(),
                    false => sink.push(&frame(t)).unwrap(),
                }
            }
            sink.finish().unwrap();
            let read = npy::read_array(&path).unwrap();
            assert_eq!(read.shape(), [2, 3, 4, if alpha { 4 } else { 3 }]);
            assert_eq!(read[[1, 2, 3, 1]], f32::from(frame(1).pixel(3, 2)[1]) / 255.0);
            assert!(!alpha || read[[0, 1, 1, 3]] == 200.0 / 255.0);
        }
    }
}
