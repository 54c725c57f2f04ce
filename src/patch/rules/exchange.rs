//! Lowers the energy of a field with bounded usage: patches pass their places on, in a ring or to a place with room.
//!
//! As in PatchMatch, every patch looks at its neighbours' places moved by a pixel and at places at random. It wishes for the
//! one that costs least: its distance, and what the patch that holds it would lose by taking what that one wished for last
//! (prices, as in auctions: Bertsekas 1988). The holder has to take another place in turn, what it wishes for, and so on,
//! until somebody takes the place that the first one left. If all together gain, it is done (chains as in Lin & Kernighan
//! 1973). So the usage of every place stays within its bounds, and the energy never rises.
//!
//! A sweep goes through the rows in batches: every so many rows form one. The patches of a batch make their wishes and find
//! their chains at the same time, on any number of threads; then the chains are carried out one after the other, the best
//! first, and the next batch sees it. So a good place spreads from row to row within one sweep.

use super::chains::{Chain, LONGEST, State};
use super::holder::{Asked, NOBODY};
use super::usage::{BoundsOf, Usage};
use crate::base::{par, rng};
use crate::patch::data::field::{Cell, Nnf};
use crate::patch::data::patches::Place;
use crate::patch::data::segments::NO_PATCH;
use crate::patch::level::Level;
use crate::patch::patch_match::Sweep;

/// Pixels of a row that one thread goes through at a time.
const RUN: usize = 256;
/// Most batches of a sweep.
const BATCHES: usize = 64;
/// Least rows of a batch, where there are as many.
const ROWS: usize = 8;
/// A patch whose distance is less than the mean one by this factor can gain little.
const QUIET: u64 = 2;
/// A field that keeps to bounds while its patches exchange places.
#[derive(Debug)]
pub(super) struct Exchange {
    usage: Usage,
    /// What every target patch wished for last.
    wishes: Nnf,
    /// Every pixel of the atlas.
    asked: Vec<Asked>,
    /// For every target patch the batch in which it changed its place last.
    changed: Vec<u32>,
    /// Number of the batch, over all sweeps.
    batch: u32,
}

impl Exchange {
    /// Makes `nnf` keep to the bounds, see [`Usage::enforce`].
    pub fn new(level: &Level, nnf: &mut Nnf, bounds: BoundsOf) -> Self {
        let usage = Usage::enforce(level, nnf, bounds);
        let n = nnf.cells.len();
        let wishes = Nnf { width: nnf.width, cells: vec![Cell::NONE; n] };
        Self { usage, wishes, asked: Vec::new(), changed: vec![0; n], batch: 0 }
    }

    /// Bytes that it takes beside the field, for so many pixels of the target and of the source: what every patch wishes for
    /// and when it changed; who is asked for a place, and how often it is used.
    pub const fn bytes(targets: usize, sources: usize) -> usize {
        (size_of::<Cell>() + size_of::<u32>()) * targets + (size_of::<Asked>() + size_of::<u32>()) * sources
    }

    /// Computes the distances of all wishes anew, when the images have changed.
    pub fn evaluate(&mut self, level: &Level) {
        level.search().evaluate(&mut self.wishes);
    }

    /// One sweep over all patches.
    pub fn sweep(&mut self, level: &Level, nnf: &mut Nnf, sweep: Sweep) {
        let by_chance = !sweep.number.is_multiple_of(2);
        self.ask(level, nnf, by_chance.then_some(sweep.seed));
        let quiet = (nnf.total() / (QUIET * nnf.assigned().count().max(1) as u64)) as u32;
        let (width, height) = (nnf.width, nnf.cells.len() / nnf.width);
        let batches = (height / ROWS).clamp(1, BATCHES);
        for batch in 0..batches {
            let first = if sweep.backwards() { batches - 1 - batch } else { batch };
            let rows = (first..height).step_by(batches);
            let runs = rows.flat_map(|y| (0..width).step_by(RUN).map(move |x| (y * width + x, RUN.min(width - x))));
            self.batch(level, nnf, &runs.collect::<Vec<_>>(), sweep, quiet);
        }
    }

