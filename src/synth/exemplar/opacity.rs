//! The opacity of an exemplar's frames: their own, painted or filmed beside them, or told by brightness or darkness.

use std::path::Path;

use crate::base::error::Result;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::picture_io::{Picture, read_grey};
use crate::raster::premultiplied::Premultiplied;
use crate::scene::exemplar::{open_moving, same_size};
use crate::scene::exemplar_file::{self, ExemplarFile};
use crate::video::clip::{Pixels, RawFrame, Source, Turn};
use crate::video::conform::scale::to_rgb8;
use crate::video::conform::turned;

/// Brightness below which footage on black is taken for its noise, in [0, 1]; on white the same of darkness.
const FAINT: f32 = 0.03;
/// Brightness from which it is opaque: flames are bright long before they are white.
const FULL: f32 = 0.5;

/// Where opacity comes from.
pub enum Opacity<'a> {
    /// The file's own, or opaque all over.
    Own,
    /// Footage on black.
    Bright,
    /// Footage on white.
    Dark,
    /// A picture for all frames.
    Painted(&'a Path, Plane),
    /// A clip with a frame for each.
    Filmed(&'a Path, Box<dyn Source>),
}

/// The colours of a frame, and what opacity came with them.
pub struct Shot {
    /// Red, green and blue; those of a clip with opacity are over black.
    pub colours: Rgb8,
    /// The file's own opacity, where it has any.
    pub own: Option<Plane>,
    /// Whether the colours are multiplied by it.
    multiplied: bool,
    /// The opacity that was filmed beside it.
    filmed: Option<Plane>,
}

impl Shot {
    /// A picture.
    pub fn of_picture(Picture { rgb, alpha }: Picture) -> Self {
        let own = alpha.map(|alpha| plane_of(alpha.iter(), &rgb));
        Self { colours: rgb, own, multiplied: false, filmed: None }
    }

    /// A frame of a clip that is to be turned by `turn`, with its opacity where that was filmed beside it.
    pub fn of_frame(frame: &RawFrame, turn: Turn, filmed: Option<Plane>) -> Self {
        let rgb = to_rgb8(frame);
        let own = match &frame.pixels {
            Pixels::Rgba(pixels) if pixels.chunks_exact(4).any(|p| p[3] < 255) => {
                Some(plane_of(pixels.iter().skip(3).step_by(4), &rgb))
            }
            _ => None,
        };
        // The only frames with opacity are of animations, which have no turn.
        let colours = if own.is_some() { rgb } else { turned(rgb, turn) };
        Self { colours, own, multiplied: true, filmed }
    }
}

impl<'a> Opacity<'a> {
    /// Opens what an exemplar says of its opacity.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn of(exemplar: &'a ExemplarFile) -> Result<Self> {
        Ok(match &exemplar.opacity {
            None => Self::Own,
            Some(exemplar_file::Opacity::Luminance) => Self::Bright,
            Some(exemplar_file::Opacity::Darkness) => Self::Dark,
            Some(exemplar_file::Opacity::File(path)) => match open_moving(path)? {
                Some(clip) => Self::Filmed(path, clip),
                None => Self::Painted(path, read_grey(path)?),
            },
        })
    }

    /// The opacity of a frame, in [0, 1].
    ///
    /// # Errors
    /// One of another size than the frame.
    pub fn alpha(&self, shot: &Shot) -> Result<Plane> {
        let Rgb8 { width, height, .. } = shot.colours;
        let (given, path) = match self {
            Self::Bright => return Ok(ramp(&shot.colours, |[r, g, b]| r.max(g).max(b))),
            Self::Dark => return Ok(ramp(&shot.colours, |[r, g, b]| 1.0 - r.min(g).min(b))),
            Self::Own => (shot.own.as_ref(), None),
            Self::Painted(path, plane) => (Some(plane), Some(path)),
            Self::Filmed(path, _) => (shot.filmed.as_ref(), Some(path)),
        };
        let Some(plane) = given else { return Ok(Plane::filled(width, height, 1.0)) };
        path.map_or(Ok(()), |path| same_size(path, (plane.width, plane.height), (width, height)))?;
        Ok(plane.clone())
    }

    /// A frame with its opacity, multiplied by it.
    ///
    /// # Errors
    /// Opacity of another size.
    pub fn multiplied(&self, shot: &Shot) -> Result<Premultiplied> {
        let (alpha, colour) = (self.alpha(shot)?, shot.colours.to_color());
        let done = match self {
            // What the camera saw is colour times opacity already,
            Self::Bright => true,
            // and white through the rest.
            Self::Dark => {
                let fluid = |plane: &Plane| {
                    let parts = plane.data.iter().zip(&alpha.data).map(|(c, a)| c - (1.0 - a));
                    Plane::from_vec(plane.width, plane.height, parts.collect())
                };
                let [red, green, blue] = colour.planes.each_ref().map(fluid);
                return Ok(Premultiplied::from_planes([red, green, blue, alpha]));
            }
            Self::Own => shot.own.is_some() && shot.multiplied,
            Self::Painted(..) | Self::Filmed(..) => false,
        };
        if !done {
            return Ok(Premultiplied::new(&colour, &alpha));
        }
        let [red, green, blue] = colour.planes;
        Ok(Premultiplied::from_planes([red, green, blue, alpha]))
    }
}

