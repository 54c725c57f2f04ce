//! One level of a frame, and a target on all of them.

use std::borrow::Cow;

use super::data::channels::{Layout, MODULATION, Stack};
use super::data::field::{Nnf, usage_picture};
use super::data::image::{Layer, Target};
use super::data::patches::Patches;
use super::data::pose::{Pose, Upright};
use super::data::segments::Thresholds;
use super::patch_match::{Search, Steps};
use super::terms::{Pass, Terms};
use super::vote::{Anchor, Manner, Vote, Voting, Weighted, doubt};
use crate::base::observe::Observer;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::pyramid::reduce;

/// One level of one frame, ready to be worked on.
pub struct Level<'a, P: Pose = Upright> {
    pub(super) layout: &'a Layout,
    pub(super) source: Cow<'a, Patches>,
    /// The synthesised channels of the source alone, where patches are upright.
    pub(super) colours: Stack,
    pub(super) target: Patches,
    /// The target with some channels exchanged.
    pub(super) swapped: Option<Stack>,
    /// Pixels that no vote changes.
    pub(super) fixed: Option<Vec<bool>>,
    /// The modulation in steps.
    pub(super) steps: Option<Vec<u8>>,
    /// What the synthesised channels are held to.
    pub(super) anchor: Option<Anchor>,
    /// Whether it starts from nothing.
    pub(super) coarsest: bool,
    /// Seed of this level's random choices.
    pub(super) seed: u64,
    /// What the method adds to distances.
    pub(super) terms: Option<&'a dyn Terms<P>>,
    pub(super) pass: Pass,
    /// How patches are voted, where the rule does not say.
    pub(super) manner: Manner,
}

impl<P: Pose> Level<'_, P> {
    /// The search from target to source.
    pub(super) fn search(&self) -> Search<'_, P> {
        let steps = self.steps.as_deref().map_or(Steps::Full, Steps::From);
        let (terms, pass) = (self.terms, self.pass);
        let swapped = self.swapped.as_ref();
        Search { layout: self.layout, from: &self.target, swapped, to: &self.source, steps, apart: 0, terms, pass }
    }

    /// How far apart two places may lie, pixels.
    pub(super) fn reach(&self) -> usize {
        self.source.reach()
    }

    /// What fields say together.
    pub(super) fn ballot<'v>(&'v self, fields: &'v [Weighted<'v, P>], voting: Voting<'v>) -> Vote<'v, P> {
        let targets = || fields.iter().map(|f| f.nnf.assigned().count()).sum::<usize>() as f32;
        Vote {
            fields,
            target: &self.target,
            source: &self.source,
            colours: &self.colours,
            radius: self.layout.radius(),
            channels: self.layout.synthesised(),
            manner: voting.manner,
            // |X| / |Z|: both directions count alike (Simakov et al. 2008).
            back: voting.back.map(|votes| (votes, targets() / votes.count().max(1) as f32)),
            anchor: self.anchor.as_ref(),
            doubt: if voting.manner == Manner::Likely { doubt(fields) } else { 0.0 },
        }
    }

    /// Overwrites the synthesised channels of the target by what fields say.
    pub(super) fn vote(&mut self, fields: &[Weighted<P>], voting: Voting) {
        let mut stack = self.target.stack.clone();
        self.ballot(fields, voting).write(&mut stack);
        let before = std::mem::replace(&mut self.target.stack, stack);
        self.restore(&before);
        self.follow();
    }

    /// Gives pixels that no vote changes what they had.
    fn restore(&mut self, before: &Stack) {
        let Some(fixed) = &self.fixed else { return };
        let (channels, synthesised) = (before.channels, self.layout.synthesised());
        let pixels = self.target.stack.bytes_mut().chunks_exact_mut(channels);
        for ((pixel, before), _) in pixels.zip(before.bytes().chunks_exact(channels)).zip(fixed).filter(|(_, f)| **f) {
            pixel[..synthesised].copy_from_slice(&before[..synthesised]);
        }
    }

    /// Gives the swapped channels the colours of the others.
    fn follow(&mut self) {
        let Some(swapped) = &mut self.swapped else { return };
        let (channels, synthesised) = (swapped.channels, self.layout.synthesised());
        let from = self.target.stack.bytes().chunks_exact(channels);
        for (to, from) in swapped.bytes_mut().chunks_exact_mut(channels).zip(from) {
            to[..synthesised].copy_from_slice(&from[..synthesised]);
        }
    }

    /// Goes beyond what the field says by half the step where its patches are blended. For a given field the energy is
    /// quadratic round the vote, so it still falls by three quarters of what the vote gains, and fewer rounds are needed
    /// (over-relaxation).
    pub(super) fn overshoot(&mut self, fields: &[Weighted<P>], voting: Voting) {
        let before = self.target.stack.clone();
        self.vote(fields, voting);
        if !voting.manner.blends() {
            return;
        }
        let (channels, synthesised) = (before.channels, self.layout.synthesised());
        let pixels = self.target.stack.bytes_mut().chunks_exact_mut(channels);
        for (pixel, before) in pixels.zip(before.bytes().chunks_exact(channels)) {
            for (voted, &before) in pixel[..synthesised].iter_mut().zip(before) {
                let new = i16::from(*voted) + (i16::from(*voted) - i16::from(before)) / 2;
                *voted = new.clamp(0, 255) as u8;
            }
        }
        self.follow();
    }

    /// Starts from what a coarser level's field says, and from the target's own channels where they are kept.
    pub(super) fn start(&mut self, nnf: &Nnf<P>, voting: Voting, kept: Option<&[u8]>) {
        let own = self.target.stack.clone();
        self.vote(&[Weighted { nnf, weight: 1.0 }], voting);
        let (channels, synthesised) = (own.channels, self.layout.synthesised());
        let pixels = self.target.stack.bytes_mut().chunks_exact_mut(channels);
        for ((pixel, own), &step) in pixels.zip(own.bytes().chunks_exact(channels)).zip(kept.unwrap_or_default()) {
            let share = f32::from(step.min(MODULATION)) / f32::from(MODULATION);
            let mixed = |a: u8, b: u8| (f32::from(a) + share * (f32::from(b) - f32::from(a)) + 0.5) as u8;
            pixel[..synthesised].iter_mut().zip(own).for_each(|(p, &o)| *p = mixed(*p, o));
        }
        self.follow();
    }

    /// Overwrites a channel that is given, values in [0, 1].
    pub(super) fn set_guide(&mut self, channel: usize, plane: &Plane) {
        self.target.stack.set_planes(channel, std::slice::from_ref(plane));
    }

    /// The energy of a field whose distances are known: those, and what the anchor adds.
    pub(super) fn energy(&self, nnf: &Nnf<P>) -> f64 {
        let held = self.anchor.as_ref().map_or(0.0, |anchor| anchor.energy(self.layout, &self.target.stack));
        self.layout.to_energy(nnf.total() as f64) + held
    }

    /// Hands the field, the usage counts and the channels of a level to an observer that wants pictures.
    pub(super) fn show(&self, nnf: &Nnf<P>, n: usize, observer: &dyn Observer) {
        if !observer.wants_pictures() {
            return;
        }
        let send = |name: &str, picture: &Rgb8| {
            observer.picture(&format!("level {n} {name}"), (picture.width, picture.height), &picture.data);
        };
        send("field", &nnf.picture(&self.source));
        let mean = self.target.count() as f64 / self.source.count().max(1) as f64;
        send("usage", &usage_picture(&nnf.usage(&self.source), &self.source, mean));
        for (c, channel) in self.layout.channels().iter().enumerate() {
            let stack = &self.target.stack;
            let data = (0..stack.width * stack.height).flat_map(|i| [stack.pixel(i)[c]; 3]).collect();
            send(&format!("channel {}", channel.name), &Rgb8 { width: stack.width, height: stack.height, data });
        }
    }
}

