//! The loop that all exemplar methods share: coarse to fine, search and vote in turns.

use super::data::channels::Layout;
pub use super::data::image::{Frame, Image, Layer, LevelReport, Source, Target};
use super::data::patches::Patches;
use super::data::pose::Pose;
use super::data::segments::Thresholds;
use super::rules::Rule;
use super::vote::Manner;
use crate::base::error::{Error, Kind, Result};

/// The coarsest level's shortest side is about this many patches.
const COARSEST: usize = 4;

/// How the engine works.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// How the nearest-neighbour field is constrained.
    pub rule: Rule,
    /// Rounds of search and vote on the coarsest and on the finest level; between them in steps.
    pub iterations: (usize, usize),
    /// How overlapping patches make one pixel, where the rule does not say.
    pub manner: Manner,
    /// The finest level is done once a round lowers its energy by less than this share, others at five times as much.
    pub tolerance: f64,
    /// Sweeps of the search in a round.
    pub sweeps: usize,
    /// What of blurred alpha is outline.
    pub thresholds: Thresholds,
    /// Most levels; as many as fit without it.
    pub levels: Option<usize>,
    /// Seed of all random choices.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            rule: Rule::Plain,
            iterations: (40, 20),
            manner: Manner::Mean,
            tolerance: 0.001,
            sweeps: 1,
            thresholds: Thresholds::default(),
            levels: None,
            seed: 1,
        }
    }
}

/// The patch-optimization engine: channels, patch size and how the field is constrained.
#[derive(Debug, Clone)]
pub struct Engine {
    layout: Layout,
    settings: Settings,
}

impl Engine {
    /// An engine for the channels of `layout`.
    pub fn new(layout: Layout, settings: Settings) -> Self {
        Self { layout, settings }
    }

    /// The channels and their weights.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// How it works.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Prepares exemplar images (turned copies, several exemplars). All their patches count as one source.
    ///
    /// # Errors
    /// No image, planes that are not the layout's channels or differ in size, an image smaller than a patch, or nothing in
    /// the images that is opaque enough for a patch.
    pub fn source(&self, images: &[Image]) -> Result<Source> {
        let shortest = images.iter().map(|image| image.size()).map(|(w, h)| w.min(h)).min().unwrap_or(0);
        let mut source = self.empty(self.levels(shortest));
        for image in images {
            self.checked("exemplar", image)?;
            let pyramid = image.pyramid(source.levels.len());
            self.add(&mut source, &pyramid);
        }
        self.with_patches(source)
    }

    /// Prepares the frames of a clip, `frame(t)` of `count`: searches go through time, and a place says which frame it is in.
    /// Frames are asked for one after the other, and only their bytes are kept ([`Source::bytes`]).
    ///
    /// # Errors
    /// Those of `frame` and of [`Engine::source`]; frames that differ in size.
    pub fn clip(&self, count: usize, mut frame: impl FnMut(usize) -> Result<Image>) -> Result<Source> {
        let mut source = None;
        for t in 0..count {
            let image = frame(t)?;
            let (width, height) = self.checked("exemplar", &image)?;
            let source = source.get_or_insert_with(|| self.empty(self.levels(width.min(height))));
            if t > 0 && source.levels[0].size(0) != (width, height) {
                return Err(Error::new(Kind::Usage, "exemplar", "its frames differ in size"));
            }
            let pyramid = image.pyramid(source.levels.len());
            self.add(source, &pyramid);
        }
        let levels = source.unwrap_or_else(|| self.empty(1)).levels;
        self.with_patches(Source { levels: levels.into_iter().map(Patches::in_time).collect() })
    }

    /// A source of one image whose levels are made already, fine to coarse.
    ///
    /// # Errors
    /// Those of [`Engine::source`].
    pub fn prepared(&self, levels: &[Layer]) -> Result<Source> {
        for layer in levels {
            self.checked("exemplar", &Image { planes: layer.planes.clone(), blurred: layer.blurred.clone() })?;
        }
        let mut source = self.empty(levels.len().max(1));
        self.add(&mut source, levels);
        self.with_patches(source)
    }

    fn empty(&self, levels: usize) -> Source {
        Source { levels: vec![Patches::none(self.layout.channels().len()); levels] }
    }

