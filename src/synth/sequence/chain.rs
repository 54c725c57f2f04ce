//! Frames one after the other, each from the one before: what all exemplar methods on the patch engine share.

use std::borrow::Cow;

use super::channels::{Channels, Parts};
use super::whole_pixels::{Carry, moved, shown};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{Observer, Part};
use crate::base::rng;
use crate::flow::field::Field;
use crate::patch::data::field::Nnf;
use crate::patch::data::patches::Patches;
use crate::patch::data::segments::{BOUNDARY, INTERIOR, Thresholds};
use crate::patch::engine::{Engine, Frame, Image, Settings, Source, Target as Start};
use crate::patch::vote::{Anchor, Manner};
use crate::raster::image::Plane;
use crate::raster::premultiplied::Premultiplied;
use crate::scene::target::Target;
use crate::synth::exemplar::exemplar::Exemplar;
use crate::synth::exemplar::own::Own;
use crate::synth::record::FrameRecord;

/// Frames of a clip in which an inside is looked for.
const LOOKED_AT: i64 = 8;
/// Deviation of the noise that a first frame starts from, and its blur in pixels.
const NOISE: (f32, f32) = (0.25, 1.0);

/// How a method uses the engine.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    /// What is compared.
    pub channels: Channels,
    /// Reach of a patch from its centre, pixels.
    pub radius: usize,
    /// How the engine works.
    pub settings: Settings,
    /// Whether the exemplar turned by quarter turns is a source too.
    pub turned: bool,
    /// Weight of the frame before at every pixel, in patches; 0: it has none of its own.
    pub anchor: f32,
    /// How much of the frame before every level starts from, in [0, 1]; the rest comes from the coarser level.
    pub keep: f32,
    /// Whether the field of the frame before is offered to the search.
    pub carries_field: bool,
}

/// What a frame leaves for the next.
#[derive(Debug, Clone)]
pub struct State {
    /// Its number; negative ones come before the first.
    pub t: i64,
    /// The frame, on whole pixels.
    pub layer: Premultiplied,
    /// Where its patches come from.
    pub field: Nnf,
    /// Motion that is still owed, pixels.
    pub owed: Field,
    /// How the work went.
    pub record: FrameRecord,
}

impl State {
    /// The frame as it is shown: moved by what is owed.
    pub fn shown(&self) -> Premultiplied {
        let offset = shown(&self.owed);
        Premultiplied::from_planes(self.layer.planes.each_ref().map(|p| moved(p, &offset)))
    }
}

/// Makes frames.
pub struct Chain<'a> {
    recipe: &'a Recipe,
    engine: Engine,
    exemplar: &'a Exemplar,
    target: &'a Target,
    observer: &'a dyn Observer,
    /// Where the exemplar is the same in all frames.
    source: Option<Source>,
    /// The fluid's surroundings, where patches know them.
    around: Option<[Plane; 3]>,
    /// The picture's own fluid, where that is the exemplar.
    own: Option<Own>,
    opaque: bool,
}

impl<'a> Chain<'a> {
    /// Prepares the exemplar.
    ///
    /// # Errors
    /// An exemplar without patches.
    pub fn new(
        recipe: &'a Recipe,
        exemplar: &'a Exemplar,
        target: &'a Target,
        observer: &'a dyn Observer,
    ) -> Result<Self> {
        let engine = Engine::new(recipe.channels.layout(recipe.radius)?, recipe.settings.clone());
        let around = recipe.channels.surroundings(&exemplar.at(0));
        let opaque = exemplar.is_opaque();
        let own = exemplar.own.then(|| Own::new(&exemplar.at(0), recipe.settings.seed));
        let mut chain = Self { recipe, engine, exemplar, target, observer, source: None, around, own, opaque };
        if exemplar.is_still() {
            chain.source = Some(chain.source(0, 0)?);
        }
        chain.check_inside()?;
        Ok(chain)
    }

    /// Refuses an exemplar that is all outline: there would be nothing to fill the fluid with.
    fn check_inside(&self) -> Result<()> {
        if self.opaque || self.exemplar.own || !self.recipe.channels.makes_alpha() {
            return Ok(());
        }
        let frames = self.target.frames() as i64;
        let looked_at = if self.exemplar.is_still() { 1 } else { LOOKED_AT };
        for k in 0..looked_at {
            let t = k * frames / looked_at;
            if self.source_of(t, t)?.finest().count_in(INTERIOR) > 0 {
                return Ok(());
            }
        }
        let upper = self.thresholds().upper;
        Err(Error::new(Kind::Unusable, "exemplar", "it has no inside: its blurred alpha stays low everywhere")
            .allowed(format!("{upper} or more somewhere (option u)"))
            .remedy("give a fuller opacity with --exemplar-alpha, or a larger exemplar"))
    }

