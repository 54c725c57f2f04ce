//! The picture taken apart into fluid and background, and put together again.

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{Observer, stage};
use crate::raster::image::{Color, Plane, Rgb8};
use crate::raster::resample::{resize_color, resize_rgb8};
use crate::render::composite::Compositor;
use crate::render::inpaint::inpaint;
use crate::render::layers::Layers;
use crate::scene::scene::Still;

/// Matte from which on a pixel is not taken to show what is behind the fluid.
const COVERED: f32 = 0.02;

/// The picture taken apart, for an outline that moves or fluid alone.
pub struct Separation {
    /// Fluid and background.
    pub layers: Layers,
    /// The background that was made, where none was given.
    pub made: Option<Rgb8>,
    /// How far the outline lets go of the matte.
    pub tau: f32,
}

impl Separation {
    /// The picture's layers, with an outline that stays.
    ///
    /// # Errors
    /// A background that shows the same as the picture; a cancel.
    pub fn standing(still: &Still, observer: &dyn Observer) -> Result<Self> {
        let (layers, made) = separate(still, observer)?;
        Ok(Self { layers, made, tau: 0.0 })
    }

    /// The fluid's colours, at working size.
    pub fn fluid(&self) -> &Color {
        &self.layers.fluid
    }

    /// Where the fluid is, 0 to 1, at working size. Around it, where it may come, its colours are drawn out from its edge
    /// and have no detail to carry.
    pub fn matte(&self) -> &Plane {
        &self.layers.matte
    }
}

/// Takes the picture apart into fluid and background, which is the user's or made here; the second value is what was
/// made here, at the picture's size, for a person to paint over.
///
/// # Errors
/// A background that shows the same as the picture; a cancel.
pub fn separate(still: &Still, observer: &dyn Observer) -> Result<(Layers, Option<Rgb8>)> {
    let (working, matte) = (&still.working, &still.working_matte);
    if let Some(background) = &still.background {
        let small = resize_rgb8(background, working.width(), working.height()).to_color();
        let layers = Layers::split((&still.picture, &still.matte), (working, matte), (background, &small), true);
        if layers.matte.data.iter().all(|&m| m < 1.0 / 255.0) {
            return Err(Error::new(
                Kind::Unusable,
                "background",
                "shows the same as the picture wherever the fluid is",
            )
            .remedy("give a picture of what is behind the fluid, or none to have one made"));
        }
        return Ok((layers, None));
    }
    let filled = made_up(still, observer)?;
    let (width, height) = (still.picture.width, still.picture.height);
    let background = resize_color(&filled, width, height).to_rgb8();
    let layers = Layers::split((&still.picture, &still.matte), (working, matte), (&background, &filled), false);
    let (width, height) = still.map.picture;
    let made = resize_rgb8(&layers.background, width, height);
    Ok((layers, Some(made)))
}

/// What is behind the fluid, at output size: the user's, or made up from the rest of the picture.
///
/// # Errors
/// A cancel.
pub fn background(still: &Still, observer: &dyn Observer) -> Result<Rgb8> {
    if let Some(background) = &still.background {
        return Ok(background.clone());
    }
    let filled = made_up(still, observer)?;
    Ok(resize_color(&filled, still.picture.width, still.picture.height).to_rgb8())
}

/// The working image without its fluid.
fn made_up(still: &Still, observer: &dyn Observer) -> Result<Color> {
    stage(observer, "background", 0, || {
        observer.note("no background given: what the fluid uncovers is made up from the rest of the picture");
        Ok(inpaint(&still.working, &still.working_matte.map(|m| if m > COVERED { 1.0 } else { 0.0 })))
    })
}

/// Puts a picture, taken apart or not, together over and over; `recovered` is what differences are added to.
pub fn compositor(still: &Still, apart: Option<&Separation>, recovered: &Color) -> Compositor {
    let (picture, working) = (still.picture.clone(), &still.working);
    match apart {
        None => Compositor::new(picture, &still.matte, working, &still.working_matte, recovered),
        Some(Separation { layers, .. }) => Compositor::layered(picture, &still.matte, working, layers, recovered),
    }
}
