//! PatchMatch (Barnes et al. 2009), in either direction, on any number of threads with the same result.
//!
//! The target is cut into bands. A sweep goes through a band site by site, forwards or backwards: the neighbours' matches,
//! moved by as much as they lie apart, are tried (*propagation*), then places at random in ever smaller windows round the
//! best one, through the frames of a clip too, and in poses ever more like its own (Barnes et al. 2010). Inside its band a
//! sweep sees what it has just found; of other bands it sees the state before the sweep. So bands can go in any order.
//!
//! Upright patches are compared where they lie. Turned ones are first sampled into a run of memory and compared by the same
//! instructions.

use super::data::channels::{Layout, MODULATION, Stack};
use super::data::field::{Cell, Nnf};
use super::data::patches::{Offset, Patches, Place, Windows};
use super::data::pose::{Pose, Upright};
use super::data::segments::NO_PATCH;
use super::data::sites::Sites;
use super::distance::{Candidate, Rows, distances_in_place, gathered_below, nearest_in_place};
use super::terms::{Pass, Terms};
use crate::base::{par, rng};

/// The modulation, see [`super::data::channels::Role::Modulated`].
#[derive(Debug, Clone, Copy)]
pub enum Steps<'a> {
    /// Full everywhere.
    Full,
    /// By the patch that looks for a neighbour.
    From(&'a [u8]),
    /// By the patch that is found.
    To(&'a [u8]),
}

/// A search: for every patch of `from` the nearest one of `to` in the same segment.
#[derive(Clone, Copy)]
pub struct Search<'a, P: Pose = Upright, S = Patches> {
    /// Channels and weights.
    pub layout: &'a Layout,
    /// Whose patches look for a neighbour.
    pub from: &'a S,
    /// The same with some channels exchanged, where a candidate may be compared with those.
    pub swapped: Option<&'a Stack>,
    /// Whose patches are found.
    pub to: &'a Patches,
    /// The modulation of the target.
    pub steps: Steps<'a>,
    /// Where an image is searched in itself: patches that differ by less than this across and down are not found; otherwise 0.
    pub apart: usize,
    /// What a method adds to distances, if anything.
    pub terms: Option<&'a dyn Terms<P>>,
    /// For the terms.
    pub pass: Pass,
}

impl<'a, P: Pose, S: Sites> Search<'a, P, S> {
    /// A search without modulation and terms.
    pub fn plain(layout: &'a Layout, from: &'a S, to: &'a Patches) -> Self {
        Self { layout, from, swapped: None, to, steps: Steps::Full, apart: 0, terms: None, pass: Pass::default() }
    }
}

/// How one sweep goes.
#[derive(Debug, Clone, Copy)]
pub struct Sweep {
    /// Number of the sweep: odd ones go backwards.
    pub number: usize,
    /// Half the side of the first random window in pixels; 0 only propagates.
    pub reach: usize,
    /// Seed of the random places.
    pub seed: u64,
}

impl Sweep {
    /// Whether it goes from the last pixel to the first.
    pub(super) fn backwards(self) -> bool {
        !self.number.is_multiple_of(2)
    }
}

/// What a thread uses again and again. Patches that are compared where they lie need none of it.
#[derive(Debug)]
pub(super) struct Scratch<P> {
    target: Vec<u8>,
    source: Vec<u8>,
    poses: Vec<P>,
}

impl<P> Default for Scratch<P> {
    fn default() -> Self {
        Self { target: Vec::new(), source: Vec::new(), poses: Vec::new() }
    }
}

