//! What goes into the engine and what comes out.

use super::channels::Stack;
use super::field::Nnf;
use super::patches::Patches;
use super::pose::{Matrix, Pose, Upright};
use super::segments::{NO_PATCH, Thresholds, labels};
use crate::patch::vote::Anchor;
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

    pub(in crate::patch) fn size(&self) -> (usize, usize) {
        self.planes.first().map_or((0, 0), |p| (p.width, p.height))
    }

    /// The image on `levels` levels, fine to coarse.
    pub(in crate::patch) fn pyramid(&self, levels: usize) -> Vec<Layer> {
        let mut all = vec![Layer::new(self.planes.clone(), self.blurred.clone())];
        while all.len() < levels {
            let Layer { planes, blurred, .. } = &all[all.len() - 1];
            all.push(Layer::new(planes.iter().map(reduce).collect(), blurred.as_ref().map(reduce)));
        }
        all
    }
}

/// One level of an image.
#[derive(Debug, Clone)]
pub struct Layer {
    /// One plane a channel, of equal size.
    pub planes: Vec<Plane>,
    /// Blurred alpha, as in an [`Image`].
    pub blurred: Option<Plane>,
    /// Where patches may be centred; everywhere without it.
    pub centres: Option<Vec<bool>>,
    /// Pixels that stay as they are given when patches are voted; none without it.
    pub fixed: Option<Vec<bool>>,
}

impl Layer {
    /// All of an image.
    pub fn new(planes: Vec<Plane>, blurred: Option<Plane>) -> Self {
        Self { planes, blurred, centres: None, fixed: None }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        self.planes.first().map_or((0, 0), |p| (p.width, p.height))
    }

    /// The channels as bytes, and the label of every pixel.
    pub(in crate::patch) fn patches(&self, radius: usize, thresholds: Thresholds) -> (Stack, Vec<u8>) {
        let mut labels = labels(self.size(), radius, self.blurred.as_ref(), thresholds);
        if let Some(centres) = &self.centres {
            labels.iter_mut().zip(centres).filter(|(_, may)| !**may).for_each(|(label, _)| *label = NO_PATCH);
        }
        (Stack::from_planes(&self.planes), labels)
    }
}

/// A plane turned by 90° clockwise.
fn quarter_turn(plane: &Plane) -> Plane {
    Plane::from_fn(plane.height, plane.width, |x, y| plane.at(y, plane.height - 1 - x))
}

/// Everything that patches may be taken from, on all levels, fine to coarse. Serves any number of frames.
#[derive(Debug, Clone)]
pub struct Source {
    pub(in crate::patch) levels: Vec<Patches>,
}

impl Source {
    /// The patches of the finest level, in which a [`Frame`]'s places lie.
    pub fn finest(&self) -> &Patches {
        &self.levels[0]
    }

    /// The patches of a level, 0 the finest.
    pub fn level(&self, level: usize) -> &Patches {
        &self.levels[level]
    }

    /// Bytes that the source takes, for so many pixels of the finest level with so many channels.
    pub fn bytes(pixels: usize, channels: usize) -> usize {
        pixels * Patches::bytes_a_pixel(channels) * 4 / 3
    }
}

/// What a frame is made from.
#[derive(Debug, Clone)]
pub struct Target<P = Upright> {
    /// Guides, and what the synthesised channels start from: the previous frame carried along the flow, or anything.
    pub image: Image,
    /// Its coarser levels, where they are not to be made from it by halving; the first is the image itself. There may be
    /// fewer than the engine would make.
    pub prepared: Option<Vec<Layer>>,
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
    pub previous: Option<Nnf<P>>,
    /// Pairs of channels that are exchanged where [`crate::patch::terms::Terms::is_swapped`].
    pub swapped: Vec<(usize, usize)>,
    /// A matrix a pixel by which what is laid on it is turned or stretched; none: nothing is.
    pub frames: Option<Vec<Matrix>>,
}

impl<P: Pose> Target<P> {
    /// Guides and start alone.
    pub fn new(image: Image) -> Self {
        Self {
            image,
            prepared: None,
            modulation: None,
            kept: None,
            anchor: None,
            previous: None,
            swapped: Vec::new(),
            frames: None,
        }
    }
}

/// A synthesised frame.
#[derive(Debug, Clone)]
pub struct Frame<P = Upright> {
    /// The synthesised channels, values in [0, 1]; 0 where no patch lies.
    pub planes: Vec<Plane>,
    /// From where in [`Source::finest`] every patch was taken.
    pub nnf: Nnf<P>,
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
