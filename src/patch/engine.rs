//! The loop that all exemplar methods share: coarse to fine, search and vote in turns.

use std::borrow::Cow;
use std::time::Instant;

use super::atlas::{Atlas, Layers};
use super::channels::Layout;
pub use super::image::{Frame, Image, LevelReport, Source, Target};
use super::level::{Level, Levels};
use super::nnf::Nnf;
use super::rules::{Rule, Rules};
use super::segments::{Patches, Thresholds};
use super::vote::Manner;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::rng;

/// The coarsest level's shortest side is about this many patches.
const COARSEST: usize = 4;

/// Coarser levels may be this much further from done: what is left there the finer ones make good.
const UNFINISHED: f64 = 5.0;

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

    /// Prepares exemplar images (frames, turned copies, several exemplars). All their patches count as one source.
    ///
    /// # Errors
    /// No image, planes that are not the layout's channels or differ in size, an image smaller than a patch, or nothing in
    /// the images that is opaque enough for a patch.
    pub fn source(&self, images: &[Image]) -> Result<Source> {
        let sizes = images.iter().map(|image| self.checked("exemplar", image)).collect::<Result<Vec<_>>>()?;
        let shortest = sizes.iter().map(|&(w, h)| w.min(h)).min();
        let shortest = shortest.ok_or_else(|| Error::new(Kind::Usage, "exemplar", "there is no image"))?;
        let count = self.levels(shortest);
        let pyramids: Vec<Vec<Layers>> = images.iter().map(|image| image.pyramid(count)).collect();
        let atlas = |level: usize| {
            let layers: Vec<Layers> = pyramids.iter().map(|p| p[level].clone()).collect();
            Atlas::new(&layers, self.layout.radius(), self.settings.thresholds)
        };
        let source = Source { levels: (0..count).map(atlas).collect() };
        if source.atlas().patches.count() == 0 {
            return Err(Error::new(Kind::Unusable, "exemplar", "its alpha is nowhere opaque enough for a patch")
                .allowed(format!("blurred alpha above {}", self.settings.thresholds.lower)));
        }
        Ok(source)
    }

    /// Synthesises one frame (LazyFluids, Eq. 7): coarse to fine, and on every level search and vote in turns.
    ///
    /// Where the target has a segment (outline, interior) that the source lacks on a level, both count as one there; where
    /// the source has one that the target lacks, its patches are not used. A target without any patch gives a black frame.
    ///
    /// # Errors
    /// Planes that are not the layout's channels or differ in size, an image smaller than a patch, or a cancel.
    pub fn frame(&self, source: &Source, target: &Target, observer: &dyn Observer) -> Result<Frame> {
        let (width, height) = self.checked("target", &target.image)?;
        self.check_companions((width, height), target)?;
        let count = self.levels(width.min(height)).min(source.levels.len());
        let levels = Levels::new(target, count);
        let (atlases, targets) = self.segments(source, &levels, count, observer);
        let mut state: Option<(Level, Nnf, Rules)> = None;
        let mut reports = Vec::with_capacity(count);
        for (n, patches) in (0..count).zip(targets).rev() {
            let mut level = Level {
                layout: &self.layout,
                atlas: atlases[n].as_ref(),
                colours: atlases[n].patches.stack.first(self.layout.synthesised()),
                target: patches,
                steps: levels.steps(n),
                anchor: levels.anchor(n),
                coarsest: state.is_none(),
                seed: rng::hash(self.settings.seed, &[n as u64]),
            };
            let mut rules = Rules::new(self.settings.rule, self.settings.sweeps, self.settings.manner);
            let mut nnf = match &state {
                None => Nnf::random(&level.target, &level.atlas.patches, level.seed),
                Some((coarser, nnf, _)) => nnf.refined(coarser.atlas, &level.target, level.atlas, level.seed),
            };
            if !level.coarsest {
                level.start(&nnf, &rules, levels.kept(n));
            }
            if let Some(previous) = &target.previous {
                nnf.merge(&level.search(), &previous.coarsened(source.atlas(), n, &level.target, level.atlas));
            }
            reports.push(self.level(&mut level, &mut nnf, &mut rules, (self.rounds(n, count), n == 0), observer)?);
            level.show(&nnf, n, observer);
            state = Some((level, nnf, rules));
        }
        let (level, nnf, rules) = state.ok_or_else(|| Error::new(Kind::Unusable, "target", "it has no level"))?;
        let planes = rules.vote(&level, &nnf).planes();
        Ok(Frame { planes, nnf, levels: reports })
    }

    /// Search and vote in turns until the energy hardly falls, or for so many rounds; `finest` levels are done with more care.
    fn level(
        &self,
        level: &mut Level,
        nnf: &mut Nnf,
        rules: &mut Rules,
        (rounds, finest): (usize, bool),
        observer: &dyn Observer,
    ) -> Result<LevelReport> {
        let tolerance = self.settings.tolerance * if finest { 1.0 } else { UNFINISHED };
        let stack = &level.target.stack;
        let mut report = LevelReport {
            size: (stack.width, stack.height),
            patches: (level.atlas.patches.count(), level.target.count()),
            ..LevelReport::default()
        };
        for round in 0..rounds {
            observe::check(observer)?;
            let start = Instant::now();
            rules.search(level, nnf, round);
            report.searching += start.elapsed().as_secs_f64();
            let energy = level.energy(nnf);
            let before = report.energies.last().copied().unwrap_or(f64::INFINITY);
            report.energies.push(energy);
            let start = Instant::now();
            level.overshoot(nnf, rules);
            report.voting += start.elapsed().as_secs_f64();
            if energy >= before * (1.0 - tolerance) {
                break;
            }
        }
        Ok(report)
    }

    /// Rounds on level `n` of `count`, 0 the finest.
    fn rounds(&self, n: usize, count: usize) -> usize {
        let (coarse, fine) = self.settings.iterations;
        let share = if count > 1 { n as f64 / (count - 1) as f64 } else { 1.0 };
        ((fine as f64 + (coarse as f64 - fine as f64) * share).round() as usize).max(1)
    }

    /// Number of levels for an image with a shortest side of `shortest` pixels.
    fn levels(&self, shortest: usize) -> usize {
        let least = COARSEST * self.layout.side();
        (1..).find(|n| shortest.div_ceil(1 << n) < least).unwrap_or(1)
    }

    /// Source and target patches of all levels, fine to coarse; where the source lacks a segment of the target, without
    /// segments.
    fn segments<'a>(
        &self,
        source: &'a Source,
        levels: &Levels,
        count: usize,
        observer: &dyn Observer,
    ) -> (Vec<Cow<'a, Atlas>>, Vec<Patches>) {
        let level = |n: usize| {
            let atlas = &source.levels[n];
            let patches = levels.patches(n, &self.layout, self.settings.thresholds);
            if patches.is_served_by(&atlas.patches) {
                return (Cow::Borrowed(atlas), patches);
            }
            if n == 0 {
                observer.note(
                    "the exemplar has no patches for the outline, or none for the inside: both are made from all",
                );
            }
            (Cow::Owned(atlas.merged()), patches.merged())
        };
        (0..count).map(level).unzip()
    }

    /// Refuses modulation, kept part, anchor or field that do not fit a target of `size`.
    fn check_companions(&self, size: (usize, usize), target: &Target) -> Result<()> {
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
    fn checked(&self, what: &str, image: &Image) -> Result<(usize, usize)> {
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
