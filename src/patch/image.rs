//! What goes into the engine and what comes out.

use super::atlas::{Atlas, Layers};
use super::nnf::Nnf;
use super::vote::Anchor;
use crate::raster::image::Plane;
use crate::raster::pyramid::reduce;

/// An image with all channels of a [`super::channels::Layout`], in its order, values in [0, 1].
#[derive(Debug, Clone)]
pub struct Image {
    /// One plane a channel, of equal size. In a target the synthesised ones are what synthesis starts from.
    pub planes: Vec<Plane>,
    /// Blurred alpha, from which the segments follow; without it there is one segment, the whole image.
    pub blurred: Option<Plane>,
}

impl Image {
    /// The image turned by 0, 90, 180 and 270° (LazyFluids, Fig. 8).
    pub fn quarter_turns(&self) -> [Self; 4] {
        let turn = |image: &Self| Self {
            planes: image.planes.iter().map(quarter_turn).collect(),
            blurred: image.blurred.as_ref().map(quarter_turn),
        };
        let (once, twice) = (turn(self), turn(&turn(self)));
        let thrice = turn(&twice);
        [self.clone(), once, twice, thrice]
    }

    pub(super) fn size(&self) -> (usize, usize) {
        self.planes.first().map_or((0, 0), |p| (p.width, p.height))
    }

    /// The image on `levels` levels, fine to coarse.
    pub(super) fn pyramid(&self, levels: usize) -> Vec<Layers> {
        let mut all = vec![(self.planes.clone(), self.blurred.clone())];
        while all.len() < levels {
            let (planes, blurred) = &all[all.len() - 1];
            all.push((planes.iter().map(reduce).collect(), blurred.as_ref().map(reduce)));
        }
        all
    }
}

/// A plane turned by 90° clockwise.
fn quarter_turn(plane: &Plane) -> Plane {
    Plane::from_fn(plane.height, plane.width, |x, y| plane.at(y, plane.height - 1 - x))
}

/// Everything that patches may be taken from, on all levels, fine to coarse. Serves any number of frames.
#[derive(Debug, Clone)]
pub struct Source {
    pub(super) levels: Vec<Atlas>,
}

impl Source {
    /// The images of the finest level, in which a [`Frame`]'s places lie.
    pub fn atlas(&self) -> &Atlas {
        &self.levels[0]
    }
}

/// What a frame is made from.
#[derive(Debug, Clone)]
pub struct Target {
    /// Guides, and what the synthesised channels start from: the previous frame carried along the flow, or anything.
    pub image: Image,
    /// Weight of the modulated channels at every pixel, in [0, 1]; full without it.
    pub modulation: Option<Plane>,
    /// Where what the synthesised channels start from is kept as the start of every level, in [0, 1]; elsewhere, and
    /// everywhere without it, finer levels start from coarser ones. A frame that follows another needs it: patches lie on
    /// whole pixels, and on a coarse level a motion of a few pixels is less than half of one and lost. Less than half a pixel
    /// of the finest level a frame is lost even so, and has to be saved up by the caller.
    pub kept: Option<Plane>,
    /// What the synthesised channels are held to besides.
    pub anchor: Option<Anchor>,
    /// The field of the previous frame, carried to where its patches are now.
    pub previous: Option<Nnf>,
}

impl Target {
    /// Guides and start alone.
    pub fn new(image: Image) -> Self {
        Self { image, modulation: None, kept: None, anchor: None, previous: None }
    }
}

/// A synthesised frame.
#[derive(Debug, Clone)]
pub struct Frame {
    /// The synthesised channels, values in [0, 1]; 0 where no patch lies.
    pub planes: Vec<Plane>,
    /// From where in [`Source::atlas`] every patch was taken.
    pub nnf: Nnf,
    /// Coarse to fine, how it went.
    pub levels: Vec<LevelReport>,
}

/// How the work on one level went.
#[derive(Debug, Clone, Default)]
pub struct LevelReport {
    /// Width and height in pixels.
    pub size: (usize, usize),
    /// Number of source and of target patches.
    pub patches: (usize, usize),
    /// The energy after the search of each round: Σ of distances, and what the anchor adds, in units of squared values at weight 1.
    pub energies: Vec<f64>,
    /// Seconds spent searching.
    pub searching: f64,
    /// Seconds spent voting.
    pub voting: f64,
}
