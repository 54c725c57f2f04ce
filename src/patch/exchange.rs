//! Lowers the energy of a field with bounded usage: patches pass their places on, in a ring or to a place with room.
//!
//! As in PatchMatch, every patch looks at its neighbours' places moved by a pixel and at places at random. It wishes for the
//! one that costs least: its distance, and what the patch that holds it would lose by taking what that one wished for last
//! (prices, as in auctions: Bertsekas 1988). The holder has to take another place in turn, what it wishes for, and so on,
//! until somebody takes the place that the first one left. If all together gain, it is done (chains as in Lin & Kernighan
//! 1973). So the usage of every place stays within its bounds, and the energy never rises.

use super::atlas::Place;
use super::distance::Candidate;
use super::level::Level;
use super::nnf::{Cell, Nnf};
use super::patch_match::{Search, Sweep, Windows};
use super::segments::NO_PATCH;
use super::usage::Usage;
use crate::base::{par, rng};

/// Most patches that change places together.
const LONGEST: usize = 4;
/// Times that chains are found and carried out in a sweep.
const PASSES: u64 = 5;
/// Pixels that one thread goes through at a time.
const CHUNK: usize = 4096;
/// No partner: the place has room.
const NOBODY: u32 = u32::MAX;

/// Patches that pass their places on: from `first` along the wishes. All gain together.
#[derive(Debug, Clone, Copy)]
struct Chain {
    gain: u32,
    first: u32,
    /// Wishes that come true.
    length: u32,
    /// Whether the last wish is a place with room.
    to_room: bool,
    /// Otherwise the distance of its holder at the place of the first patch.
    closing: u32,
}

/// One sweep over all patches. Every patch makes a wish; then chains are found and carried out in several passes, since
/// chains that share a patch exclude each other.
pub(super) fn sweep(level: &Level, nnf: &mut Nnf, usage: &mut Usage, sweep: Sweep) {
    let mut wishes = Vec::new();
    let mut firsts: Vec<u32> = (0..nnf.cells.len() as u32).collect();
    for pass in 0..PASSES {
        let by_chance = pass > 0 || !sweep.number.is_multiple_of(2);
        let asked = asked(level, nnf, usage, by_chance.then(|| rng::mix(sweep.seed ^ pass)));
        let state = State { level, search: level.search(), nnf, usage, asked: &asked };
        if pass == 0 {
            wishes = in_chunks(nnf.cells.len(), |target, candidates| Some(state.wish(target, sweep, candidates)));
        }
        let mut chains = in_chunks(firsts.len(), |i, _| state.chain(firsts[i] as usize, &wishes));
        chains.sort_unstable_by_key(|chain| (std::cmp::Reverse(chain.gain), chain.first));
        settle(level, nnf, usage, &asked, &wishes, &chains);
        let waiting = |&first: &u32| wishes[first as usize].place != nnf.cells[first as usize].place;
        firsts = chains.iter().map(|chain| chain.first).filter(waiting).collect();
        firsts.sort_unstable();
    }
    usage.second_choices = wishes.iter().map(|wish| wish.distance).collect();
}

/// `f` of `0..n`, in order and without the `None`s; each thread has a list of its own to use again.
fn in_chunks<T: Send>(n: usize, f: impl Fn(usize, &mut Vec<Candidate>) -> Option<T> + Sync + Send) -> Vec<T> {
    let chunks = par::map(n.div_ceil(CHUNK), |chunk| {
        let mut scratch = Vec::new();
        (chunk * CHUNK..((chunk + 1) * CHUNK).min(n)).filter_map(|i| f(i, &mut scratch)).collect::<Vec<_>>()
    });
    chunks.into_iter().flatten().collect()
}

/// A place of the atlas, as those see it who would like to have it.
#[derive(Debug, Clone, Copy)]
struct Asked {
    /// Who would have to leave: the worst served patch there, or any one by chance.
    holder: u32,
    /// What it would lose by taking what it wished for last; negative if it would gain.
    loss: i32,
    /// Whether one more patch may come without any other leaving.
    has_room: bool,
}

/// Every pixel of the atlas, see [`Asked`].
fn asked(level: &Level, nnf: &Nnf, usage: &Usage, chance: Option<u64>) -> Vec<Asked> {
    let key = |target: usize, cell: Cell| chance.map_or(u64::from(cell.distance), |c| rng::mix(c ^ target as u64));
    let labels = level.atlas.patches.labels();
    let room = |i: usize| labels[i] != NO_PATCH && usage.has_room(Place(i as u32), labels[i]);
    let mut all: Vec<Asked> = (0..labels.len()).map(|i| Asked { holder: NOBODY, loss: 0, has_room: room(i) }).collect();
    for (target, cell) in nnf.assigned() {
        let asked = &mut all[cell.place.index()];
        if asked.holder == NOBODY || key(target, cell) > key(asked.holder as usize, nnf.cells[asked.holder as usize]) {
            asked.holder = target as u32;
            let second = usage.second_choices.get(target).copied().unwrap_or(0);
            // Distances have 30 bits.
            asked.loss = second as i32 - cell.distance as i32;
        }
    }
    all
}

