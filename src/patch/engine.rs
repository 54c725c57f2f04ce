//! The loop that all exemplar methods share: coarse to fine, search and vote in turns.

use std::time::Instant;

use super::atlas::{Atlas, Layers};
use super::channels::{Layout, MODULATION, Stack};
use super::nnf::{Nnf, usage_picture};
use super::patch_match::{Search, Steps};
use super::rules::{Rule, Rules};
use super::segments::{Patches, Thresholds, labels};
use super::vote::{Anchor, Manner};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::rng;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::pyramid::reduce;

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
    /// A level is done once a round lowers its energy by less than this share.
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
            iterations: (24, 12),
            manner: Manner::Mean,
            tolerance: 0.005,
            sweeps: 2,
            thresholds: Thresholds::default(),
            seed: 1,
        }
    }
}

/// An image with all channels of a [`Layout`], in its order, values in [0, 1].
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

    fn size(&self) -> (usize, usize) {
        self.planes.first().map_or((0, 0), |p| (p.width, p.height))
    }

    /// The image on `levels` levels, fine to coarse.
    fn pyramid(&self, levels: usize) -> Vec<Layers> {
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
    levels: Vec<Atlas>,
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
    /// What the synthesised channels are held to besides.
    pub anchor: Option<Anchor>,
    /// The field of the previous frame, carried to where its patches are now.
    pub previous: Option<Nnf>,
}

