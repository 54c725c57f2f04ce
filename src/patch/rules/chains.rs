//! What patches wish for, and chains of wishes that come true together; see [`super::exchange`].

use super::holder::{Asked, NOBODY};
use super::usage::Usage;
use crate::base::rng;
use crate::patch::data::field::{Cell, Nnf};
use crate::patch::data::patches::{Place, Windows};
use crate::patch::data::pose::Upright;
use crate::patch::data::sites::Sites;
use crate::patch::distance::Candidate;
use crate::patch::level::Level;
use crate::patch::patch_match::{Search, Sweep};

/// Most wishes of a chain.
pub(super) const LONGEST: usize = 3;

/// Wishes that a patch tries; the best chain counts. What a holder would lose is a guess, so the cheapest often fails.
const TRIES: usize = 4;
/// Sweeps from one in which a patch that can gain little is looked at to the next.
const REST: usize = 4;

/// What a patch wishes for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wish {
    pub target: u32,
    pub cell: Cell,
}

/// Patches that pass their places on along their wishes. All gain together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chain {
    pub gain: u32,
    /// Wishes that come true.
    pub length: u32,
    /// Whether the last wish is a place with room.
    pub to_room: bool,
    /// Otherwise the distance of its holder at the place of the first patch.
    pub closing: u32,
    /// What they wish for.
    pub wishes: [Cell; LONGEST],
    /// Who has to move, one more than wishes where the chain closes.
    pub members: [u32; LONGEST + 1],
}

/// What all patches of a batch see.
pub(super) struct State<'a> {
    pub level: &'a Level<'a>,
    pub search: Search<'a>,
    pub nnf: &'a Nnf,
    pub usage: &'a Usage,
    pub asked: &'a [Asked],
    /// What everybody wished for last.
    pub wishes: &'a [Cell],
    /// Patches nearer to their place than this can gain little, and are looked at in every [`REST`]th sweep only.
    pub quiet: u32,
}

/// What a thread uses again and again.
#[derive(Debug, Default)]
struct Scratch {
    candidates: Vec<Candidate>,
    distances: Vec<u32>,
    /// What every candidate costs, and its distance.
    offers: Vec<(i64, Cell)>,
}

