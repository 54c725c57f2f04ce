//! The picture taken apart: the fluid's own colours everywhere it may go, and what is behind it.

use super::boundary::envelope;
use super::extrapolate::fill;
use crate::raster::filter::gaussian;
use crate::raster::image::{Color, Plane, Rgb8};

/// A picture that differs from its background by less than the first shows none of the fluid, by more than the second
/// as much as the matte says; largest channel, in [0, 1].
const PRESENT: (f32, f32) = (0.02, 0.10);
/// Smoothing of that difference, pixels of the working image.
const PRESENT_SIGMA: f32 = 1.0;
/// Matte from which on what is behind the fluid is the background alone; below, the picture still has its say.
const HIDDEN: f32 = 0.125;

/// Fluid and background.
#[derive(Debug, Clone, PartialEq)]
pub struct Layers {
    /// The matte at working size, without what is not fluid (see [`Layers::tight`]).
    pub matte: Plane,
    /// Share of the painted matte that is kept, 0 to 1, at working size.
    pub tight: Plane,
    /// Where the fluid may come, above 0, at working size.
    pub reach: Plane,
    /// The fluid's colours at working size, continued outside the matte.
    pub fluid: Color,
    /// What is behind, at output size; the picture's own bytes where the matte is 0.
    pub background: Rgb8,
}

impl Layers {
    /// Takes a picture apart. `picture` and `matte` are at output size, `working` and `working_matte` at working size,
    /// `background` what a person (`known`) or the program thinks is behind the fluid, at output size, and
    /// `working_background` the same at working size.
    ///
    /// A matte painted generously round the flames holds background that must not flicker with them: where the picture
    /// is as its known background, there is no fluid.
    pub fn split(
        (picture, matte): (&Rgb8, &Plane),
        (working, working_matte): (&Color, &Plane),
        (background, working_background): (&Rgb8, &Color),
        known: bool,
    ) -> Self {
        let tight = if known { presence(working, working_background) } else { working_matte.map(|_| 1.0) };
        let pairs = working_matte.data.iter().zip(&tight.data);
        let tightened = Plane::from_vec(tight.width, tight.height, pairs.map(|(m, t)| m * t).collect());
        Self {
            reach: envelope(&tightened),
            fluid: unmix(working, &tightened, working_background),
            background: behind(picture, matte, background),
            matte: tightened,
            tight,
        }
    }
}

/// How surely the picture shows something else than its background, 0 to 1.
fn presence(picture: &Color, background: &Color) -> Plane {
    let mut largest = Plane::zeros(picture.width(), picture.height());
    for (p, b) in picture.planes.iter().zip(&background.planes) {
        let difference = p.data.iter().zip(&b.data).map(|(p, b)| (p - b).abs());
        largest.data.iter_mut().zip(difference).for_each(|(l, d)| *l = l.max(d));
    }
    gaussian(&largest, PRESENT_SIGMA).map(|d| {
        let t = ((d - PRESENT.0) / (PRESENT.1 - PRESENT.0)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    })
}

/// The fluid's colour: what the picture shows less the share of the background, the surer the fuller the matte, and
/// around it the colours within.
fn unmix(picture: &Color, matte: &Plane, background: &Color) -> Color {
    let planes: Vec<Plane> = picture
        .planes
        .iter()
        .zip(&background.planes)
        .map(|(p, b)| {
            let pairs = p.data.iter().zip(&b.data).zip(&matte.data);
            let colour = |((p, b), m): ((&f32, &f32), &f32)| ((p - (1.0 - m) * b) / m.max(1e-3)).clamp(0.0, 1.0);
            Plane::from_vec(p.width, p.height, pairs.map(colour).collect())
        })
        .collect();
    let filled = fill(&planes.iter().collect::<Vec<_>>(), &matte.map(|m| m * m));
    Color::from_planes(filled.try_into().expect("three planes"))
}

/// The background where the matte hides the picture, the picture's own bytes where it does not.
fn behind(picture: &Rgb8, matte: &Plane, background: &Rgb8) -> Rgb8 {
    let mut out = picture.clone();
    let pixels = out.data.chunks_exact_mut(3).zip(background.data.chunks_exact(3));
    for ((out, back), m) in pixels.zip(&matte.data).filter(|(_, m)| **m > 0.0) {
        let share = (m / HIDDEN).min(1.0);
        out.iter_mut().zip(back).for_each(|(o, &b)| {
            *o = (f32::from(*o) + share * (f32::from(b) - f32::from(*o)) + 0.5) as u8;
        });
    }
    out
}
