//! Work on frames and levels in the order that a method likes: [`Session`].

use std::borrow::Cow;
use std::time::Instant;

use super::data::channels::Stack;
use super::data::field::Nnf;
use super::data::image::{Frame, LevelReport, Source, Target};
use super::data::patches::Patches;
use super::data::pose::{Matrix, ONE, Pose, Upright};
use super::engine::Engine;
use super::level::{Level, Levels};
use super::rules::Constraint;
use super::terms::{Pass, Terms};
use super::vote::Weighted;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::rng;
use crate::raster::image::Plane;

/// Coarser levels may be this much further from done: what is left there the finer ones make good.
const UNFINISHED: f64 = 5.0;

/// Makes the rule of a level.
pub type MakeRule<'a, P> = &'a dyn Fn() -> Box<dyn Constraint<P>>;

/// Frames of a target at work, on all levels. A method enters a level of a frame and searches and votes there as often as it
/// likes: one frame after the other with all levels inside, or level by level with passes over all frames.
///
/// A field is given to the next frame with [`Session::offer`], after it was carried or shifted in time.
pub struct Session<'a, P: Pose> {
    engine: &'a Engine,
    source: &'a Source,
    rule: MakeRule<'a, P>,
    terms: Option<&'a dyn Terms<P>>,
    targets: &'a [Target<P>],
    frames: Vec<FrameLevels<'a, P>>,
    levels: usize,
}

/// One frame of a session.
struct FrameLevels<'a, P: Pose> {
    levels: Levels,
    /// Source and target patches, fine to coarse, until a level is entered.
    patches: Vec<Option<(Cow<'a, Patches>, Patches)>>,
    work: Vec<Option<Work<'a, P>>>,
    /// How it went on levels that are left.
    left: Vec<LevelReport>,
}

/// A level that is entered.
struct Work<'a, P: Pose> {
    level: Level<'a, P>,
    nnf: Nnf<P>,
    rule: Box<dyn Constraint<P>>,
    report: LevelReport,
}

impl Engine {
    /// Synthesises one frame (LazyFluids, Eq. 7): coarse to fine, and on every level search and vote in turns.
    ///
    /// Where the target has a segment (outline, interior) that the source lacks on a level, both count as one there; where
    /// the source has one that the target lacks, its patches are not used. A target without any patch gives a black frame.
    ///
    /// # Errors
    /// Planes that are not the layout's channels or differ in size, an image smaller than a patch, or a cancel.
    pub fn frame(&self, source: &Source, target: &Target, observer: &dyn Observer) -> Result<Frame> {
        let rule = || self.settings().rule.constraint(self.settings().sweeps);
        let mut session = Session::<Upright>::begin(self, source, std::slice::from_ref(target), &rule, None, observer)?;
        for level in (0..session.levels()).rev() {
            session.enter(level, 0);
            session.work(level, 0, observer)?;
        }
        session.finish(0)
    }
}

impl<'a, P: Pose> Session<'a, P> {
    /// A session on `targets`, all of one size. `rule` makes what constrains the field of a level, `terms` are what a method
    /// adds to distances.
    ///
    /// # Errors
    /// No target; planes that are not the layout's channels or differ in size, an image smaller than a patch.
    pub fn begin(
        engine: &'a Engine,
        source: &'a Source,
        targets: &'a [Target<P>],
        rule: MakeRule<'a, P>,
        terms: Option<&'a dyn Terms<P>>,
        observer: &dyn Observer,
    ) -> Result<Self> {
        let first = targets.first().ok_or_else(|| Error::new(Kind::Usage, "target", "there is no frame"))?;
        let levels = engine.common_levels(first, source);
        let mut frames = Vec::with_capacity(targets.len());
        for target in targets {
            let size = engine.checked("target", &target.image)?;
            if size != first.image.size() {
                return Err(Error::new(Kind::Usage, "target", "its frames differ in size"));
            }
            engine.check_companions(size, target)?;
            frames.push(FrameLevels::new(engine, source, target, levels, observer));
        }
        Ok(Self { engine, source, rule, terms, targets, frames, levels })
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.levels
    }