    /// Wishes and chains of the patches in `runs`, first pixel and length, and the best of the chains carried out.
    fn batch(&mut self, level: &Level, nnf: &mut Nnf, runs: &[(usize, usize)], sweep: Sweep, quiet: u32) {
        let (usage, asked, wishes) = (&self.usage, &self.asked[..], &self.wishes.cells[..]);
        let state = State { level, search: level.search(), nnf, usage, asked, wishes, quiet };
        let found = par::map(runs.len(), |i| state.run(runs[i].0, runs[i].1, sweep));
        let mut chains: Vec<&Chain> = found.iter().flat_map(|found| &found.1).collect();
        chains.sort_unstable_by_key(|chain| (std::cmp::Reverse(chain.gain), chain.members[0]));
        self.batch += 1;
        chains.iter().for_each(|chain| self.settle(level, nnf, chain));
        for wish in found.iter().flat_map(|found| &found.0) {
            let target = wish.target as usize;
            if self.changed[target] != self.batch {
                self.wishes.cells[target] = wish.cell;
                let asked = &mut self.asked[nnf.cells[target].place.index()];
                if asked.holder == wish.target {
                    asked.wish = wish.cell;
                }
            }
        }
    }

    /// Says of every place who is asked to leave it.
    fn ask(&mut self, level: &Level, nnf: &Nnf, chance: Option<u64>) {
        let key = |target: usize, cell: Cell| match chance {
            None => i64::from(self.wishes.cells[target].distance) - i64::from(cell.distance),
            Some(chance) => (rng::mix(chance ^ target as u64) >> 1) as i64,
        };
        let labels = level.source.labels();
        let room = |i: usize| labels[i] != NO_PATCH && self.usage.has_room(Place(i as u32), labels[i]);
        let nobody = |i: usize| Asked { holder: NOBODY, held: 0, wish: Cell::NONE, has_room: room(i) };
        let mut all: Vec<Asked> = (0..labels.len()).map(nobody).collect();
        for (target, cell) in nnf.assigned() {
            let asked = &mut all[cell.place.index()];
            if asked.holder == NOBODY
                || key(target, cell) < key(asked.holder as usize, nnf.cells[asked.holder as usize])
            {
                asked.hold(target as u32, cell, self.wishes.cells[target]);
            }
        }
        self.asked = all;
    }

    /// Carries out a chain, unless some of its patches have changed meanwhile.
    fn settle(&mut self, level: &Level, nnf: &mut Nnf, chain: &Chain) {
        let length = chain.length as usize;
        let members = &chain.members[..length + usize::from(!chain.to_room)];
        if members.iter().any(|&m| self.changed[m as usize] == self.batch) {
            return;
        }
        let first = nnf.cells[members[0] as usize].place;
        let mut news = [Cell::new(first, chain.closing); LONGEST + 1];
        news[..length].copy_from_slice(&chain.wishes[..length]);
        if chain.to_room && !self.make_room(level, members[0], first, news[length - 1].place) {
            return;
        }
        for (k, (&member, &new)) in members.iter().zip(&news).enumerate() {
            let next = (k + 1) % members.len();
            let left = (next > 0 || !chain.to_room).then_some(members[next]);
            self.put(nnf, member, new, left);
        }
    }

    /// Counts one use from place `from`, which `member` leaves, to place `to`, if the bounds allow it now.
    fn make_room(&mut self, level: &Level, member: u32, from: Place, to: Place) -> bool {
        let segment = level.target.labels()[member as usize];
        let possible = self.usage.has_room(to, segment) && self.usage.can_spare(from, segment);
        if possible {
            self.usage.moved(from, to);
            self.asked[to.index()].has_room = self.usage.has_room(to, segment);
            let asked = &mut self.asked[from.index()];
            asked.has_room = true;
            if asked.holder == member {
                asked.holder = NOBODY;
            }
        }
        possible
    }

    /// Gives a patch the place that `left` leaves, or one with room.
    fn put(&mut self, nnf: &mut Nnf, member: u32, new: Cell, left: Option<u32>) {
        let m = member as usize;
        let old = nnf.cells[m];
        nnf.cells[m] = new;
        // What it had is what it would take next, if nothing better is known.
        let wish = &mut self.wishes.cells[m];
        if wish.place == new.place || wish.place == Place::NONE || wish.distance > old.distance {
            *wish = old;
        }
        self.changed[m] = self.batch;
        let asked = &mut self.asked[new.place.index()];
        if asked.holder == NOBODY || Some(asked.holder) == left {
            asked.hold(member, new, *wish);
        }
    }
}
