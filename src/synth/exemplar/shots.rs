//! A clip and the opacity that was filmed beside it, frame by frame.

use std::path::Path;

use super::opacity::{Opacity, Shot};
use crate::base::error::{Error, Kind, Result};
use crate::base::text::counted;
use crate::raster::image::Plane;
use crate::scene::exemplar::open_moving;
use crate::scene::exemplar_file::ExemplarFile;
use crate::video::clip::{RawFrame, Source, Turn};
use crate::video::conform::scale::to_rgb8;
use crate::video::conform::turned;

/// A clip that is read with its opacity.
pub struct Shots<'a> {
    /// Where the clip is.
    pub path: &'a Path,
    /// Where its opacity comes from.
    pub opacity: Opacity<'a>,
    clip: Box<dyn Source>,
    /// Frames that were read.
    count: u64,
}

/// A frame, and the one of its opacity where that is filmed beside it.
pub struct Pair {
    /// The frame.
    pub frame: RawFrame,
    opacity: Option<(RawFrame, Turn)>,
}

impl<'a> Shots<'a> {
    /// Opens the clip of an exemplar; none where it is a picture.
    ///
    /// # Errors
    /// Files that cannot be read; filmed opacity for a picture.
    pub fn open(exemplar: &'a ExemplarFile) -> Result<Option<Self>> {
        let (path, opacity) = (exemplar.frames.as_path(), Opacity::of(exemplar)?);
        match (open_moving(path)?, opacity) {
            (Some(clip), opacity) => Ok(Some(Self { path, opacity, clip, count: 0 })),
            (None, Opacity::Filmed(alpha, _)) => {
                Err(Error::file(Kind::Unusable, alpha, "moves, but the exemplar is a picture")
                    .remedy("give a grey picture of its opacity"))
            }
            (None, _) => Ok(None),
        }
    }

    /// The next frame, not yet converted: many are passed over.
    ///
    /// # Errors
    /// A damaged clip; opacity of fewer or more frames.
    pub fn next_pair(&mut self) -> Result<Option<Pair>> {
        let frame = self.clip.next_frame()?;
        self.count += u64::from(frame.is_some());
        let Opacity::Filmed(path, clip) = &mut self.opacity else {
            return Ok(frame.map(|frame| Pair { frame, opacity: None }));
        };
        let opacity = clip.next_frame()?;
        let problem = match (frame, opacity) {
            (Some(frame), Some(opacity)) => {
                return Ok(Some(Pair { frame, opacity: Some((opacity, clip.info().turn)) }));
            }
            (None, None) => return Ok(None),
            (Some(_), None) => format!("has only {}, the exemplar more", counted(self.count - 1, "frame")),
            (None, Some(_)) => format!("has more frames than the exemplar, which has {}", self.count),
        };
        Err(Error::file(Kind::Unusable, path, problem).remedy("give one for every frame of the exemplar"))
    }

    /// A frame with its opacity.
    pub fn shot(&self, pair: &Pair) -> Shot {
        let grey = |(frame, turn): &(RawFrame, Turn)| turned(to_rgb8(frame), *turn).luma();
        let filmed: Option<Plane> = pair.opacity.as_ref().map(grey);
        Shot::of_frame(&pair.frame, self.clip.info().turn, filmed)
    }
}
