//! Picture, working and output coordinates. Everything a person types or reads is in picture pixels.

use crate::base::error::{Error, Kind, Result};
use crate::library::variant::PIECE;
use crate::raster::resample::shrunk;

/// Position in pixels of the picture file, centres at ½.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PicturePoint(pub f32, pub f32);
/// Position in pixels of the working image, centres at ½.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorkingPoint(pub f32, pub f32);

/// Sizes of picture, working image and output, and the maps between their coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameMap {
    /// Width and height of the picture.
    pub picture: (usize, usize),
    /// Width and height of the working image.
    pub working: (usize, usize),
    /// Width and height of the output.
    pub output: (usize, usize),
}

/// Shortest side of a designed target at working size, pixels: a few patches of the exemplar methods.
pub const SMALLEST_TARGET: usize = 16;
/// Longest side of the output when no size is asked for.
pub const DEFAULT_LONG_SIDE: usize = 1920;

impl FrameMap {
    /// Sizes for a picture: the working image has a long side of `working_long` pixels, or the picture's own when that
    /// is smaller (pictures are never enlarged); the output is `size`, or the picture's size, at most
    /// [`DEFAULT_LONG_SIDE`] on its long side.
    ///
    /// # Errors
    /// A working image smaller than a piece, or an output of another shape than the picture.
    pub fn new(picture: (usize, usize), size: Option<[usize; 2]>, working_long: usize) -> Result<Self> {
        let map = Self::shaped(picture, size, working_long)?;
        map.at_least(PIECE, "picture", "the side of a piece of motion")?;
        Ok(map)
    }

    /// Sizes for a designed target, as [`FrameMap::new`] chooses them.
    ///
    /// # Errors
    /// A working image smaller than [`SMALLEST_TARGET`], or an output of another shape than the target.
    pub fn of_target(target: (usize, usize), size: Option<[usize; 2]>, working_long: usize) -> Result<Self> {
        let map = Self::shaped(target, size, working_long)?;
        map.at_least(SMALLEST_TARGET, "target", "room for a few patches")?;
        Ok(map)
    }

    /// Refuses a working image with a side under `least` pixels.
    fn at_least(&self, least: usize, what: &str, why: &str) -> Result<()> {
        let Self { picture, working, .. } = self;
        if working.0.min(working.1) >= least {
            return Ok(());
        }
        let problem = format!("too small: {} × {} pixels", picture.0, picture.1);
        let (shrunk, remedy) = if working == picture {
            (String::new(), format!("use a larger {what}"))
        } else {
            (format!(", {} × {} at working size", working.0, working.1), "give a larger --working-size".to_owned())
        };
        Err(Error::new(Kind::Unusable, what, problem + &shrunk)
            .allowed(format!("at least {least} pixels each way, {why}"))
            .remedy(remedy))
    }

    /// Sizes, however small.
    fn shaped(picture: (usize, usize), size: Option<[usize; 2]>, working_long: usize) -> Result<Self> {
        let (working, output) = (shrunk(picture, working_long), shrunk(picture, DEFAULT_LONG_SIDE));
        let output = size.map_or(output, |[w, h]| (w, h));
        // Two pixels of rounding on the one side or the other: of a narrow picture, the short side rounds coarsely.
        let shape = picture.1 as f64 / picture.0 as f64;
        let (width, height) = ((output.1 as f64 / shape).round() as usize, (output.0 as f64 * shape).round() as usize);
        if output.1.abs_diff(height) > 2 && output.0.abs_diff(width) > 2 {
            return Err(Error::new(
                Kind::Usage,
                "output.size",
                format!("{} × {} has another shape than the picture", output.0, output.1),
            )
            .allowed(format!("{} × {height}", output.0)));
        }
        Ok(Self { picture, working, output })
    }

    /// From the picture to the working image.
    pub fn to_working(&self, p: PicturePoint) -> WorkingPoint {
        let ((pw, ph), (ww, wh)) = (self.picture, self.working);
        WorkingPoint(p.0 * ww as f32 / pw as f32, p.1 * wh as f32 / ph as f32)
    }

    /// Pixels of the output per pixel of the working image, along its width.
    pub fn enlarged(&self) -> f32 {
        self.output.0 as f32 / self.working.0 as f32
    }

    /// Pixels of the working image per pixel of the picture, for lengths and speeds.
    pub fn working_scale(&self) -> f32 {
        ((self.working.0 * self.working.1) as f32 / (self.picture.0 * self.picture.1) as f32).sqrt()
    }
}

/// Output size of a quick look: a quarter of the `size` asked for (or of the default), with a long side of
/// [`PREVIEW_LONG_SIDE`] pixels at least where the output has that many.
pub fn preview_size(picture: (usize, usize), size: Option<[usize; 2]>) -> [usize; 2] {
    let output = size.map_or(shrunk(picture, DEFAULT_LONG_SIDE), |[w, h]| (w, h));
    let (width, height) = shrunk(output, (output.0.max(output.1) / 4).max(PREVIEW_LONG_SIDE));
    [width, height]
}

/// Working size of a quick look: at most `working` and [`PREVIEW_WORKING`] pixels on the long side, or as many more as
/// leave the short side the height of a piece.
pub fn preview_working(picture: (usize, usize), working: usize) -> usize {
    let (long, short) = (picture.0.max(picture.1), picture.0.min(picture.1));
    working.min(PREVIEW_WORKING.max((PIECE * long).div_ceil(short.max(1))))
}

/// Working size of a quick look, pixels, where the picture's shape allows it.
const PREVIEW_WORKING: usize = 320;
/// Smallest long side of a quick look.
const PREVIEW_LONG_SIDE: usize = 240;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_shrunk_but_never_enlarged() {
        let map = FrameMap::new((6000, 4000), None, 640).unwrap();
        assert_eq!((map.working, map.output), ((640, 427), (1920, 1280)));
        let map = FrameMap::new((100, 80), None, 640).unwrap();
        assert_eq!((map.working, map.output), ((100, 80), (100, 80)));
        assert_eq!(FrameMap::new((100, 80), Some([50, 40]), 640).unwrap().output, (50, 40));
    }

    #[test]
    fn small_pictures_and_other_shapes_are_refused() {
        assert!(FrameMap::new((1, 1), None, 640).unwrap_err().to_string().contains("at least 48 pixels"));
        assert!(FrameMap::new((4000, 200), None, 640).is_err());
        assert!(FrameMap::new((400, 300), Some([400, 400]), 640).unwrap_err().to_string().contains("400 × 300"));
    }

    #[test]
    fn a_quick_look_at_a_panorama_keeps_its_short_side() {
        assert_eq!(preview_working((1280, 720), 640), 320);
        assert_eq!(preview_working((1280, 720), 200), 200);
        for picture in [(4000, 480), (480, 4000), (3001, 300)] {
            let working = preview_working(picture, 640);
            let map = FrameMap::new(picture, Some(preview_size(picture, None)), working).unwrap();
            assert!(map.working.0.min(map.working.1) == PIECE && working < 640, "{picture:?}: {working}");
        }
    }

    #[test]
    fn corners_of_the_picture_are_corners_of_the_working_image() {
        let map = FrameMap::new((1280, 720), None, 640).unwrap();
        assert_eq!(map.to_working(PicturePoint(1280.0, 720.0)), WorkingPoint(640.0, 360.0));
        assert_eq!(map.to_working(PicturePoint(0.0, 0.0)), WorkingPoint(0.0, 0.0));
    }
}
