//! Frames in an `.npy` file, read as a clip of 25 pictures per second: grey, RGB, or RGB and opacity.

use std::path::Path;

use super::folder::PERIOD_NS;
use crate::base::error::{Error, Kind, Result};
use crate::raster::npy;
use crate::video::clip::{ClipInfo, Pixels, RawFrame, Source, Turn};

/// An open file.
pub struct Array {
    info: ClipInfo,
    frames: npy::Frames,
    next: usize,
}

/// Opens a file; its frames are read one by one.
///
/// # Errors
/// Those of [`npy::Frames::open`]; channels that are no colours.
pub fn open(path: &Path) -> Result<Array> {
    let frames = npy::Frames::open(path)?;
    let [count, height, width, channels] = frames.shape();
    if ![1, 3, 4].contains(&channels) {
        return Err(Error::file(Kind::Data, path, format!("has {channels} channels, which are no colours"))
            .allowed("1 (grey), 3 (red, green, blue) or 4 (with opacity)"));
    }
    let info = ClipInfo {
        width,
        height,
        turn: Turn::None,
        frames: Some(count),
        duration_ns: Some(count as u64 * PERIOD_NS),
        codec: "NumPy array".into(),
        decoder: "embedded npy",
    };
    Ok(Array { info, frames, next: 0 })
}

impl Source for Array {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<RawFrame>> {
        let [count, height, width, channels] = self.frames.shape();
        if self.next == count {
            return Ok(None);
        }
        let frame = self.frames.frame(self.next)?;
        let bytes = frame.iter().map(|v| (v * 255.0 + 0.5) as u8);
        let pixels = match channels {
            1 => Pixels::Rgb(bytes.flat_map(|grey| [grey; 3]).collect()),
            3 => Pixels::Rgb(bytes.collect()),
            _ => Pixels::Rgba(bytes.collect()),
        };
        let time_ns = self.next as u64 * PERIOD_NS;
        self.next += 1;
        Ok(Some(RawFrame { width, height, time_ns, pixels }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::video::conform::scale::to_rgb8;
    use ndarray::Array4;

    #[test]
    fn grey_and_colours_become_frames() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        for channels in [1, 3] {
            let array = Array4::from_shape_fn((3, 2, 5, channels), |(t, _, x, c)| (50 * t + 10 * x + c) as u8);
            npy::write_array(&path, array.view()).unwrap();
            let mut clip = open(&path).unwrap();
            assert_eq!((clip.info().width, clip.info().height, clip.info().frames), (5, 2, Some(3)));
            let frames: Vec<_> = std::iter::from_fn(|| clip.next_frame().unwrap()).collect();
            assert_eq!((frames.len(), frames[2].time_ns), (3, 2 * PERIOD_NS));
            let last = if channels == 1 { [140; 3] } else { [140, 141, 142] };
            assert_eq!(to_rgb8(&frames[2]).pixel(4, 1), last);
        }
        npy::write_array(&path, Array4::<f32>::zeros((1, 2, 5, 2)).view()).unwrap();
        let error = open(&path).map(drop).unwrap_err().to_string();
        assert!(error.contains("2 channels") && error.contains("a.npy"), "{error}");
    }
}
