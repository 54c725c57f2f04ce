//! Differences and outlines to frames that are written.

use std::borrow::Cow;

use crate::base::error::Result;
use crate::base::observe::{self, Observer, stage};
use crate::base::par;
use crate::raster::image::Plane;
use crate::render::composite::Compositor;
use crate::scene::scene::Scene;
use crate::synth::record::Timed;
use crate::video::clip::Sink;

/// Makes the frames of a picture that is carried without any differences, inside an outline that stays.
///
/// # Errors
/// A sink that fails, a cancel.
pub fn carry(
    scene: &Scene,
    compositor: &Compositor,
    matte: &Plane,
    sink: &mut dyn Sink,
    observer: &Timed,
) -> Result<()> {
    let none = Plane::zeros(matte.width, matte.height);
    show(scene, compositor, matte, |_| Cow::Borrowed(&none), sink, observer)
}

/// Makes the frames that have `differences(t)`, inside an outline that stays.
///
/// # Errors
/// A sink that fails, a cancel.
pub fn show<'f>(
    scene: &Scene,
    compositor: &Compositor,
    matte: &'f Plane,
    differences: impl Fn(usize) -> Cow<'f, Plane> + Sync + Send,
    sink: &mut dyn Sink,
    observer: &Timed,
) -> Result<()> {
    let wanted = scene.wanted_frames();
    let mut writer = Writer::new(compositor, scene, sink, observer);
    let frame = |i: usize| (wanted.start + i, differences(wanted.start + i), matte);
    stage(observer, "frames", wanted.len() as u64, || writer.write(wanted.len(), frame))
}

/// Puts frames together and hands them on.
pub struct Writer<'a> {
    compositor: &'a Compositor,
    alpha: bool,
    sink: &'a mut dyn Sink,
    observer: &'a Timed<'a>,
}

impl<'a> Writer<'a> {
    /// Writes the frames of a scene into `sink`.
    pub fn new(compositor: &'a Compositor, scene: &Scene, sink: &'a mut dyn Sink, observer: &'a Timed<'a>) -> Self {
        Self { compositor, alpha: scene.settings().output.alpha, sink, observer }
    }

    /// Writes some frames, given by number, luma differences and outline; one is made while the one before is written.
    ///
    /// # Errors
    /// A sink that fails, a cancel.
    pub fn write<'f>(
        &mut self,
        count: usize,
        frame: impl Fn(usize) -> (usize, Cow<'f, Plane>, &'f Plane) + Sync + Send,
    ) -> Result<()> {
        let (compositor, alpha, observer) = (self.compositor, self.alpha, self.observer);
        let make = |i: usize| {
            let (t, differences, outline) = frame(i);
            Ok(if alpha {
                let (fluid, opacity) = compositor.fluid(t, &differences, outline);
                (fluid, Some(opacity))
            } else {
                (compositor.frame(t, &differences, outline), None)
            })
        };
        par::ordered_map(0..count, 2, make, |_, (frame, opacity)| {
            observe::check(observer)?;
            match opacity {
                Some(opacity) => self.sink.push_with_alpha(&frame, &opacity)?,
                None => self.sink.push(&frame)?,
            }
            observer.advance("frames", 1);
            Ok(())
        })
    }
}