    /// Begins a level of a frame: from the coarser level's field if that was entered, which it then leaves, else by chance;
    /// and from the target's previous field where that is nearer.
    ///
    /// # Panics
    /// When the level was entered before, or is none of the session's.
    pub fn enter(&mut self, n: usize, frame: usize) {
        let target = &self.targets[frame];
        let coarser = self.frames[frame].work.get_mut(n + 1).and_then(Option::take);
        let mut level = self.level(n, frame, coarser.is_none());
        let rule = (self.rule)();
        let mut nnf = match &coarser {
            None => Nnf::random(&level.target, &level.source, level.seed),
            Some(coarser) => coarser.nnf.refined(&coarser.level.source, &level.target, &level.source, level.seed),
        };
        let frame = &mut self.frames[frame];
        if let Some(coarser) = coarser {
            level.start(&nnf, rule.voting(&level), frame.levels.kept(n));
            frame.left.push(coarser.report);
        }
        if let Some(previous) = &target.previous {
            let from = self.source.finest();
            level.search().merge(&mut nnf, &previous.coarsened(from, n, &level.target, &level.source));
        }
        let stack = &level.target.stack;
        let report = LevelReport {
            size: (stack.width, stack.height),
            patches: (level.source.count(), level.target.count()),
            ..LevelReport::default()
        };
        frame.work[n] = Some(Work { level, nnf, rule, report });
    }

    fn level(&mut self, n: usize, frame: usize, coarsest: bool) -> Level<'a, P> {
        let (engine, target) = (self.engine, &self.targets[frame]);
        let levels = &mut self.frames[frame];
        let (source, mut patches) = levels.patches[n].take().expect("a level is entered once");
        patches.frames = target.frames.as_ref().map(|frames| coarser(frames, self.size(frame), n));
        let swapped = (!target.swapped.is_empty()).then(|| patches.stack.exchanged(&target.swapped));
        let upright = P::UPRIGHT && patches.frames.is_none();
        let synthesised = engine.layout().synthesised();
        let levels = &self.frames[frame].levels;
        Level {
            layout: engine.layout(),
            colours: if upright { source.stack.first(synthesised) } else { Stack::default() },
            source,
            target: patches,
            swapped,
            fixed: levels.layer(n).fixed.clone(),
            steps: levels.steps(n),
            anchor: levels.anchor(n),
            coarsest,
            seed: rng::hash(engine.settings().seed, &[n as u64]),
            terms: self.terms,
            pass: Pass { level: n, frame },
            manner: engine.settings().manner,
        }
    }

    fn size(&self, frame: usize) -> (usize, usize) {
        self.targets[frame].image.size()
    }

    fn entered(&mut self, n: usize, frame: usize) -> &mut Work<'a, P> {
        self.frames[frame].work[n].as_mut().expect("a level is entered before it is worked on")
    }

    /// Rounds of search and vote until the energy hardly falls, or as many as the settings say; the finest level is done with
    /// more care.
    ///
    /// # Errors
    /// A cancel.
    pub fn work(&mut self, n: usize, frame: usize, observer: &dyn Observer) -> Result<()> {
        let settings = self.engine.settings();
        let tolerance = settings.tolerance * if n == 0 { 1.0 } else { UNFINISHED };
        let mut before = f64::INFINITY;
        for round in 0..rounds(settings.iterations, n, self.levels) {
            observe::check(observer)?;
            let energy = self.search(n, frame, round);
            self.vote(n, frame);
            if energy >= before * (1.0 - tolerance) {
                break;
            }
            before = energy;
        }
        let work = self.entered(n, frame);
        work.level.show(&work.nnf, n, observer);
        Ok(())
    }

    /// Improves the field of a level; its energy then, in units of squared values at weight 1.
    pub fn search(&mut self, n: usize, frame: usize, round: usize) -> f64 {
        let start = Instant::now();
        let Work { level, nnf, rule, report } = self.entered(n, frame);
        rule.search(level, nnf, round);
        report.searching += start.elapsed().as_secs_f64();
        let energy = level.energy(nnf) + rule.energy(level, nnf);
        report.energies.push(energy);
        energy
    }

    /// Votes the synthesised channels of a level, and somewhat beyond.
    pub fn vote(&mut self, n: usize, frame: usize) {
        let start = Instant::now();
        let Work { level, nnf, rule, report } = self.entered(n, frame);
        level.overshoot(&[Weighted { nnf, weight: 1.0 }], rule.voting(level));
        report.voting += start.elapsed().as_secs_f64();
    }

    /// Votes the level's own field, with this weight, and others together.
    pub fn vote_with(&mut self, n: usize, frame: usize, weight: f32, others: &[Weighted<P>]) {
        let Work { level, nnf, rule, .. } = self.entered(n, frame);
        let fields: Vec<Weighted<P>> = [Weighted { nnf, weight }].into_iter().chain(others.iter().copied()).collect();
        level.vote(&fields, rule.voting(level));
    }

    /// Takes what of another field is nearer, in the level's own places.
    pub fn offer(&mut self, n: usize, frame: usize, other: &Nnf<P>) {
        let Work { level, nnf, .. } = self.entered(n, frame);
        level.search().merge(nnf, other);
    }

    /// Overwrites a channel that is given, values in [0, 1].
    ///
    /// # Panics
    /// When the plane is not of the level's size.
    pub fn set_guide(&mut self, n: usize, frame: usize, channel: usize, plane: &Plane) {
        let level = &mut self.entered(n, frame).level;
        let stack = &level.target.stack;
        assert_eq!((plane.width, plane.height), (stack.width, stack.height), "a guide of another size");
        level.set_guide(channel, plane);
    }

    /// The field of a level that is entered.
    pub fn field(&self, n: usize, frame: usize) -> Option<&Nnf<P>> {
        self.frames[frame].work[n].as_ref().map(|work| &work.nnf)
    }

    /// Target and source patches of a level that is entered.
    pub fn patches(&self, n: usize, frame: usize) -> Option<(&Patches, &Patches)> {
        self.frames[frame].work[n].as_ref().map(|work| (&work.level.target, &*work.level.source))
    }

    /// The frame as its finest level stands, which it leaves.
    ///
    /// # Errors
    /// A finest level that was not entered.
    pub fn finish(&mut self, frame: usize) -> Result<Frame<P>> {
        let frame = &mut self.frames[frame];
        let missing = || Error::new(Kind::Usage, "target", "its finest level was not entered");
        let Work { level, nnf, rule, report } = frame.work[0].take().ok_or_else(missing)?;
        let mut planes = level.ballot(&[Weighted { nnf: &nnf, weight: 1.0 }], rule.voting(&level)).planes();
        if let Some(fixed) = &level.fixed {
            for (plane, given) in planes.iter_mut().zip(&frame.levels.layer(0).planes) {
                let pixels = plane.data.iter_mut().zip(&given.data).zip(fixed);
                pixels.filter(|(_, fixed)| **fixed).for_each(|((made, given), _)| *made = *given);
            }
        }
        frame.left.push(report);
        Ok(Frame { planes, nnf, levels: std::mem::take(&mut frame.left) })
    }
}