/// A target on all levels, fine to coarse.
#[derive(Debug)]
pub(super) struct Levels {
    layers: Vec<Layer>,
    modulation: Option<Vec<Vec<u8>>>,
    kept: Option<Vec<Vec<u8>>>,
    anchors: Vec<Option<Anchor>>,
}

impl Levels {
    /// `count` levels.
    pub fn new<P: Pose>(target: &Target<P>, count: usize) -> Self {
        let layers =
            target.prepared.as_ref().map_or_else(|| target.image.pyramid(count), |layers| layers[..count].to_vec());
        Self {
            layers,
            modulation: target.modulation.as_ref().map(|m| modulation_pyramid(m, count)),
            kept: target.kept.as_ref().map(|k| modulation_pyramid(k, count)),
            anchors: anchor_pyramid(target.anchor.as_ref(), count),
        }
    }

    /// The patches of level `n`, before any frames.
    pub fn patches(&self, n: usize, layout: &Layout, thresholds: Thresholds) -> Patches {
        let (stack, labels) = self.layers[n].patches(layout.radius(), thresholds);
        Patches::new(stack, labels)
    }

    /// The image of level `n`.
    pub fn layer(&self, n: usize) -> &Layer {
        &self.layers[n]
    }

    /// The modulation of level `n`.
    pub fn steps(&self, n: usize) -> Option<Vec<u8>> {
        self.modulation.as_ref().map(|m| m[n].clone())
    }

    /// Where level `n` starts from the target's own synthesised channels, in steps.
    pub fn kept(&self, n: usize) -> Option<&[u8]> {
        self.kept.as_ref().map(|k| &k[n][..])
    }

    /// The anchor of level `n`.
    pub fn anchor(&self, n: usize) -> Option<Anchor> {
        self.anchors[n].clone()
    }
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