    /// The first frame: the picture's own fluid, or made from nothing (λ = 0).
    ///
    /// # Errors
    /// Unreadable targets, a cancel.
    pub fn first(&self) -> Result<State> {
        let alpha = self.target.alpha(0)?;
        let start = self.beginning(&alpha);
        let zero = Plane::zeros(alpha.width, alpha.height);
        let kept = self.exemplar.own.then(|| Plane::filled(alpha.width, alpha.height, 1.0));
        let image = self.image(&start, &alpha, &start);
        let target = Start { modulation: Some(zero), kept, ..Start::new(image) };
        let source = self.source_of(0, 0)?;
        let frame = self.engine.frame(source.as_ref(), &target, &self.part(0))?;
        let mut state = left(0, frame, &source, &alpha, Field::zeros(alpha.width, alpha.height));
        if self.exemplar.own {
            state.layer = start;
        }
        Ok(state)
    }

    /// The frame after `state`, or with `back` the one before it.
    ///
    /// # Errors
    /// Unreadable targets, a cancel.
    pub fn next(&self, state: &State, back: bool) -> Result<State> {
        let t = if back { state.t - 1 } else { state.t + 1 };
        let (alpha, flow) = self.motion(state.t, t)?;
        let carry = Carry::new(&flow, &state.owed);
        let mut before = Premultiplied::from_planes(state.layer.planes.each_ref().map(|p| carry.carried(p)));
        let coherence = match &self.own {
            Some(own) => {
                own.fill(&mut before, &flow, t);
                Plane::filled(alpha.width, alpha.height, 1.0)
            }
            None => coherence(&alpha, &self.target.alpha(self.place(state.t))?, &flow, &carry),
        };
        let mut start = before.clone();
        if !self.recipe.channels.makes_alpha() {
            start.planes[3] = alpha.clone();
        }
        let anchor = (self.recipe.anchor > 0.0).then(|| self.anchor(&before, &coherence));
        let target = Start {
            kept: Some(coherence.map(|c| c * self.recipe.keep)),
            modulation: Some(coherence),
            anchor,
            previous: self.recipe.carries_field.then(|| state.field.carried(|x, y| carry.position(x, y))),
            ..Start::new(self.image(&start, &alpha, &before))
        };
        let source = self.source_of(t, state.t)?;
        let frame = self.engine.frame(source.as_ref(), &target, &self.part(t))?;
        Ok(left(t, frame, &source, &alpha, carry.owed))
    }

    /// Who is told of the work on frame `t`.
    fn part(&self, t: i64) -> Part<'a> {
        Part::new(self.observer, format!("frame {t:05}"))
    }

    /// The exemplar's patches, where they are the same for all frames.
    pub fn patches(&self) -> Option<&Patches> {
        self.source.as_ref().map(Source::finest)
    }

    /// Designed opacity of frame `to`, and the motion that leads there from its neighbour `from`.
    fn motion(&self, from: i64, to: i64) -> Result<(Plane, Field)> {
        let mut flow = self.target.flow(self.place(to))?;
        if to < from {
            flow.u.data.iter_mut().chain(&mut flow.v.data).for_each(|v| *v = -*v);
        }
        Ok((self.target.alpha(self.place(to))?, flow))
    }

    /// Number of the target's frame: only what is the same in every frame is followed backwards, and beyond the ends.
    fn place(&self, t: i64) -> usize {
        t.clamp(0, self.target.frames() as i64 - 1) as usize
    }

    fn anchor(&self, before: &Premultiplied, coherence: &Plane) -> Anchor {
        let layout = self.engine.layout();
        let synthesised = layout.synthesised();
        // Robust votes are powers of whole-number distances; one of distance 1 is what the anchor counts in.
        let vote = match self.recipe.settings.manner {
            Manner::Robust => f64::from(layout.to_distance(1.0)).powf(-0.6) as f32,
            Manner::Mean | Manner::Centred | Manner::Median | Manner::Discrete | Manner::Likely => 1.0,
        };
        let weight = coherence.map(|c| c * self.recipe.anchor * vote);
        Anchor { planes: before.planes[..synthesised].to_vec(), weight }
    }

    /// What the patches of frame `t` are taken from.
    ///
    /// # Errors
    /// An exemplar frame without patches.
    pub fn source_at(&self, t: i64) -> Result<Cow<'_, Source>> {
        self.source_of(t, t - 1)
    }

    fn source_of(&self, t: i64, before: i64) -> Result<Cow<'_, Source>> {
        self.source.as_ref().map_or_else(|| Ok(Cow::Owned(self.source(t, before)?)), |s| Ok(Cow::Borrowed(s)))
    }

    /// Exemplar frame `t` with `before` as the one before it.
    fn source(&self, t: i64, before: i64) -> Result<Source> {
        let (now, before) = (self.exemplar.at(t), self.exemplar.at(before));
        let image = self.image(&now, now.alpha(), &before);
        self.engine.source(&if self.recipe.turned { image.quarter_turns().to_vec() } else { vec![image] })
    }

    fn image(&self, now: &Premultiplied, alpha: &Plane, before: &Premultiplied) -> Image {
        let (around, opaque) = (self.around.as_ref(), self.opaque);
        let apart = self.own.as_ref().and_then(|own| own.parts.as_ref());
        let whole = opaque || !self.recipe.channels.makes_alpha();
        let parts = Parts { now, alpha, before, around, apart, whole, opaque };
        self.recipe.channels.image(&parts, self.thresholds().lower)
    }

    fn thresholds(&self) -> Thresholds {
        self.recipe.settings.thresholds
    }

    /// What the first frame starts from: the picture's own fluid, or noise about the exemplar's mean colour.
    fn beginning(&self, alpha: &Plane) -> Premultiplied {
        let exemplar = self.exemplar.at(0);
        if self.exemplar.own {
            return exemplar.into_owned();
        }
        let (width, height) = (alpha.width, alpha.height);
        let mean = |c: usize| {
            let total: f64 = exemplar.alpha().data.iter().map(|&a| f64::from(a)).sum();
            (exemplar.planes[c].data.iter().map(|&v| f64::from(v)).sum::<f64>() / total.max(1e-6)) as f32
        };
        let colour = |c: usize| {
            let (mean, seed) = (mean(c), self.recipe.settings.seed);
            let value = |x: usize, y: usize| rng::unit(rng::hash(seed, &[c as u64, x as u64, y as u64])) - 0.5;
            let noise = crate::raster::filter::gaussian(&Plane::from_fn(width, height, value), NOISE.1);
            let shaded = noise.data.iter().zip(&alpha.data).map(|(n, a)| a * (mean + NOISE.0 * n * 4.0));
            Plane::from_vec(width, height, shaded.collect())
        };
        Premultiplied::from_planes([colour(0), colour(1), colour(2), alpha.clone()])
    }
}

