//! The part of a run in which the fluid's outline moves: taking the picture apart, and following the frames.

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{Observer, stage};
use crate::base::par;
use crate::raster::image::{Color, Plane, Rgb8};
use crate::raster::resample::{resize_color, resize_rgb8};
use crate::render::boundary::{Boundary, flicker, fluid_flow};
use crate::render::composite::local_contrast;
use crate::render::inpaint::inpaint;
use crate::render::layers::Layers;
use crate::scene::scene::Still;
use crate::synth::methods::database::Run;

/// How far fire and smoke let go of their matte when nobody says otherwise (Okabe et al. 2011, §6).
const LOOSE: f32 = 0.9;
/// Matte from which on a pixel is not taken to show what is behind the fluid.
const COVERED: f32 = 0.02;

/// How far the outline lets go of the matte: the option, or where that is negative what the clips' fluid wants.
/// `tags` are those of the pieces, one per node.
pub fn looseness(run: &Run, tags: &[&str]) -> f32 {
    let (asked, name) = (run.options.tau, run.name);
    if asked >= 0.0 {
        return asked;
    }
    let loose = tags.iter().filter(|tag| ["fire", "smoke"].contains(tag)).count();
    if 2 * loose <= tags.len() || run.still.matte.data.iter().all(|&m| m == 1.0) {
        return 0.0;
    }
    run.observer
        .note(&format!("fire and smoke: the outline moves ({name}.tau = {LOOSE}); it stays with --set {name}.tau=0"));
    LOOSE
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

/// The outline of every frame, in order.
#[derive(Clone)]
pub struct Outline {
    state: Option<Moving>,
    matte: Plane,
}

/// An outline that moves, within the part of the picture that it can reach.
#[derive(Clone)]
struct Moving {
    boundary: Boundary,
    /// Left, top, width and height of that part, working pixels.
    part: [usize; 4],
    /// The part's matte, and its luma without differences.
    matte: Plane,
    still: Plane,
    /// The fluid's contrast, and how much the outline flickers with it.
    contrast: Plane,
    flicker: f32,
    last: Option<Plane>,
}

impl Outline {
    /// An outline that stays at the matte.
    pub fn fixed(matte: &Plane) -> Self {
        Self { state: None, matte: matte.clone() }
    }

    /// An outline that lets go of the matte of `layers` by `tau` and opens and closes with the texture by `flicker`;
    /// `luma` is that of the recovered fluid.
    pub fn new(layers: &Layers, luma: &Plane, tau: f32, flicker: f32) -> Self {
        let part = extent(&layers.reach);
        let matte = crop(&layers.matte, part);
        let boundary = Boundary::new(&matte, tau);
        let contrast = crop(&local_contrast(&layers.fluid, &layers.matte), part);
        let still = crop(luma, part);
        let state = (tau > 0.0).then_some(Moving { boundary, part, matte, still, contrast, flicker, last: None });
        Self { state, matte: layers.matte.clone() }
    }

    /// The outlines of consecutive frames, given as luma differences at working size.
    pub fn follow(&mut self, differences: &[Plane]) -> Vec<Plane> {
        let Some(moving) = &mut self.state else { return vec![self.matte.clone(); differences.len()] };
        let mut lumas: Vec<Plane> = moving.last.take().into_iter().collect();
        let started = lumas.len();
        lumas.extend(differences.iter().map(|d| moving.luma(d)));
        let flows = par::map(lumas.len().saturating_sub(1), |i| fluid_flow(&lumas[i], &lumas[i + 1], &moving.matte));
        let mut outlines = Vec::with_capacity(differences.len());
        if started == 0 && !differences.is_empty() {
            outlines.push(moving.whole(&self.matte, &differences[0]));
        }
        for flow in &flows {
            moving.boundary.step(flow);
            outlines.push(moving.whole(&self.matte, &differences[outlines.len()]));
        }
        moving.last = lumas.pop();
        outlines
    }
}

impl Moving {
    fn luma(&self, differences: &Plane) -> Plane {
        let mut luma = crop(differences, self.part);
        luma.data.iter_mut().zip(&self.still.data).for_each(|(l, s)| *l = (*l + s).clamp(0.0, 1.0));
        luma
    }

    /// The outline of a frame on the whole working image, of the matte's size.
    fn whole(&self, matte: &Plane, differences: &Plane) -> Plane {
        let [x, y, w, _] = self.part;
        let mut now = self.boundary.now().clone();
        flicker(&mut now, &crop(differences, self.part), &self.contrast, self.flicker);
        let mut out = Plane::zeros(matte.width, matte.height);
        for (j, row) in now.data.chunks_exact(w.max(1)).enumerate() {
            out.row_mut(y + j)[x..x + w].copy_from_slice(row);
        }
        out
    }
}

/// Left, top, width and height of the part of a plane that is above 0.
fn extent(plane: &Plane) -> [usize; 4] {
    let columns = (0..plane.width).filter(|&x| (0..plane.height).any(|y| plane.at(x, y) > 0.0));
    let rows = (0..plane.height).filter(|&y| plane.row(y).iter().any(|&v| v > 0.0));
    let span = |mut places: Box<dyn Iterator<Item = usize> + '_>| {
        let first = places.next().unwrap_or(0);
        (first, places.last().unwrap_or(first) + 1 - first)
    };
    let ((x, width), (y, height)) = (span(Box::new(columns)), span(Box::new(rows)));
    [x, y, width, height]
}

fn crop(plane: &Plane, [x, y, width, height]: [usize; 4]) -> Plane {
    let data = (y..y + height).flat_map(|y| &plane.row(y)[x..x + width]).copied().collect();
    Plane::from_vec(width, height, data)
}