impl<P: Pose, S: Sites> Search<'_, P, S> {
    pub(super) fn step(&self, from: usize, to: u32) -> u8 {
        match self.steps {
            Steps::Full => MODULATION,
            Steps::From(steps) => steps[from],
            Steps::To(steps) => steps[to as usize],
        }
    }

    /// Whether patches are compared where they lie, without any copy.
    #[inline]
    fn in_place(&self) -> bool {
        P::UPRIGHT && self.swapped.is_none() && self.from.in_place()
    }

    /// Adds a place to the candidates of a site, in every pose that is to be tried. `led` is the one that led there.
    pub(super) fn push(&self, from: usize, centre: u32, led: P, poses: &mut Vec<P>, out: &mut Vec<Candidate<P>>) {
        let step = self.step(from, centre);
        let Some(terms) = self.terms else {
            out.push(Candidate { centre, base: 0, step, pose: led });
            return;
        };
        let place = Place(centre);
        poses.clear();
        terms.poses(self.pass, from, place, led, poses);
        let candidate = |&pose: &P| Candidate { centre, base: terms.cost(self.pass, from, place, pose), step, pose };
        out.extend(poses.iter().map(candidate));
    }

    /// A place in a pose as a candidate of a site.
    pub(super) fn candidate(&self, from: usize, place: Place, pose: P) -> Candidate<P> {
        let base = self.terms.map_or(0, |terms| terms.cost(self.pass, from, place, pose));
        Candidate { centre: place.0, base, step: self.step(from, place.0), pose }
    }

    /// The distance of the patch around pixel `from` and the one of `cell`.
    pub(super) fn distance(&self, from: usize, cell: Cell<P>) -> u32 {
        self.distance_below(from, cell, u32::MAX).unwrap_or(u32::MAX)
    }

    /// Whether two patches are as far apart as they must be.
    pub(super) fn is_apart(&self, from: usize, to: usize) -> bool {
        self.apart == 0 || !self.from.are_near(from, to, self.apart)
    }

    /// That distance if it is below `limit`.
    pub(super) fn distance_below(&self, from: usize, cell: Cell<P>, limit: u32) -> Option<u32> {
        let candidate = self.candidate(from, cell.place, cell.pose);
        self.nearest(from, &[candidate], limit, &mut Scratch::default()).map(|found| found.1)
    }

    /// The number of the nearest candidate and its distance, if that is below `limit`.
    #[inline]
    pub(super) fn nearest(
        &self,
        from: usize,
        candidates: &[Candidate<P>],
        limit: u32,
        scratch: &mut Scratch<P>,
    ) -> Option<(usize, u32)> {
        if self.in_place() {
            let (bytes, stride) = self.from.rows(from, self.layout, &mut scratch.target);
            return nearest_in_place(self.layout, Rows { bytes, stride }, &self.to.stack, candidates, limit);
        }
        self.nearest_gathered(from, candidates, limit, scratch)
    }

    fn nearest_gathered(
        &self,
        from: usize,
        candidates: &[Candidate<P>],
        limit: u32,
        scratch: &mut Scratch<P>,
    ) -> Option<(usize, u32)> {
        let (mut best, mut found) = (limit, None);
        let (bytes, stride) = self.from.rows(from, self.layout, &mut scratch.target);
        let rows = Rows { bytes, stride };
        // The swapped channels lie as the others do.
        let other = self.swapped.map(|stack| {
            let corner = (from - self.layout.radius() * (stack.width + 1)) * stack.channels;
            Rows { bytes: &stack.bytes()[corner..], stride: stack.stride() }
        });
        let frame = self.from.frame(from);
        for (n, &candidate) in candidates.iter().enumerate().filter(|(_, c)| c.base < limit) {
            let rows = other.filter(|_| self.is_swapped(from, candidate)).unwrap_or(rows);
            let matrix = candidate.pose.matrix().after(frame);
            let below = gathered_below(self.layout, rows, self.to, (candidate, matrix), best, &mut scratch.source);
            if let Some(distance) = below {
                (best, found) = (distance, Some(n));
            }
        }
        found.map(|n| (n, best))
    }

    fn is_swapped(&self, from: usize, candidate: Candidate<P>) -> bool {
        self.terms.is_some_and(|terms| terms.is_swapped(self.pass, from, Place(candidate.centre), candidate.pose))
    }

    /// The distances of all candidates.
    pub(super) fn distances(&self, from: usize, candidates: &[Candidate<P>], out: &mut Vec<u32>) {
        out.clear();
        if self.in_place() {
            let mut none = Vec::new();
            let (bytes, stride) = self.from.rows(from, self.layout, &mut none);
            distances_in_place(self.layout, Rows { bytes, stride }, &self.to.stack, candidates, out);
        } else {
            let mut scratch = Scratch::default();
            let each = candidates.iter().map(|c| self.nearest_gathered(from, &[*c], u32::MAX, &mut scratch));
            out.extend(each.map(|found| found.map_or(u32::MAX, |(_, distance)| distance)));
        }
    }

    /// Computes all distances anew, for places that were found in another state of the images.
    pub fn evaluate(&self, nnf: &mut Nnf<P>) {
        let band = self.from.band();
        par::for_each_chunk(&mut nnf.cells, band, |number, cells| {
            for (i, cell) in cells.iter_mut().enumerate().filter(|(_, cell)| cell.place != Place::NONE) {
                cell.distance = self.distance(number * band + i, *cell);
            }
        });
    }

    /// Takes every place of `other` that is nearer.
    pub(super) fn merge(&self, nnf: &mut Nnf<P>, other: &Nnf<P>) {
        self.evaluate(nnf);
        let mut other = other.clone();
        self.evaluate(&mut other);
        for (cell, other) in nnf.cells.iter_mut().zip(other.cells) {
            if other.place != Place::NONE && (cell.place == Place::NONE || other.distance < cell.distance) {
                *cell = other;
            }
        }
    }

    /// One sweep over all patches that have a place.
    pub fn sweep(&self, nnf: &mut Nnf<P>, sweep: Sweep) {
        let before = nnf.cells.clone();
        let length = self.from.band();
        par::for_each_chunk(&mut nnf.cells, length, |number, cells| {
            let band = Band { search: self, before: &before, first: number * length };
            let (mut candidates, mut scratch) = (Vec::new(), Scratch::default());
            for k in 0..cells.len() {
                let k = if sweep.backwards() { cells.len() - 1 - k } else { k };
                if cells[k].place != Place::NONE {
                    band.improve(cells, k, sweep, &mut candidates, &mut scratch);
                }
            }
        });
    }

    /// The place to which a neighbour's leads a site, `offset` pixels from it in its own frame.
    #[inline]
    fn led(&self, neighbour: usize, cell: Cell<P>, (x, y): (i32, i32), segment: u8) -> Option<u32> {
        if P::UPRIGHT && self.from.in_place() {
            return self.to.beside(cell.place.0, (x as isize, y as isize), segment);
        }
        let (x, y) = cell.pose.matrix().after(self.from.frame(neighbour)).step(x, y);
        self.to.moved(cell.place, Offset { x, y, t: 0 }, segment).map(|place| place.0)
    }
}

