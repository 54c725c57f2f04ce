//! PatchMatch (Barnes et al. 2009), in either direction, on any number of threads with the same result.
//!
//! The image is cut into bands of rows. A sweep goes through a band pixel by pixel, forwards or backwards: the neighbours'
//! matches, moved by one pixel, are tried (*propagation*), then places at random in ever smaller windows round the best one.
//! Inside its band a sweep sees what it has just found; of other bands it sees the state before the sweep. So bands can go
//! in any order.

use super::atlas::Place;
use super::channels::{Layout, MODULATION};
use super::distance::{Candidate, Comparison};
use super::nnf::{Cell, Nnf};
use super::segments::{NO_PATCH, Patches};
use crate::base::{par, rng};

/// Rows of a band.
const BAND: usize = 16;

/// The modulation, see [`super::channels::Role::Modulated`].
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
#[derive(Debug, Clone, Copy)]
pub struct Search<'a> {
    /// Channels and weights.
    pub layout: &'a Layout,
    /// Whose patches look for a neighbour.
    pub from: &'a Patches,
    /// Whose patches are found.
    pub to: &'a Patches,
    /// The modulation of the target.
    pub steps: Steps<'a>,
    /// Where an image is searched in itself: patches that differ by less than this across and down are not found; otherwise 0.
    pub apart: usize,
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

impl<'a> Search<'a> {
    fn comparison(&self) -> Comparison<'a> {
        Comparison { layout: self.layout, from: &self.from.stack, to: &self.to.stack }
    }

    pub(super) fn step(&self, from: usize, to: u32) -> u8 {
        match self.steps {
            Steps::Full => MODULATION,
            Steps::From(steps) => steps[from],
            Steps::To(steps) => steps[to as usize],
        }
    }

    /// The distance of the patch around pixel `from` and the one at `to`.
    pub(super) fn distance(&self, from: usize, to: Place) -> u32 {
        self.comparison().distance(from as u32, to.0, self.step(from, to.0))
    }

    /// Whether two patches are as far apart as they must be.
    pub(super) fn is_apart(&self, from: usize, to: usize) -> bool {
        let (w, v) = (self.from.stack.width, self.to.stack.width);
        self.apart == 0 || (from % w).abs_diff(to % v).max((from / w).abs_diff(to / v)) >= self.apart
    }

    /// That distance if it is below `limit`.
    pub(super) fn distance_below(&self, from: usize, to: Place, limit: u32) -> Option<u32> {
        let candidate = Candidate { centre: to.0, base: 0, step: self.step(from, to.0) };
        self.nearest(from, &[candidate], limit).map(|found| found.1)
    }

    /// The number of the nearest candidate and its distance, if that is below `limit`.
    pub(super) fn nearest(&self, from: usize, candidates: &[Candidate], limit: u32) -> Option<(usize, u32)> {
        self.comparison().nearest(from as u32, candidates, limit)
    }

    /// The distances of all candidates.
    pub(super) fn distances(&self, from: usize, candidates: &[Candidate], out: &mut Vec<u32>) {
        self.comparison().distances(from as u32, candidates, out);
    }

    /// Computes all distances anew, for places that were found in another state of the images.
    pub fn evaluate(&self, nnf: &mut Nnf) {
        par::for_each_chunk(&mut nnf.cells, BAND * self.from.stack.width, |band, cells| {
            let first = band * BAND * self.from.stack.width;
            for (i, cell) in cells.iter_mut().enumerate().filter(|(_, cell)| cell.place != Place::NONE) {
                cell.distance = self.distance(first + i, cell.place);
            }
        });
    }

    /// One sweep over all patches that have a place.
    pub fn sweep(&self, nnf: &mut Nnf, sweep: Sweep) {
        let before = nnf.cells.clone();
        let width = self.from.stack.width;
        par::for_each_chunk(&mut nnf.cells, BAND * width, |number, cells| {
            let band = Band { search: self, before: &before, first: number * BAND * width };
            let mut candidates = Vec::new();
            for k in 0..cells.len() {
                let k = if sweep.number.is_multiple_of(2) { k } else { cells.len() - 1 - k };
                if cells[k].place != Place::NONE {
                    band.improve(cells, k, sweep, &mut candidates);
                }
            }
        });
    }
}

/// Rows that one thread goes through.
struct Band<'a> {
    search: &'a Search<'a>,
    /// All cells before the sweep.
    before: &'a [Cell],
    /// Pixel number of the band's first cell.
    first: usize,
}