/// Opacity that grows with what `strength` makes of the colours.
fn ramp(rgb: &Rgb8, strength: impl Fn([f32; 3]) -> f32) -> Plane {
    let [red, green, blue] = rgb.to_color().planes;
    let strengths = (0..red.data.len()).map(|i| strength([red.data[i], green.data[i], blue.data[i]]));
    let alpha = strengths.map(|s| ((s - FAINT) / (FULL - FAINT)).clamp(0.0, 1.0));
    Plane::from_vec(rgb.width, rgb.height, alpha.collect())
}

fn plane_of<'b>(bytes: impl Iterator<Item = &'b u8>, rgb: &Rgb8) -> Plane {
    Plane::from_vec(rgb.width, rgb.height, bytes.map(|byte| f32::from(*byte) / 255.0).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ink_on_white_is_what_covers_the_paper() {
        // Paper, ink that covers three quarters, and ink that covers all.
        let (ink, paper) = ([0.2f32, 0.1, 0.4], 1.0);
        let over = |a: f32| ink.map(|f| ((a * f + (1.0 - a) * paper) * 255.0).round() as u8);
        let data = [[255; 3], over(0.75), over(1.0)].concat();
        let shot = Shot::of_picture(Picture { rgb: Rgb8 { width: 3, height: 1, data }, alpha: None });
        let frame = Opacity::Dark.multiplied(&shot).unwrap();
        assert_eq!(frame.alpha().data, [0.0, 1.0, 1.0]);
        for (c, ink) in ink.into_iter().enumerate() {
            assert_eq!(frame.planes[c].data[0], 0.0, "paper leaves nothing");
            assert!((frame.planes[c].data[2] - ink).abs() < 0.003);
            // Over white again, all is as it was.
            for i in 0..3 {
                let again = frame.planes[c].data[i] + 1.0 - frame.alpha().data[i];
                assert!((again - f32::from(shot.colours.data[3 * i + c]) / 255.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn faint_ink_is_faint() {
        let shot = |grey: u8| {
            let rgb = Rgb8 { width: 1, height: 1, data: vec![grey; 3] };
            Opacity::Dark.alpha(&Shot::of_picture(Picture { rgb, alpha: None })).unwrap().data[0]
        };
        assert_eq!((shot(250), shot(127), shot(0)), (0.0, 1.0, 1.0));
        assert!(shot(191) > 0.4 && shot(191) < 0.6, "{}", shot(191));
    }
}
