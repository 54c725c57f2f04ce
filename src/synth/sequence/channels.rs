//! From frames to the channels of the patch engine (LazyFluids, Eq. 8), alike for source and target.

use crate::base::error::Result;
use crate::patch::data::channels::{Channel, Layout, Role};
use crate::patch::engine::Image;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::raster::premultiplied::Premultiplied;
use crate::synth::exemplar::exemplar::surroundings;

const COLOURS: [&str; 4] = ["red", "green", "blue", "alpha"];

/// What a channel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// Red, green, blue or alpha of the frame.
    Now(usize),
    /// Blurred alpha.
    Blurred,
    /// Red, green, blue or alpha of the frame before, carried to this one. Instead of alpha, the number of the fluid's part
    /// where it has several.
    Before(usize),
    /// Red, green or blue of the fluid around the pixel, for a fluid that keeps its place.
    Around(usize),
}

/// The channels of a method, in the engine's order.
#[derive(Debug, Clone, PartialEq)]
pub struct Channels {
    all: Vec<(Content, f32, Role)>,
    /// Blur of alpha, σ in pixels.
    pub blur: f32,
    /// Reach of the surroundings, σ in pixels.
    pub around: f32,
}

/// One frame as it enters the engine; all of one size.
#[derive(Debug, Clone, Copy)]
pub struct Parts<'a> {
    /// The frame; for a target, what it starts from.
    pub now: &'a Premultiplied,
    /// Its opacity: that of `now`, or what is designed.
    pub alpha: &'a Plane,
    /// The frame before.
    pub before: &'a Premultiplied,
    /// The fluid's surroundings, where they are a channel.
    pub around: Option<&'a [Plane; 3]>,
    /// Numbers in [0, 1] of parts of the fluid that must not take from each other.
    pub apart: Option<&'a Plane>,
    /// Whether there is no outline: everything with any fluid is inside.
    pub whole: bool,
    /// Whether the exemplar is opaque all over, so that alpha tells nothing.
    pub opaque: bool,
}

impl Channels {
    /// Channels with their weights and roles, the synthesised ones first.
    pub fn new(all: Vec<(Content, f32, Role)>, blur: f32, around: f32) -> Self {
        Self { all, blur, around }
    }

    /// The engine's layout for patches of side `2 radius + 1`.
    ///
    /// # Errors
    /// Those of [`Layout::new`].
    pub fn layout(&self, radius: usize) -> Result<Layout> {
        let name = |content: Content| match content {
            Content::Now(c) => COLOURS[c].to_owned(),
            Content::Blurred => "blurred alpha".to_owned(),
            Content::Before(c) => format!("{} before", COLOURS[c]),
            Content::Around(c) => format!("{} around", COLOURS[c]),
        };
        Layout::new(radius, self.all.iter().map(|&(c, w, role)| Channel::new(&name(c), w, role)).collect())
    }

    /// Whether alpha is made by voting, not given.
    pub fn makes_alpha(&self) -> bool {
        self.all.iter().any(|(c, _, role)| *c == Content::Now(3) && *role == Role::Synthesised)
    }

    /// Whether patches know their surroundings.
    pub fn need_surroundings(&self) -> bool {
        self.all.iter().any(|(c, ..)| matches!(c, Content::Around(_)))
    }

    /// The surroundings of a frame, where they are needed.
    pub fn surroundings(&self, frame: &Premultiplied) -> Option<[Plane; 3]> {
        self.need_surroundings().then(|| surroundings(frame, self.around))
    }

    /// An image of the engine.
    pub fn image(&self, parts: &Parts, lower: f32) -> Image {
        let blurred = gaussian(parts.alpha, self.blur);
        let blurred = if parts.whole { blurred.map(|b| if b > lower { 1.0 } else { 0.0 }) } else { blurred };
        let solid = Plane::filled(blurred.width, blurred.height, 1.0);
        let (now, before) = (&parts.now.planes, &parts.before.planes);
        let plane = |&(content, ..): &(Content, f32, Role)| match content {
            Content::Now(3) | Content::Blurred if parts.opaque => solid.clone(),
            Content::Now(c) => now[c].clone(),
            Content::Blurred => blurred.clone(),
            Content::Before(3) => parts.apart.unwrap_or(&before[3]).clone(),
            Content::Before(c) => before[c].clone(),
            Content::Around(c) => parts.around.map_or_else(|| solid.clone(), |around| around[c].clone()),
        };
        Image { planes: self.all.iter().map(plane).collect(), blurred: Some(blurred) }
    }
}
