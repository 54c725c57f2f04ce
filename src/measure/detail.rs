//! How much of the picture's detail the frames keep at its place, and how much they have that the picture has not.

use super::definition::{Better, Measure};
use super::footage::{Footage, spread};
use super::subject::Subject;
use crate::base::par;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;

/// Frames looked at.
const FRAMES: usize = 16;
/// What is finer than this is detail: σ of a Gaussian, pixels.
const FINE: f32 = 3.0;
/// Window over which detail is compared: σ of a Gaussian, pixels. Fluid that moves carries its detail along, a little way.
const WINDOW: f32 = 16.0;
/// Root mean square of detail below which a picture has none.
const NONE: f64 = 1e-3;

/// Blur.
pub const DETAIL_LOST: Measure = Measure {
    name: "detail lost",
    unit: "1: blurred by σ = 3",
    definition: "how far the detail around each place (finer than σ = 3 pixels, window σ = 16) is below the picture's (or reference's), mean over frames; the picture blurred by σ = 3 is 1",
    needs: "picture or reference, of the video's size",
    better: Better::Lower,
    compute: |subject| Some(against(subject.footage, subject.appearance()?)?.lost),
};

/// Grain and torn edges.
pub const DETAIL_ADDED: Measure = Measure {
    name: "detail added",
    unit: "ratio",
    definition: "how far the detail around each place is above the picture's (or reference's), over all the detail it has, mean over frames",
    needs: "picture or reference, of the video's size",
    better: Better::Lower,
    compute: |subject| Some(against(subject.footage, subject.appearance()?)?.added),
};

/// How the detail of a video differs from that of what it should look like.
#[derive(Debug, Clone, Copy)]
pub(super) struct Detail {
    /// See [`DETAIL_LOST`].
    pub(super) lost: f64,
    /// See [`DETAIL_ADDED`].
    pub(super) added: f64,
}

impl Detail {
    /// Both together: 0 for the picture itself, 1 for the picture blurred by σ = 3.
    pub(super) fn error(self) -> f64 {
        self.lost + self.added
    }
}

/// The difference in detail of `footage` from `wanted`; `None` when their sizes differ or `wanted` has none.
pub(super) fn against(footage: &Footage, wanted: &Footage) -> Option<Detail> {
    if (footage.width(), footage.height()) != (wanted.width(), wanted.height()) {
        return None;
    }
    let inside = Plane::from_vec(
        footage.width(),
        footage.height(),
        footage.inside().iter().map(|&inside| if inside { 1.0 } else { 0.0 }).collect(),
    );
    let total = gaussian(&inside, WINDOW);
    let local = |luma: &Plane| local(luma, &inside, &total);
    let frames = |of: &Footage| spread(of.luma().len(), FRAMES);
    let mean = |planes: Vec<Plane>| {
        let mut mean = Plane::zeros(inside.width, inside.height);
        let share = 1.0 / planes.len() as f32;
        planes.iter().for_each(|p| mean.data.iter_mut().zip(&p.data).for_each(|(m, v)| *m += share * v));
        mean
    };
    let targets = frames(wanted);
    let target = mean(par::map(targets.len(), |i| local(&wanted.luma()[targets[i]])));
    let blurred = mean(par::map(targets.len(), |i| local(&gaussian(&wanted.luma()[targets[i]], FINE))));
    let sum = |of: &(dyn Fn(usize) -> f32 + Sync)| -> f64 {
        (0..target.data.len()).filter(|&i| footage.inside()[i]).map(|i| f64::from(of(i))).sum()
    };
    let all = sum(&|i| target.data[i]);
    let most = sum(&|i| (target.data[i] - blurred.data[i]).max(0.0));
    let count = footage.pixels().len() as f64;
    if all < NONE * count || most <= 0.0 {
        return None;
    }
    let chosen = frames(footage);
    let parts = par::map(chosen.len(), |i| {
        let own = local(&footage.luma()[chosen[i]]);
        let lost = sum(&|i| (target.data[i] - own.data[i]).max(0.0));
        (lost / most, sum(&|i| (own.data[i] - target.data[i]).max(0.0)) / all)
    });
    let share = 1.0 / parts.len() as f64;
    Some(Detail {
        lost: share * parts.iter().map(|p| p.0).sum::<f64>(),
        added: share * parts.iter().map(|p| p.1).sum::<f64>(),
    })
}

/// Root mean square of detail around each place, counting what is inside.
fn local(luma: &Plane, inside: &Plane, total: &Plane) -> Plane {
    let coarse = gaussian(luma, FINE);
    let squares = luma.data.iter().zip(&coarse.data).zip(&inside.data).map(|((l, c), i)| i * (l - c).powi(2));
    let mut squares = gaussian(&Plane::from_vec(luma.width, luma.height, squares.collect()), WINDOW);
    squares.data.iter_mut().zip(&total.data).for_each(|(s, t)| *s = (*s / t.max(1e-6)).max(0.0).sqrt());
    squares
}

/// The same for a subject whose reference gives the floor: how much the real clip itself differs from the picture.
pub(super) fn above_floor(subject: &Subject) -> Option<f64> {
    let own = against(subject.footage, subject.appearance()?)?.error();
    let floor = subject.reference.and_then(|reference| against(reference, subject.appearance()?));
    Some((own - floor.map_or(0.0, Detail::error)).max(0.0))
}
