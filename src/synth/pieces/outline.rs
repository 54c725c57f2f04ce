//! The part of a run in which the fluid's outline moves: how far, and following the frames.

use super::run::Run;
use crate::base::observe::Observer;
use crate::base::par;
use crate::raster::image::Plane;
use crate::render::boundary::{Boundary, flicker, fluid_flow};
use crate::render::composite::local_contrast;
use crate::render::layers::Layers;

/// How far fire and smoke let go of their matte when nobody says otherwise (Okabe et al. 2011, §6).
const LOOSE: f32 = 0.9;

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