impl<'a, P: Pose> FrameLevels<'a, P> {
    /// Source and target patches of all levels; where the source lacks a segment of the target, without segments.
    fn new(engine: &Engine, source: &'a Source, target: &Target<P>, count: usize, observer: &dyn Observer) -> Self {
        let levels = Levels::new(target, count);
        let patches = |n: usize| {
            let from = &source.levels[n];
            let patches = levels.patches(n, engine.layout(), engine.settings().thresholds);
            if patches.is_served_by(from) {
                return Some((Cow::Borrowed(from), patches));
            }
            if n == 0 {
                observer.note(
                    "the exemplar has no patches for the outline, or none for the inside: both are made from all",
                );
            }
            Some((Cow::Owned(from.merged()), patches.merged()))
        };
        let patches = (0..count).map(patches).collect();
        Self { levels, patches, work: (0..count).map(|_| None).collect(), left: Vec::with_capacity(count) }
    }
}

/// Rounds on level `n` of `count`, 0 the finest, of so many on the coarsest and on the finest.
fn rounds((coarse, fine): (usize, usize), n: usize, count: usize) -> usize {
    let share = if count > 1 { n as f64 / (count - 1) as f64 } else { 1.0 };
    ((fine as f64 + (coarse as f64 - fine as f64) * share).round() as usize).max(1)
}

/// The frames of a level: those in the middle of its pixels.
fn coarser(frames: &[Matrix], (width, height): (usize, usize), level: usize) -> Vec<Matrix> {
    let size = |v: usize| v.div_ceil(1 << level);
    let middle = |v: usize, size: usize| ((v << level) + (1 << level) / 2).min(size - 1);
    let at = |x: usize, y: usize| frames[middle(y, height) * width + middle(x, width)];
    debug_assert!(frames.iter().all(|m| m.xx.abs() <= 1000 * ONE));
    (0..size(height)).flat_map(|y| (0..size(width)).map(move |x| at(x, y))).collect()
}