/// Carries out the best chains first, leaving out those some of whose patches have changed meanwhile.
fn settle(level: &Level, nnf: &mut Nnf, usage: &mut Usage, asked: &[Asked], wishes: &[Cell], chains: &[Chain]) {
    let mut changed = vec![false; nnf.cells.len()];
    let mut members = Vec::with_capacity(LONGEST + 1);
    for chain in chains {
        members.clear();
        members.push(chain.first as usize);
        let mut last = Place::NONE;
        for k in 0..chain.length as usize {
            last = wishes[members[k]].place;
            if k + 1 < chain.length as usize || !chain.to_room {
                members.push(asked[last.index()].holder as usize);
            }
        }
        let first = nnf.cells[members[0]].place;
        let segment = level.target.labels()[members[0]];
        let possible = !chain.to_room || (usage.has_room(last, segment) && usage.can_spare(first, segment));
        if !possible || members.iter().any(|&m| changed[m]) {
            continue;
        }
        for &member in &members[..chain.length as usize] {
            nnf.cells[member] = wishes[member];
        }
        if chain.to_room {
            usage.moved(first, last);
        } else {
            nnf.cells[members[members.len() - 1]] = Cell { place: first, distance: chain.closing };
        }
        members.iter().for_each(|&m| changed[m] = true);
    }
}

/// What all patches see during a sweep.
struct State<'a> {
    level: &'a Level<'a>,
    search: Search<'a>,
    nnf: &'a Nnf,
    usage: &'a Usage,
    asked: &'a [Asked],
}

impl State<'_> {
    /// What a patch would like most: the place that costs least, its distance and what its holder would lose.
    fn wish(&self, target: usize, sweep: Sweep, candidates: &mut Vec<Candidate>) -> Cell {
        let held = self.nnf.cells[target];
        if held.place == Place::NONE {
            return held;
        }
        let segment = self.level.target.labels()[target];
        let may_leave = self.usage.can_spare(held.place, segment);
        let loss = |place: u32| match self.asked[place as usize] {
            Asked { has_room: true, .. } if may_leave => 0,
            asked => asked.loss,
        };
        self.places(target, held.place, segment, sweep, candidates);
        // Losses may be negative, what is added to a distance may not.
        let mut least = 0;
        for candidate in candidates.iter_mut() {
            let loss = loss(candidate.centre);
            least = least.min(loss);
            candidate.base = loss as u32;
        }
        candidates.iter_mut().for_each(|c| c.base = c.base.wrapping_sub(least as u32));
        self.search.nearest(target, candidates, u32::MAX).map_or(held, |(n, cost)| {
            let Candidate { centre, base, .. } = candidates[n];
            Cell { place: Place(centre), distance: cost - base }
        })
    }

    /// The best chain that starts with a patch.
    fn chain(&self, first: usize, wishes: &[Cell]) -> Option<Chain> {
        let held = self.nnf.cells[first];
        if held.place == Place::NONE {
            return None;
        }
        let may_leave = self.usage.can_spare(held.place, self.level.target.labels()[first]);
        let mut members = [NOBODY; LONGEST];
        let (mut target, mut gain) = (first, 0i64);
        let mut best: Option<Chain> = None;
        let mut offer = |total: i64, length: usize, to_room: bool, closing: u32| {
            if total > best.map_or(0, |b| i64::from(b.gain)) {
                best = Some(Chain { gain: total as u32, first: first as u32, length: length as u32, to_room, closing });
            }
        };
        for length in 1..LONGEST {
            let (here, wish) = (self.nnf.cells[target], wishes[target]);
            let asked = self.asked[wish.place.index()];
            members[length - 1] = target as u32;
            gain += i64::from(here.distance) - i64::from(wish.distance);
            if asked.has_room && may_leave && wish.place != here.place {
                offer(gain, length, true, 0);
                break;
            }
            if asked.holder == NOBODY || members[..length].contains(&asked.holder) || wish.place == here.place {
                break;
            }
            let holder = asked.holder as usize;
            let left = gain + i64::from(self.nnf.cells[holder].distance);
            if left <= 0 {
                break;
            }
            if let Some(closing) = self.search.distance_below(holder, held.place, left.min(i64::from(u32::MAX)) as u32)
            {
                offer(left - i64::from(closing), length, false, closing);
            }
            target = holder;
        }
        best
    }

    /// The neighbours' places moved by a pixel, and places at random round the held one.
    fn places(&self, target: usize, held: Place, segment: u8, sweep: Sweep, out: &mut Vec<Candidate>) {
        out.clear();
        let (from, to) = (self.level.target.stack.width as isize, self.level.atlas.patches.stack.width as isize);
        let mut push = |place: isize| {
            if place != held.0 as isize
                && let Some(centre) = self.level.atlas.patches.in_segment(place, segment)
            {
                out.push(Candidate { centre, base: 0, step: self.search.step(target, centre) });
            }
        };
        for (here, there) in [(-1, -1), (1, 1), (-from, -to), (from, to)] {
            let neighbour = usize::try_from(target as isize + here).ok().and_then(|i| self.nnf.cells.get(i));
            if let Some(cell) = neighbour.filter(|cell| cell.place != Place::NONE) {
                push(cell.place.0 as isize - there);
            }
        }
        Windows::new(held, to as usize, sweep.reach, rng::mix(sweep.seed ^ rng::mix(target as u64))).for_each(push);
    }
}