impl Target {
    /// Guides and start alone.
    pub fn new(image: Image) -> Self {
        Self { image, modulation: None, anchor: None, previous: None }
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

/// One level of one frame, ready to be worked on.
#[derive(Debug)]
pub(super) struct Level<'a> {
    pub layout: &'a Layout,
    pub atlas: &'a Atlas,
    pub target: Patches,
    /// The modulation in steps.
    pub steps: Option<Vec<u8>>,
    /// What the synthesised channels are held to.
    pub anchor: Option<Anchor>,
    /// Whether it starts from nothing.
    pub coarsest: bool,
    /// Seed of this level's random choices.
    pub seed: u64,
}

impl Level<'_> {
    /// The search from target to source.
    pub fn search(&self) -> Search<'_> {
        let steps = self.steps.as_deref().map_or(Steps::Full, Steps::From);
        Search { layout: self.layout, from: &self.target, to: &self.atlas.patches, steps, apart: 0 }
    }

    /// The larger side of the source in pixels: how far apart two patches may lie.
    pub fn reach(&self) -> usize {
        (0..self.atlas.images()).map(|i| self.atlas.size(i)).map(|(w, h)| w.max(h)).max().unwrap_or(0)
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
        let layers = target.image.pyramid(count);
        let modulation = target.modulation.as_ref().map(|m| modulation_pyramid(m, count));
        let anchors = anchor_pyramid(target.anchor.as_ref(), count);
        let mut state: Option<(Level, Nnf, Rules)> = None;
        let mut reports = Vec::with_capacity(count);
        let merged: Vec<Option<Atlas>> = (0..count).map(|n| self.merged(&source.levels[n], &layers[n])).collect();
        for n in (0..count).rev() {
            let atlas = merged[n].as_ref().unwrap_or(&source.levels[n]);
            let mut level = Level {
                layout: &self.layout,
                atlas,
                target: self.patches(&layers[n], merged[n].is_some()),
                steps: modulation.as_ref().map(|m| m[n].clone()),
                anchor: anchors[n].clone(),
                coarsest: state.is_none(),
                seed: rng::hash(self.settings.seed, &[n as u64]),
            };
            let mut rules = Rules::new(self.settings.rule, self.settings.sweeps, self.settings.manner);
            let mut nnf = match &state {
                None => Nnf::random(&level.target, &atlas.patches, level.seed),
                Some((coarser, nnf, _)) => nnf.refined(coarser.atlas, &level.target, atlas, level.seed),
            };
            if !level.coarsest {
                vote(&mut level, &nnf, &rules);
            }
            if let Some(previous) = &target.previous {
                nnf.merge(&level.search(), &previous.coarsened(source.atlas(), n, &level.target, atlas));
            }
            let rounds = self.rounds(n, count);
            reports.push(self.level(&mut level, &mut nnf, &mut rules, rounds, observer)?);
            show(&level, &nnf, n, observer);
            state = Some((level, nnf, rules));
        }
        let (level, nnf, rules) = state.ok_or_else(|| Error::new(Kind::Unusable, "target", "it has no level"))?;
        let planes = rules.vote(&level, &nnf).planes();
        Ok(Frame { planes, nnf, levels: reports })
    }

    /// Search and vote in turns until the energy hardly falls.
    fn level(
        &self,
        level: &mut Level,
        nnf: &mut Nnf,
        rules: &mut Rules,
        rounds: usize,
        observer: &dyn Observer,
    ) -> Result<LevelReport> {
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
            let held = level.anchor.as_ref().map_or(0.0, |anchor| anchor.energy(&self.layout, &level.target.stack));
            let energy = self.layout.to_energy(nnf.total() as f64) + held;
            let before = report.energies.last().copied().unwrap_or(f64::INFINITY);
            report.energies.push(energy);
            let start = Instant::now();
            vote(level, nnf, rules);
            report.voting += start.elapsed().as_secs_f64();
            if energy >= before * (1.0 - self.settings.tolerance) {
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

    fn patches(&self, (planes, blurred): &Layers, merged: bool) -> Patches {
        let size = (planes[0].width, planes[0].height);
        let labels = labels(size, self.layout.radius(), blurred.as_ref(), self.settings.thresholds);
        let patches = Patches::new(Stack::from_planes(planes), labels);
        if merged { patches.merged() } else { patches }
    }

    /// The source without segments, where it lacks one that the target has.
    fn merged(&self, atlas: &Atlas, layers: &Layers) -> Option<Atlas> {
        (!self.patches(layers, false).is_served_by(&atlas.patches)).then(|| atlas.merged())
    }

    /// Refuses modulation, anchor or field that do not fit a target of `size`.
    fn check_companions(&self, size: (usize, usize), target: &Target) -> Result<()> {
        let anchor = target.anchor.iter().flat_map(|a| a.planes.iter().chain([&a.weight]));
        let planes = target.modulation.iter().chain(anchor).map(|p| (p.width, p.height));
        let field = target.previous.iter().map(|f| (f.width, f.cells.len() / f.width.max(1)));
        if let Some(other) = planes.chain(field).find(|&other| other != size) {
            let problem = format!("modulation, anchor or previous field of {} × {} pixels", other.0, other.1);
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

/// Overwrites the synthesised channels of a level's target.
fn vote(level: &mut Level, nnf: &Nnf, rules: &Rules) {
    let mut stack = std::mem::take(&mut level.target.stack);
    rules.vote(level, nnf).write(&mut stack);
    level.target.stack = stack;
}

/// The anchor on every level.
fn anchor_pyramid(anchor: Option<&Anchor>, levels: usize) -> Vec<Option<Anchor>> {
    let mut all = vec![anchor.cloned()];
    while all.len() < levels {
        all.push(all[all.len() - 1].as_ref().map(Anchor::reduced));
    }
    all
}

/// The modulation in steps on every level.
fn modulation_pyramid(modulation: &Plane, levels: usize) -> Vec<Vec<u8>> {
    let mut plane = modulation.clone();
    let mut all = Vec::with_capacity(levels);
    for n in 0..levels {
        if n > 0 {
            plane = reduce(&plane);
        }
        let step = |v: &f32| (v.clamp(0.0, 1.0) * f32::from(MODULATION) + 0.5) as u8;
        all.push(plane.data.iter().map(step).collect());
    }
    all
}

/// Hands the field, the usage counts and the channels of a level to an observer that wants pictures.
fn show(level: &Level, nnf: &Nnf, n: usize, observer: &dyn Observer) {
    if !observer.wants_pictures() {
        return;
    }
    let send = |name: &str, picture: &Rgb8| {
        observer.picture(&format!("level {n} {name}"), (picture.width, picture.height), &picture.data);
    };
    send("field", &nnf.picture(level.atlas));
    let mean = level.target.count() as f64 / level.atlas.patches.count().max(1) as f64;
    send("usage", &usage_picture(&nnf.usage(level.atlas), level.atlas, mean));
    for (c, channel) in level.layout.channels().iter().enumerate() {
        let stack = &level.target.stack;
        let data = (0..stack.width * stack.height).flat_map(|i| [stack.pixel(i)[c]; 3]).collect();
        send(&format!("channel {}", channel.name), &Rgb8 { width: stack.width, height: stack.height, data });
    }
}

#[cfg(test)]
mod tests {
    use super::super::channels::{Channel, Role};
    use super::super::testing::{grey_layout, texture};
    use super::*;
    use crate::base::observe::Silent;
    use crate::base::par;

    fn image(planes: Vec<Plane>) -> Image {
        Image { planes, blurred: None }
    }

    fn target(planes: Vec<Plane>) -> Target {
        Target::new(image(planes))
    }

    fn noise(width: usize, height: usize) -> Plane {
        Plane::from_fn(width, height, |x, y| rng::unit(rng::hash(77, &[x as u64, y as u64])))
    }

    #[test]
    fn a_texture_is_made_from_noise_and_the_energy_falls() {
        let settings = Settings { iterations: (8, 8), tolerance: 0.0, ..Settings::default() };
        let engine = Engine::new(grey_layout(2), settings);
        let source = engine.source(&[image(vec![texture(64, 64, 0.0)])]).unwrap();
        let frame = engine.frame(&source, &target(vec![noise(90, 70)]), &Silent).unwrap();
        for level in &frame.levels {
            let patches = level.patches.1 as f64;
            // A vote rounds each of the 25 pixels of a patch to a byte.
            let rounding = patches * 25.0 / 12.0 / 65025.0;
            assert!(level.energies.windows(2).all(|e| e[1] <= e[0] + rounding), "{:?}", level.energies);
        }
        let last = frame.levels.last().unwrap();
        // Within 3 % of the range per pixel.
        assert!(last.energies.last().unwrap() / (last.patches.1 as f64 * 25.0) < 0.03f64.powi(2), "{last:?}");
        let deviation = |p: &Plane| {
            let mean = p.data.iter().sum::<f32>() / p.data.len() as f32;
            (p.data.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / p.data.len() as f32).sqrt()
        };
        let (made, given) = (deviation(&frame.planes[0]), deviation(&texture(64, 64, 0.0)));
        assert!((0.5..1.5).contains(&(made / given)), "{made} {given}");
    }

    #[test]
    fn an_anchor_holds_the_frame_and_the_energy_still_falls() {
        let settings = Settings { iterations: (6, 6), tolerance: 0.0, ..Settings::default() };
        let engine = Engine::new(grey_layout(2), settings);
        let source = engine.source(&[image(vec![texture(64, 64, 0.0)])]).unwrap();
        let before = texture(72, 66, 90.0);
        let made = |weight: f32| {
            let anchor = Anchor { planes: vec![before.clone()], weight: Plane::filled(72, 66, weight) };
            let target = Target { anchor: Some(anchor), ..target(vec![before.clone()]) };
            let frame = engine.frame(&source, &target, &Silent).unwrap();
            for level in &frame.levels {
                let rounding = level.patches.1 as f64 * (25.0 + f64::from(weight)) / 12.0 / 65025.0;
                assert!(level.energies.windows(2).all(|e| e[1] <= e[0] + rounding), "{:?}", level.energies);
            }
            let difference = |(a, b): (&f32, &f32)| f64::from((a - b).powi(2));
            frame.planes[0].data.iter().zip(&before.data).map(difference).sum::<f64>()
        };
        let (free, held, fixed) = (made(0.0), made(25.0), made(1e5));
        assert!(held < 0.6 * free && fixed < 1e-3 * free, "{free} {held} {fixed}");
    }

    #[test]
    fn guides_say_what_goes_where() {
        let layout =
            Layout::new(2, vec![Channel::new("grey", 1.0, Role::Synthesised), Channel::new("guide", 1.0, Role::Guide)]);
        let engine = Engine::new(layout.unwrap(), Settings::default());
        let half =
            |w: usize, h: usize, dark: bool| Plane::from_fn(w, h, |x, _| if (x < w / 2) == dark { 0.2 } else { 0.8 });
        let exemplar = half(60, 40, true);
        let source = engine.source(&[image(vec![exemplar.clone(), exemplar])]).unwrap();
        let frame = engine.frame(&source, &target(vec![noise(80, 50), half(80, 50, false)]), &Silent).unwrap();
        assert!((frame.planes[0].at(20, 25) - 0.8).abs() < 0.05 && (frame.planes[0].at(60, 25) - 0.2).abs() < 0.05);
    }

    #[test]
    fn where_alpha_is_nothing_nothing_is_made_and_edges_are_soft() {
        let engine = Engine::new(grey_layout(2), Settings::default());
        let alpha = |w: usize, h: usize| {
            Plane::from_fn(w, h, |x, y| {
                let r = (x as f32 - w as f32 / 2.0).hypot(y as f32 - h as f32 / 2.0);
                ((h as f32 / 3.0 - r) / 6.0 + 0.5).clamp(0.0, 1.0)
            })
        };
        let with = |w: usize, h: usize| Image { planes: vec![alpha(w, h)], blurred: Some(alpha(w, h)) };
        let source = engine.source(&[with(60, 60)]).unwrap();
        let all = Target { image: with(90, 72), modulation: None, anchor: None, previous: None };
        let frame = engine.frame(&source, &all, &Silent).unwrap();
        assert_eq!(frame.planes[0].at(3, 3), 0.0);
        assert!(frame.planes[0].at(45, 36) > 0.95);
        let empty =
            Target { image: Image { planes: vec![noise(40, 40)], blurred: Some(Plane::zeros(40, 40)) }, ..all.clone() };
        let frame = engine.frame(&source, &empty, &Silent).unwrap();
        assert!(frame.planes[0].data.iter().all(|&v| v == 0.0));
        // An opaque exemplar has no outline: the target's whole fluid is one segment.
        let opaque = engine.source(&[image(vec![texture(50, 50, 0.0)])]).unwrap();
        let frame = engine.frame(&opaque, &all, &Silent).unwrap();
        assert!(frame.nnf.assigned().count() > 1000 && frame.planes[0].at(45, 12) > 0.0);
    }

    #[test]
    fn the_same_frame_on_any_number_of_threads() {
        let engine = Engine::new(grey_layout(2), Settings::default());
        let source = engine.source(&image(vec![texture(50, 40, 0.0)]).quarter_turns()).unwrap();
        let run = |threads| {
            par::with_threads(threads, || engine.frame(&source, &target(vec![noise(70, 60)]), &Silent).unwrap())
                .unwrap()
        };
        let (one, two, three) = (run(1), run(2), run(3));
        assert!(one.planes == two.planes && one.planes == three.planes && one.nnf == two.nnf && one.nnf == three.nnf);
    }

    /// Mean squared Laplacian away from the border.
    fn sharpness(p: &Plane) -> f32 {
        let inside = (8..p.height - 8).flat_map(|y| (8..p.width - 8).map(move |x| (x, y)));
        let squares = inside.map(|(x, y)| {
            let around = p.at(x - 1, y) + p.at(x + 1, y) + p.at(x, y - 1) + p.at(x, y + 1);
            (around - 4.0 * p.at(x, y)).powi(2)
        });
        let (sum, n) = squares.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
        sum / n
    }

    /// Colour now, and before.
    fn chained(rule: Rule, lambda: f32) -> Engine {
        let layout =
            vec![Channel::new("grey", 1.0, Role::Synthesised), Channel::new("grey before", lambda, Role::Modulated)];
        Engine::new(Layout::new(2, layout).unwrap(), Settings { rule, ..Settings::default() })
    }

    /// Frames of a texture that turns by `angle` a frame; the last one.
    fn turned(engine: &Engine, exemplar: &Plane, size: usize, frames: usize, angle: f32) -> Plane {
        let source = engine.source(&[image(vec![exemplar.clone(), exemplar.clone()])]).unwrap();
        let mut last = noise(size, size);
        for number in 0..frames {
            let (sin, cos) = if number > 0 { angle.sin_cos() } else { (0.0, 1.0) };
            let middle = size as f32 / 2.0;
            let before = Plane::from_fn(size, size, |x, y| {
                let (x, y) = (x as f32 + 0.5 - middle, y as f32 + 0.5 - middle);
                last.bilinear(middle + cos * x + sin * y, middle + cos * y - sin * x)
            });
            let modulation = (number == 0).then(|| Plane::zeros(size, size));
            let target =
                Target { image: image(vec![before.clone(), before]), modulation, anchor: None, previous: None };
            last = engine.frame(&source, &target, &Silent).unwrap().planes.remove(0);
        }
        last
    }

    #[test]
    fn a_repetitive_exemplar_under_rotation_stays_sharp_with_plain() {
        // Dots a patch apart (LazyFluids, Fig. 2a and b).
        let dots = Plane::from_fn(60, 60, |x, y| {
            let d = ((x % 6) as f32 - 2.5).hypot((y % 6) as f32 - 2.5);
            (2.6 - d).clamp(0.0, 1.0)
        });
        let share = sharpness(&turned(&chained(Rule::Plain, 0.2), &dots, 72, 20, 0.02)) / sharpness(&dots);
        assert!(share > 0.7, "{share}");
    }

    #[test]
    fn where_the_exemplar_has_smooth_parts_plain_washes_out_and_uniform_does_not() {
        let exemplar = Plane::from_fn(64, 64, |x, y| {
            let grain = rng::unit(rng::hash(4, &[x as u64 / 2, y as u64 / 2])) - 0.5;
            0.5 + 0.8 * grain * (x as f32 / 63.0)
        });
        let share = |rule| sharpness(&turned(&chained(rule, 0.5), &exemplar, 80, 8, 0.03)) / sharpness(&exemplar);
        let uniform = share(Rule::Uniform);
        assert!(uniform > 0.4, "{uniform}");
        for rule in [Rule::Plain, Rule::Coherent, Rule::Bidirectional, Rule::Occurrence] {
            assert!(share(rule) < 0.6 * uniform, "{rule:?}");
        }
    }

    #[test]
    fn a_field_carried_on_starts_the_next_frame_near_its_end() {
        let engine = chained(Rule::Uniform, 0.5);
        let exemplar = texture(48, 48, 0.0);
        let source = engine.source(&[image(vec![exemplar.clone(), exemplar])]).unwrap();
        let first = Target {
            image: image(vec![noise(64, 64); 2]),
            modulation: Some(Plane::zeros(64, 64)),
            anchor: None,
            previous: None,
        };
        let first = engine.frame(&source, &first, &Silent).unwrap();
        let before = &first.planes[0];
        let moved = Plane::from_fn(64, 64, |x, y| before.at(x.saturating_sub(1), y));
        let field = first.nnf.carried(|x, y| (x as f32 - 0.5, y as f32 + 0.5));
        let start = |previous| {
            let second = Target { image: image(vec![moved.clone(); 2]), modulation: None, anchor: None, previous };
            engine.frame(&source, &second, &Silent).unwrap().levels[0].energies[0]
        };
        assert!(start(Some(field)) < 0.8 * start(None));
    }

    #[test]
    fn pictures_are_shown_to_whoever_wants_them() {
        #[derive(Default)]
        struct Names(std::sync::Mutex<Vec<String>>);
        impl Observer for Names {
            fn wants_pictures(&self) -> bool {
                true
            }
            fn picture(&self, name: &str, (width, height): (usize, usize), rgb: &[u8]) {
                assert_eq!(rgb.len(), width * height * 3);
                assert!(rgb.iter().any(|&v| v > 0), "{name}");
                self.0.lock().unwrap().push(name.to_owned());
            }
        }
        let engine = Engine::new(grey_layout(2), Settings { rule: Rule::Uniform, ..Settings::default() });
        let source = engine.source(&[image(vec![texture(30, 30, 0.0)])]).unwrap();
        let names = Names::default();
        engine.frame(&source, &target(vec![noise(44, 40)]), &names).unwrap();
        assert_eq!(names.0.into_inner().unwrap(), ["level 0 field", "level 0 usage", "level 0 channel grey"]);
    }

    #[test]
    fn every_rule_makes_a_frame_the_same_on_any_number_of_threads() {
        let source_image = image(vec![texture(44, 40, 0.0)]);
        for &(name, rule) in <Rule as crate::base::options::Words>::ALL {
            let settings = Settings { rule, iterations: (3, 2), ..Settings::default() };
            let engine = Engine::new(grey_layout(2), settings);
            let source = engine.source(std::slice::from_ref(&source_image)).unwrap();
            let made = |threads| {
                let frame = || engine.frame(&source, &target(vec![noise(60, 56)]), &Silent).unwrap();
                par::with_threads(threads, frame).unwrap()
            };
            let (one, two, three) = (made(1), made(2), made(3));
            assert!(one.planes == two.planes && one.planes == three.planes && one.nnf == three.nnf, "{name}");
            assert!(sharpness(&one.planes[0]) > 0.0, "{name}");
        }
    }

    #[test]
    fn turned_copies_are_sources_like_others() {
        let layout =
            Layout::new(1, vec![Channel::new("grey", 1.0, Role::Synthesised), Channel::new("guide", 1.0, Role::Guide)]);
        let engine = Engine::new(layout.unwrap(), Settings { rule: Rule::Uniform, ..Settings::default() });
        let picture = Image { planes: vec![noise(14, 11), noise(14, 11)], blurred: Some(Plane::filled(14, 11, 1.0)) };
        let turns = picture.quarter_turns();
        for (k, turn) in turns.iter().enumerate() {
            let at = [(3, 1), (9, 3), (10, 9), (1, 10)][k];
            assert!(turn.planes.iter().chain(&turn.blurred).all(|p| p.width == [14, 11, 14, 11][k]));
            assert_eq!(turn.planes[1].at(at.0, at.1), picture.planes[1].at(3, 1), "turned {k} times");
        }
        let source = engine.source(&turns).unwrap();
        assert_eq!((source.atlas().images(), source.atlas().patches.count()), (4, 4 * 12 * 9));
        // More source than target patches: each is used once or not at all.
        let frame = engine.frame(&source, &Target::new(turns[1].clone()), &Silent).unwrap();
        let usage = frame.nnf.usage(source.atlas());
        assert!(usage.iter().all(|&n| n <= 1) && usage.iter().sum::<u32>() == 12 * 9);
    }

    #[test]
    fn bad_images_are_named() {
        let engine = Engine::new(grey_layout(2), Settings::default());
        let message = |images: &[Image]| engine.source(images).unwrap_err().to_string();
        assert!(message(&[]).contains("no image"));
        assert!(message(&[image(vec![noise(9, 9), noise(9, 9)])]).contains("one a channel"));
        assert!(message(&[image(vec![noise(9, 4)])]).contains("at least 5 × 5"));
        let clear = Image { planes: vec![noise(9, 9)], blurred: Some(Plane::zeros(9, 9)) };
        assert!(message(std::slice::from_ref(&clear)).contains("opaque enough"));
        assert!(message(&[Image { blurred: Some(Plane::zeros(9, 8)), ..clear }]).contains("differ in size"));
        let source = engine.source(&[image(vec![noise(9, 9)])]).unwrap();
        let message = |target: Target| engine.frame(&source, &target, &Silent).unwrap_err().to_string();
        let good = target(vec![noise(12, 9)]);
        assert!(message(Target { modulation: Some(noise(9, 12)), ..good.clone() }).contains("9 × 12"));
        let anchor = Anchor { planes: Vec::new(), weight: noise(12, 9) };
        assert!(message(Target { anchor: Some(anchor), ..good }).contains("one a synthesised channel"));
    }
}