/// Sites that one thread goes through.
pub(super) struct Band<'a, P: Pose, S = Patches> {
    pub search: &'a Search<'a, P, S>,
    /// All cells before the sweep.
    pub before: &'a [Cell<P>],
    /// Number of the band's first site.
    pub first: usize,
}

impl<P: Pose, S: Sites> Band<'_, P, S> {
    fn improve(
        &self,
        cells: &mut [Cell<P>],
        k: usize,
        sweep: Sweep,
        candidates: &mut Vec<Candidate<P>>,
        scratch: &mut Scratch<P>,
    ) {
        let at = self.first + k;
        let segment = self.search.from.labels()[at];
        debug_assert_ne!(segment, NO_PATCH);
        self.propagated(cells, k, sweep.backwards(), candidates, scratch);
        self.offer(&mut cells[k], at, candidates, scratch);
        self.random(cells[k], at, sweep, candidates, scratch);
        self.offer(&mut cells[k], at, candidates, scratch);
    }

    /// Takes the nearest candidate if it is nearer than the place held.
    fn offer(&self, cell: &mut Cell<P>, at: usize, candidates: &[Candidate<P>], scratch: &mut Scratch<P>) {
        if let Some((n, distance)) = self.search.nearest(at, candidates, cell.distance, scratch) {
            *cell = Cell { place: Place(candidates[n].centre), distance, pose: candidates[n].pose };
        }
    }

    /// The neighbours' matches, moved by as much as they lie apart.
    pub fn propagated(
        &self,
        cells: &[Cell<P>],
        k: usize,
        backwards: bool,
        out: &mut Vec<Candidate<P>>,
        scratch: &mut Scratch<P>,
    ) {
        out.clear();
        let at = self.first + k;
        let segment = self.search.from.labels()[at];
        for (neighbour, (x, y)) in self.search.from.neighbours(at, backwards).into_iter().flatten() {
            let inside = neighbour.checked_sub(self.first).and_then(|i| cells.get(i));
            let cell = *inside.unwrap_or(&self.before[neighbour]);
            if cell.place == Place::NONE {
                continue;
            }
            let centre = self.search.led(neighbour, cell, (-x, -y), segment);
            let new = |&centre: &u32| (Place(centre), cell.pose) != (cells[k].place, cells[k].pose);
            let apart = |&centre: &u32| self.search.is_apart(at, centre as usize);
            if let Some(centre) = centre.filter(new).filter(apart) {
                self.search.push(at, centre, cell.pose, &mut scratch.poses, out);
            }
        }
    }

    /// Places in windows round the best one, in poses ever more like its own.
    pub fn random(
        &self,
        best: Cell<P>,
        at: usize,
        sweep: Sweep,
        out: &mut Vec<Candidate<P>>,
        scratch: &mut Scratch<P>,
    ) {
        out.clear();
        let segment = self.search.from.labels()[at];
        let chance = rng::mix(sweep.seed ^ rng::mix(at as u64));
        for (n, place) in Windows::new(best.place, self.search.to, sweep.reach, chance).enumerate() {
            // Far places are tried in like poses too, and near ones in unlike poses.
            let pose = if P::REACH > 0 {
                let chance = rng::hash(chance, &[n as u64, 1]);
                best.pose.near(P::REACH >> (chance % u64::from(P::REACH.ilog2() + 1)), chance)
            } else {
                best.pose
            };
            if let Some(centre) = self.search.to.in_segment(place, segment)
                && self.search.is_apart(at, centre as usize)
            {
                self.search.push(at, centre, pose, &mut scratch.poses, out);
            }
        }
        if P::REACH > 0 {
            self.turned(best, at, chance, out, scratch);
        }
    }

    /// The best place itself, and one beside it, in other poses.
    fn turned(&self, best: Cell<P>, at: usize, chance: u64, out: &mut Vec<Candidate<P>>, scratch: &mut Scratch<P>) {
        let segment = self.search.from.labels()[at];
        let (mut reach, mut number) = (P::REACH, 0);
        while reach > 0 {
            let chance = rng::hash(chance, &[number]);
            self.search.push(at, best.place.0, best.pose.near(reach, chance), &mut scratch.poses, out);
            let step = |bits: u64| rng::below(rng::mix(chance ^ bits), 3) as isize - 1;
            let offset = Offset { x: step(1), y: step(2), t: if self.search.to.frames() > 1 { step(3) } else { 0 } };
            if let Some(beside) = self.search.to.moved(best.place, offset, segment)
                && self.search.is_apart(at, beside.index())
            {
                let pose = best.pose.near(reach, rng::mix(chance));
                self.search.push(at, beside.0, pose, &mut scratch.poses, out);
            }
            (reach, number) = (reach / 2, number + 1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{grey_layout, grey_patches, texture};
    use super::*;
    use crate::raster::image::Plane;

    /// The least distance of every patch, by trying all.
    fn brute_force(search: &Search) -> Vec<u32> {
        let all: Vec<Candidate> = (0..search.to.labels().len() as u32)
            .filter(|&i| search.to.labels()[i as usize] != NO_PATCH)
            .map(|centre| Candidate { centre, base: 0, step: MODULATION, pose: Upright })
            .collect();
        par::map(search.from.labels().len(), |i| {
            let is_patch = search.from.labels()[i] != NO_PATCH;
            is_patch.then(|| search.nearest(i, &all, u32::MAX, &mut Scratch::default())).flatten().map_or(0, |f| f.1)
        })
    }

    fn found(search: &Search, sweeps: usize) -> Nnf {
        let mut nnf = Nnf::random(search.from, search.to, 9);
        search.evaluate(&mut nnf);
        (0..sweeps).for_each(|number| search.sweep(&mut nnf, Sweep { number, reach: 96, seed: number as u64 }));
        nnf
    }

    #[test]
    fn nearly_all_patches_are_nearly_the_nearest_in_both_directions() {
        let layout = grey_layout(2);
        // As in synthesis: one shows what the other shows, in other places and bent.
        let exemplar = texture(96, 80, 0.0);
        let bent = |x: usize, y: usize| {
            let (x, y) = (x as f32, y as f32);
            exemplar.bilinear(x + 6.0 + 2.0 * (y / 20.0).sin(), y + 5.0 + 2.0 * (x / 20.0).cos())
        };
        let (a, b) = (grey_patches(&Plane::from_fn(86, 72, bent), 2), grey_patches(&exemplar, 2));
        let seen = grey_patches(&Plane::from_fn(80, 66, |x, y| exemplar.at(x + 8, y + 7)), 2);
        for (from, to) in [(&a, &b), (&seen, &a)] {
            let search = Search::plain(&layout, from, to);
            let best = brute_force(&search);
            let nnf = found(&search, 8);
            let near = |&(i, cell): &(usize, Cell)| f64::from(cell.distance) <= 1.05 * f64::from(best[i]);
            let good = nnf.assigned().filter(near).count();
            assert!(good * 100 >= from.count() * 95, "{good} of {}", from.count());
            assert!(nnf.assigned().all(|(i, cell)| cell.distance >= best[i]));
        }
    }

    #[test]
    fn threads_do_not_change_it() {
        let layout = grey_layout(1);
        let (a, b) = (grey_patches(&texture(90, 77, 0.0), 1), grey_patches(&texture(64, 64, 11.0), 1));
        let search = Search::plain(&layout, &a, &b);
        let run = |threads| par::with_threads(threads, || found(&search, 3)).unwrap();
        assert!(run(1) == run(2) && run(1) == run(3));
    }
}