/// λ_q / λ (LazyFluids, Eq. 6), from the designed opacity of a frame and of the one before: 1 where fluid was before, 0
/// where it is new.
fn coherence(alpha: &Plane, before: &Plane, flow: &Field, carry: &Carry) -> Plane {
    let (before, mut coherence) = (moved(before, flow), carry.known());
    for ((c, now), before) in coherence.data.iter_mut().zip(&alpha.data).zip(&before.data) {
        *c *= 1.0 - (now - before.clamp(0.0, 1.0)).max(0.0);
    }
    coherence
}

fn left(t: i64, frame: Frame, source: &Source, alpha: &Plane, owed: Field) -> State {
    let record = record(t, &frame, source);
    let mut planes = frame.planes.into_iter();
    let mut next = || planes.next().unwrap_or_else(|| alpha.clone());
    let layer = Premultiplied::from_planes([next(), next(), next(), next()]);
    State { t, layer, field: frame.nnf, owed, record }
}

fn record(t: i64, frame: &Frame, source: &Source) -> FrameRecord {
    let (patches, usage) = (source.finest(), frame.nnf.usage(source.finest()));
    let range = |segment: u8| {
        let counts = || patches.centres(segment).map(|s| usage[s as usize]);
        counts().min().zip(counts().max())
    };
    let last = frame.levels.last();
    let energy = last.and_then(|level| Some(level.energies.last()? / level.patches.1.max(1) as f64));
    FrameRecord {
        frame: t,
        energy: energy.unwrap_or(0.0),
        rounds: frame.levels.iter().map(|level| level.energies.len()).collect(),
        outline_usage: range(BOUNDARY),
        inside_usage: range(INTERIOR),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn new_fluid_owes_nothing_to_the_frame_before() {
        // An emitter from row 8 on, fluid that sinks by 3 pixels a frame.
        let alpha = Plane::from_fn(20, 30, |_, y| f32::from(y >= 8));
        let flow = Field { u: Plane::zeros(20, 30), v: Plane::filled(20, 30, 3.0) };
        let lambda = coherence(&alpha, &alpha, &flow, &Carry::new(&flow, &Field::zeros(20, 30)));
        let column: Vec<f32> = (0..30).map(|y| lambda.at(10, y)).collect();
        assert!(column[..3].iter().all(|l| *l == 0.0), "beyond the border nothing is known: {column:?}");
        assert!(column[8..11].iter().all(|l| *l == 0.0), "{column:?}");
        assert!(column[11..].iter().chain(&column[3..8]).all(|l| *l == 1.0), "{column:?}");
    }
}
