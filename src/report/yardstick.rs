//! What the videos of a scene are measured against, read once for all of them.

use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;

use crate::base::error::Result;
use crate::base::observe::{Observer, stage};
use crate::measure::Footage;
use crate::measure::footage::LONG_SIDE;
use crate::measure::read;
use crate::raster::image::Plane;
use crate::raster::picture_io::read_matte;
use crate::raster::resample::resize_rgb8;
use crate::scene::asked::Asked;
use crate::scene::designed::Designed;
use crate::scene::scene::{Scene, Still};

/// The real clip that videos should move like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reference {
    /// The clip; none: the scene's.
    pub clip: Option<PathBuf>,
    /// Grey picture of the clip's shape, white where its fluid is; none: the scene's matte where the clip has the videos'
    /// size, else all of it.
    pub matte: Option<PathBuf>,
    /// Long side in pixels that it is measured at.
    pub long_side: usize,
}

impl Default for Reference {
    fn default() -> Self {
        Self { clip: None, matte: None, long_side: LONG_SIDE }
    }
}

/// A scene and a real clip, as videos are measured against them.
pub struct Yardstick {
    scene: Option<Scene>,
    still: Option<Still>,
    /// Where a designed target is opaque in any frame.
    reach: Option<Plane>,
    reference: Reference,
    fitted: RefCell<Option<Rc<Fitted>>>,
}

/// Picture and clip at the size and rate of a video.
pub struct Fitted {
    size: (usize, usize),
    fps: f32,
    /// The picture it was made from; none for a designed target: what is behind it does not look like its fluid.
    pub picture: Option<Footage>,
    /// The real clip.
    pub reference: Option<(PathBuf, Footage)>,
}

impl Yardstick {
    /// Reads the scene's pixels.
    ///
    /// # Errors
    /// A scene that cannot be read; a cancel.
    pub fn read(scene: Option<Scene>, reference: Reference, observer: &dyn Observer) -> Result<Self> {
        let still = scene.as_ref().map(|scene| scene.still(observer)).transpose()?;
        let reach = scene.as_ref().and_then(Scene::designed).map(Designed::reach).transpose()?;
        Ok(Self { scene, still, reach, reference, fitted: RefCell::new(None) })
    }

    /// The scene's pixels.
    pub fn still(&self) -> Option<&Still> {
        self.still.as_ref()
    }

    /// Where the videos have fluid.
    pub fn matte(&self) -> Option<&Plane> {
        self.reach.as_ref().or(self.still.as_ref().map(|still| &still.matte))
    }

    /// Where the scene as a whole asks its fluid to go; none where it asks nothing.
    pub fn direction(&self) -> Option<(f32, f32)> {
        let (asked, _) = self.asked()?;
        let sum = |plane: &Plane| plane.data.iter().sum::<f32>();
        Some((sum(&asked.direction.u), sum(&asked.direction.v))).filter(|&(u, v)| u != 0.0 || v != 0.0)
    }

    /// What the scene asks, and its frames per second.
    pub(super) fn asked(&self) -> Option<(&Asked, f32)> {
        self.still.as_ref().and_then(|still| still.asked.as_ref()).zip(self.rate())
    }

    /// The scene's designed target, and its frames per second.
    pub(super) fn target(&self) -> Option<(&Designed, f32)> {
        self.scene.as_ref().and_then(Scene::designed).zip(self.rate())
    }

    fn rate(&self) -> Option<f32> {
        self.scene.as_ref().map(|scene| scene.settings().output.fps)
    }

    /// Picture and clip for videos of `size` pixels and `fps` frames per second; read anew only for others than before.
    ///
    /// # Errors
    /// A clip that cannot be read or does not fit; a cancel.
    pub fn fitted(&self, size: (usize, usize), fps: f32, observer: &dyn Observer) -> Result<Rc<Fitted>> {
        let before = self.fitted.borrow().clone();
        if let Some(fitted) = before.filter(|fitted| fitted.size == size && fitted.fps == fps) {
            return Ok(fitted);
        }
        let pictured = self.still.as_ref().filter(|_| self.reach.is_none());
        let picture = pictured
            .map(|still| Footage::still(resize_rgb8(&still.picture, size.0, size.1), self.matte()))
            .transpose()?;
        let fitted = Rc::new(Fitted { size, fps, picture, reference: self.clip(size, fps, observer)? });
        Ok(self.fitted.borrow_mut().insert(fitted).clone())
    }

    fn clip(&self, size: (usize, usize), fps: f32, observer: &dyn Observer) -> Result<Option<(PathBuf, Footage)>> {
        let of_scene = || self.scene.as_ref().and_then(|scene| scene.settings().reference.clone());
        let Some(path) = self.reference.clip.clone().or_else(of_scene) else { return Ok(None) };
        let long_side = self.reference.long_side;
        let frames = stage(observer, "read reference", 0, || read::reference(&path, fps, long_side, observer))?;
        let same = frames.first().is_some_and(|f| (f.width, f.height) == size);
        let own = self.reference.matte.as_deref().map(read_matte).transpose()?;
        if own.is_none() && self.matte().is_some() {
            let where_from = if same { "the scene's matte" } else { "all of it counts" };
            observer.note(&format!("{}: no matte of its own: {where_from}", path.display()));
        }
        let matte = own.as_ref().or(self.matte().filter(|_| same));
        let footage = Footage::new(frames, fps, false, matte).map_err(|error| {
            let subject = self.reference.matte.as_deref().unwrap_or(&path);
            error.about(subject.display())
        })?;
        Ok(Some((path, footage)))
    }
}