impl Band<'_> {
    fn improve(&self, cells: &mut [Cell], k: usize, sweep: Sweep, candidates: &mut Vec<Candidate>) {
        let at = self.first + k;
        let segment = self.search.from.labels()[at];
        debug_assert_ne!(segment, NO_PATCH);
        self.propagated(cells, k, segment, sweep.number % 2 == 1, candidates);
        self.offer(&mut cells[k], at, candidates);
        self.random(cells[k].place, at, segment, sweep, candidates);
        self.offer(&mut cells[k], at, candidates);
    }

    /// Takes the nearest candidate if it is nearer than the place held.
    fn offer(&self, cell: &mut Cell, at: usize, candidates: &[Candidate]) {
        if let Some((n, distance)) = self.search.nearest(at, candidates, cell.distance) {
            *cell = Cell { place: Place(candidates[n].centre), distance };
        }
    }

    fn candidate(&self, at: usize, place: isize, segment: u8) -> Option<Candidate> {
        let centre =
            self.search.to.in_segment(place, segment).filter(|&centre| self.search.is_apart(at, centre as usize))?;
        Some(Candidate { centre, base: 0, step: self.search.step(at, centre) })
    }

    /// The neighbours' matches, moved by one pixel.
    fn propagated(&self, cells: &[Cell], k: usize, segment: u8, backwards: bool, out: &mut Vec<Candidate>) {
        out.clear();
        let (from, to) = (self.search.from.stack.width as isize, self.search.to.stack.width as isize);
        let sign = if backwards { 1 } else { -1 };
        for (here, there) in [(sign, sign), (sign * from, sign * to)] {
            let at = self.first as isize + k as isize + here;
            let neighbour = match usize::try_from(k as isize + here).ok().and_then(|k| cells.get(k)) {
                Some(cell) => Some(cell),
                None => usize::try_from(at).ok().and_then(|i| self.before.get(i)),
            };
            let place = neighbour.map_or(Place::NONE, |cell| cell.place);
            // Where the neighbour has a patch the row does not end between them.
            if place != Place::NONE {
                let moved = place.0 as isize - there;
                if moved != cells[k].place.0 as isize {
                    out.extend(self.candidate(self.first + k, moved, segment));
                }
            }
        }
    }

    /// Places in windows round the best one.
    fn random(&self, best: Place, at: usize, segment: u8, sweep: Sweep, out: &mut Vec<Candidate>) {
        out.clear();
        let windows =
            Windows::new(best, self.search.to.stack.width, sweep.reach, rng::mix(sweep.seed ^ rng::mix(at as u64)));
        windows.for_each(|place| out.extend(self.candidate(at, place, segment)));
    }
}

/// Places by chance in windows round a patch, each half as large as the one before.
#[derive(Debug)]
pub(super) struct Windows {
    centre: isize,
    width: isize,
    reach: u64,
    chance: u64,
}

impl Windows {
    /// In an image of `width` pixels; `reach` is half the side of the first window.
    pub fn new(centre: Place, width: usize, reach: usize, chance: u64) -> Self {
        Self { centre: centre.0 as isize, width: width as isize, reach: reach as u64, chance }
    }
}

impl Iterator for Windows {
    type Item = isize;

    fn next(&mut self) -> Option<isize> {
        while self.reach > 0 {
            self.chance = rng::mix(self.chance);
            let reach = self.reach;
            let shift = |bits: u64| (((bits & 0xffff_ffff) * (2 * reach + 1)) >> 32) as isize - reach as isize;
            let (dx, dy) = (shift(self.chance), shift(self.chance >> 32));
            self.reach /= 2;
            if (0..self.width).contains(&(self.centre % self.width + dx)) {
                return Some(self.centre + dy * self.width + dx);
            }
        }
        None
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
            .map(|centre| Candidate { centre, base: 0, step: MODULATION })
            .collect();
        par::map(search.from.labels().len(), |i| {
            let is_patch = search.from.labels()[i] != NO_PATCH;
            is_patch.then(|| search.comparison().nearest(i as u32, &all, u32::MAX)).flatten().map_or(0, |f| f.1)
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
            let search = Search { layout: &layout, from, to, steps: Steps::Full, apart: 0 };
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
        let search = Search { layout: &layout, from: &a, to: &b, steps: Steps::Full, apart: 0 };
        let run = |threads| par::with_threads(threads, || found(&search, 3)).unwrap();
        assert!(run(1) == run(2) && run(1) == run(3));
    }
}