impl State<'_> {
    /// Wishes and chains of `length` pixels of a row, one after the other.
    pub fn run(&self, start: usize, length: usize, sweep: Sweep) -> (Vec<Wish>, Vec<Chain>) {
        let (mut wishes, mut chains, mut scratch) = (Vec::with_capacity(length), Vec::new(), Scratch::default());
        // The place of the pixel before, or the one to which it is about to go.
        let mut before = Place::NONE;
        for k in 0..length {
            let target = if sweep.backwards() { start + length - 1 - k } else { start + k };
            let held = self.nnf.cells[target];
            if held.place == Place::NONE || self.rests(target, sweep) {
                before = held.place;
                continue;
            }
            self.offers(target, before, sweep, &mut scratch);
            let offers = scratch.offers.iter().take(TRIES);
            let best = offers.fold(None, |best, &(_, cell)| self.chain(target, cell, best));
            before = best.map_or(held.place, |chain| chain.wishes[0].place);
            wishes.extend(scratch.offers.first().map(|&(_, cell)| Wish { target: target as u32, cell }));
            chains.extend(best);
        }
        (wishes, chains)
    }

    fn rests(&self, target: usize, sweep: Sweep) -> bool {
        self.nnf.cells[target].distance < self.quiet && !(target + sweep.number).is_multiple_of(REST)
    }

    /// What a patch may wish for, the cheapest first: a place costs its distance, and what its holder would lose.
    fn offers(&self, target: usize, before: Place, sweep: Sweep, scratch: &mut Scratch) {
        let (held, last) = (self.nnf.cells[target], self.wishes[target]);
        let segment = self.level.target.labels()[target];
        let may_leave = self.usage.can_spare(held.place, segment);
        let cost = |cell: Cell| {
            let asked = self.asked[cell.place.index()];
            i64::from(cell.distance) + if asked.has_room && may_leave { 0 } else { asked.loss() }
        };
        let Scratch { candidates, distances, offers } = scratch;
        self.places(target, held.place, before, segment, sweep, candidates);
        self.search.distances(target, candidates, distances);
        offers.clear();
        let new = candidates.iter().zip(distances.iter());
        let new = new.map(|(candidate, &distance)| Cell::new(Place(candidate.centre), distance));
        let known = (last.place != Place::NONE && last.place != held.place).then_some(last);
        offers.extend(new.filter(|cell| cell.place != last.place).chain(known).map(|cell| (cost(cell), cell)));
        offers.sort_unstable_by_key(|&(cost, cell)| (cost, cell.place));
    }

    /// The best chain that starts with a patch and its wish, if it is better than `best`; otherwise that.
    fn chain(&self, first: usize, wish: Cell, mut best: Option<Chain>) -> Option<Chain> {
        let held = self.nnf.cells[first];
        let may_leave = self.usage.can_spare(held.place, self.level.target.labels()[first]);
        let (mut members, mut wishes) = ([NOBODY; LONGEST + 1], [Cell::NONE; LONGEST]);
        let (mut here, mut next, mut gain) = (held.distance, wish, 0i64);
        members[0] = first as u32;
        for length in 1..=LONGEST {
            let asked = self.asked[next.place.index()];
            wishes[length - 1] = next;
            gain += i64::from(here) - i64::from(next.distance);
            let least = best.map_or(0, |b| i64::from(b.gain));
            let chain = |total: i64, to_room: bool, closing: u32, members| Chain {
                gain: total as u32,
                length: length as u32,
                to_room,
                closing,
                wishes,
                members,
            };
            if asked.has_room && may_leave {
                return if gain > least { Some(chain(gain, true, 0, members)) } else { best };
            }
            if asked.holder == NOBODY || members[..length].contains(&asked.holder) {
                break;
            }
            members[length] = asked.holder;
            let left = gain + i64::from(asked.held);
            if left <= 0 {
                break;
            }
            let limit = (left - least).min(i64::from(u32::MAX));
            if limit > 0
                && let Some(closing) = self.search.distance_below(asked.holder as usize, held, limit as u32)
            {
                best = Some(chain(left - i64::from(closing), false, closing, members));
            }
            if asked.wish.place == next.place || asked.wish.place == Place::NONE {
                break;
            }
            (here, next) = (asked.held, asked.wish);
        }
        best
    }

    /// The neighbours' places moved by a pixel, and places at random round the held one.
    fn places(&self, target: usize, held: Place, before: Place, segment: u8, sweep: Sweep, out: &mut Vec<Candidate>) {
        out.clear();
        let source = &self.level.source;
        let mut push = |centre: Option<u32>| {
            if let Some(centre) = centre
                && centre != held.0
                && out.iter().all(|c| c.centre != centre)
            {
                out.push(Candidate { centre, base: 0, step: self.search.step(target, centre), pose: Upright });
            }
        };
        let side = if sweep.backwards() { 1 } else { -1 };
        if before != Place::NONE {
            push(source.beside(before.0, (-side, 0), segment));
        }
        let [_, above] = self.level.target.neighbours(target, false);
        let ([beside, _], [_, below]) =
            (self.level.target.neighbours(target, !sweep.backwards()), self.level.target.neighbours(target, true));
        for (neighbour, (x, y)) in [beside, above, below].into_iter().flatten() {
            let cell = self.nnf.cells[neighbour];
            if cell.place != Place::NONE {
                push(source.beside(cell.place.0, (-x as isize, -y as isize), segment));
            }
        }
        let chance = rng::mix(sweep.seed ^ rng::mix(target as u64));
        Windows::new(held, source, sweep.reach, chance).for_each(|place| push(source.in_segment(place, segment)));
    }
}