    /// Adds an image below those that are there.
    fn add(&self, source: &mut Source, pyramid: &[Layer]) {
        for (level, layer) in source.levels.iter_mut().zip(pyramid) {
            let (stack, labels) = layer.patches(self.layout.radius(), self.settings.thresholds);
            level.push(&stack, labels);
        }
    }

    /// Refuses a source without patches.
    fn with_patches(&self, source: Source) -> Result<Source> {
        match source.finest() {
            patches if patches.images() == 0 => Err(Error::new(Kind::Usage, "exemplar", "there is no image")),
            patches if patches.count() == 0 => {
                Err(Error::new(Kind::Unusable, "exemplar", "its alpha is nowhere opaque enough for a patch")
                    .allowed(format!("blurred alpha above {}", self.settings.thresholds.lower)))
            }
            _ => Ok(source),
        }
    }

    /// Bytes that a frame takes while it is made, for so many pixels of the target and of the source: the target's float
    /// pyramid and bytes, two fields, the source's colours, and what the rule keeps.
    pub fn frame_bytes(&self, targets: usize, sources: usize) -> usize {
        let (channels, synthesised) = (self.layout.channels().len(), self.layout.synthesised());
        let pyramid = (4 * (channels + 1) + 2) * 4 / 3;
        let target = pyramid + 2 * (channels + 2) + 3 * 8 + 4 * synthesised;
        target * targets + synthesised * sources + self.settings.rule.bytes(targets, sources)
    }

    /// Number of levels for an image with a shortest side of `shortest` pixels.
    fn levels(&self, shortest: usize) -> usize {
        let least = COARSEST * self.layout.side();
        let fitting = (1..).find(|n| shortest.div_ceil(1 << n) < least).unwrap_or(1);
        self.settings.levels.map_or(fitting, |most| most.clamp(1, fitting))
    }

    /// Number of levels for a target with its levels, if they are made already, and a source.
    pub(super) fn common_levels<P: Pose>(&self, target: &Target<P>, source: &Source) -> usize {
        let (width, height) = target.image.size();
        let own = target.prepared.as_ref().map_or_else(|| self.levels(width.min(height)), Vec::len);
        own.min(source.levels.len())
    }

    /// Refuses modulation, kept part, anchor or field that do not fit a target of `size`.
    pub(super) fn check_companions<P: Pose>(&self, size: (usize, usize), target: &Target<P>) -> Result<()> {
        let anchor = target.anchor.iter().flat_map(|a| a.planes.iter().chain([&a.weight]));
        let planes = target.modulation.iter().chain(&target.kept).chain(anchor).map(|p| (p.width, p.height));
        let field = target.previous.iter().map(|f| (f.width, f.cells.len() / f.width.max(1)));
        if let Some(other) = planes.chain(field).find(|&other| other != size) {
            let problem =
                format!("modulation, kept part, anchor or previous field of {} × {} pixels", other.0, other.1);
            return Err(
                Error::new(Kind::Usage, "target", problem).allowed(format!("{} × {}, as its image", size.0, size.1))
            );
        }
        match &target.anchor {
            Some(anchor) if anchor.planes.len() != self.layout.synthesised() => {
                Err(Error::new(Kind::Usage, "target", format!("an anchor of {} planes", anchor.planes.len()))
                    .allowed(format!("{}, one a synthesised channel", self.layout.synthesised())))
            }
            _ => Ok(()),
        }
    }

    /// The size of an image that has what the layout asks for.
    pub(super) fn checked(&self, what: &str, image: &Image) -> Result<(usize, usize)> {
        let (width, height) = image.size();
        let side = self.layout.side();
        let (planes, channels) = (image.planes.len(), self.layout.channels().len());
        if planes != channels {
            return Err(
                Error::new(Kind::Usage, what, format!("{planes} planes")).allowed(format!("{channels}, one a channel"))
            );
        }
        if image.planes.iter().chain(&image.blurred).any(|p| (p.width, p.height) != (width, height)) {
            return Err(Error::new(Kind::Usage, what, "its planes differ in size"));
        }
        if width.min(height) < side {
            return Err(Error::new(Kind::Unusable, what, format!("{width} × {height} pixels"))
                .allowed(format!("at least {side} × {side}, one patch")));
        }
        Ok((width, height))
    }
}
