//! One level of a frame, and a target on all of them.

use super::atlas::{Atlas, Layers};
use super::channels::{Layout, MODULATION, Stack};
use super::image::Target;
use super::nnf::{Nnf, usage_picture};
use super::patch_match::{Search, Steps};
use super::rules::Rules;
use super::segments::{Patches, Thresholds, labels};
use super::vote::Anchor;
use crate::base::observe::Observer;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::pyramid::reduce;

/// One level of one frame, ready to be worked on.
#[derive(Debug)]
pub(super) struct Level<'a> {
    pub layout: &'a Layout,
    pub atlas: &'a Atlas,
    /// The synthesised channels of the atlas alone.
    pub colours: Stack,
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

    /// Overwrites the synthesised channels of the target by what the field says.
    pub fn vote(&mut self, nnf: &Nnf, rules: &Rules) {
        let mut stack = std::mem::take(&mut self.target.stack);
        rules.vote(self, nnf).write(&mut stack);
        self.target.stack = stack;
    }

    /// Goes beyond what the field says by half the step where its patches are blended. For a given field the energy is
    /// quadratic round the vote, so it still falls by three quarters of what the vote gains, and fewer rounds are needed
    /// (over-relaxation).
    pub fn overshoot(&mut self, nnf: &Nnf, rules: &Rules) {
        let before = self.target.stack.clone();
        self.vote(nnf, rules);
        if !rules.blends() {
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
    }

    /// Starts from what a coarser level's field says, and from the target's own channels where they are kept.
    pub fn start(&mut self, nnf: &Nnf, rules: &Rules, kept: Option<&[u8]>) {
        let own = self.target.stack.clone();
        self.vote(nnf, rules);
        let (channels, synthesised) = (own.channels, self.layout.synthesised());
        let pixels = self.target.stack.bytes_mut().chunks_exact_mut(channels);
        for ((pixel, own), &step) in pixels.zip(own.bytes().chunks_exact(channels)).zip(kept.unwrap_or_default()) {
            let share = f32::from(step.min(MODULATION)) / f32::from(MODULATION);
            let mixed = |a: u8, b: u8| (f32::from(a) + share * (f32::from(b) - f32::from(a)) + 0.5) as u8;
            pixel[..synthesised].iter_mut().zip(own).for_each(|(p, &o)| *p = mixed(*p, o));
        }
    }

    /// The energy of a field whose distances are known: those, and what the anchor adds.
    pub fn energy(&self, nnf: &Nnf) -> f64 {
        let held = self.anchor.as_ref().map_or(0.0, |anchor| anchor.energy(self.layout, &self.target.stack));
        self.layout.to_energy(nnf.total() as f64) + held
    }

    /// Hands the field, the usage counts and the channels of a level to an observer that wants pictures.
    pub fn show(&self, nnf: &Nnf, n: usize, observer: &dyn Observer) {
        if !observer.wants_pictures() {
            return;
        }
        let send = |name: &str, picture: &Rgb8| {
            observer.picture(&format!("level {n} {name}"), (picture.width, picture.height), &picture.data);
        };
        send("field", &nnf.picture(self.atlas));
        let mean = self.target.count() as f64 / self.atlas.patches.count().max(1) as f64;
        send("usage", &usage_picture(&nnf.usage(self.atlas), self.atlas, mean));
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
    layers: Vec<Layers>,
    modulation: Option<Vec<Vec<u8>>>,
    kept: Option<Vec<Vec<u8>>>,
    anchors: Vec<Option<Anchor>>,
}

impl Levels {
    /// `count` levels.
    pub fn new(target: &Target, count: usize) -> Self {
        Self {
            layers: target.image.pyramid(count),
            modulation: target.modulation.as_ref().map(|m| modulation_pyramid(m, count)),
            kept: target.kept.as_ref().map(|k| modulation_pyramid(k, count)),
            anchors: anchor_pyramid(target.anchor.as_ref(), count),
        }
    }

    /// The patches of level `n`.
    pub fn patches(&self, n: usize, layout: &Layout, thresholds: Thresholds) -> Patches {
        let (planes, blurred) = &self.layers[n];
        let size = (planes[0].width, planes[0].height);
        Patches::new(Stack::from_planes(planes), labels(size, layout.radius(), blurred.as_ref(), thresholds))
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
