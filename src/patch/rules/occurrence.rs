//! What is shown often costs: every place of a clip has a price for the patches that cover it in space and time (Fluidymation
//! 2021, §3.5; in one image Kaspar et al. 2015), beside rules that bound its use.
//!
//! With one patch moved at a time the energy `Σ distances + ½ Σ prices` cannot rise, a patch's price being what the others
//! cover. Patches of one batch move at a time: those that lie far apart, so that they hardly ever want the same place. After
//! each batch what is covered is counted anew. So the result is the same on any number of threads.

use super::constraint::Constraint;
use crate::base::{par, rng};
use crate::patch::data::field::{Cell, Nnf};
use crate::patch::data::patches::{Footprint, Patches, Place};
use crate::patch::data::pose::Pose;
use crate::patch::data::segments::SEGMENTS;
use crate::patch::data::sites::Sites;
use crate::patch::distance::Candidate;
use crate::patch::level::Level;
use crate::patch::patch_match::{Band, Scratch, Sweep};

/// Patches that move at a time lie so many rows apart, and so many columns: no two of them want the same place for being
/// neighbours.
const ROWS: usize = 64;
/// See [`ROWS`].
const COLUMNS: usize = 8;
/// Patches that one thread goes through at a time.
const RUN: usize = 16;

/// What repetition costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Penalty {
    /// Cost of a patch whose pixels are covered as often as even use would cover them, in units of squared values at weight 1.
    pub weight: f32,
    /// A patch covers so many frames before and after its own.
    pub frames: usize,
}

/// The rule at work: the nearest patch, where often shown ones count as farther.
#[derive(Debug)]
pub struct Occurrence {
    penalty: Penalty,
    sweeps: usize,
    coverage: Option<Coverage>,
}

impl Occurrence {
    /// With so many sweeps a round.
    pub fn new(penalty: Penalty, sweeps: usize) -> Self {
        Self { penalty, sweeps, coverage: None }
    }
}

impl<P: Pose> Constraint<P> for Occurrence {
    fn search(&mut self, level: &Level<P>, nnf: &mut Nnf<P>, round: usize) {
        level.search().evaluate(nnf);
        let coverage = self.coverage.get_or_insert_with(|| Coverage::new(level, nnf, self.penalty));
        for number in 0..self.sweeps {
            let seed = rng::hash(level.seed, &[round as u64, number as u64]);
            coverage.sweep(level, nnf, Sweep { number: round * self.sweeps + number, reach: level.reach(), seed });
        }
    }

    fn energy(&self, level: &Level<P>, nnf: &Nnf<P>) -> f64 {
        let coverage = self.coverage.as_ref();
        coverage.map_or(0.0, |coverage| level.layout.to_energy(coverage.total(level, nnf) as f64 / 2.0))
    }
}

/// How often every pixel of the source is covered.
#[derive(Debug)]
struct Coverage {
    /// Patches over every pixel, in its frame and near it in time.
    counts: Vec<u32>,
    frames: usize,
    /// Price of one patch over one pixel of a patch, by segment, in 65536ths of the distance's whole numbers.
    prices: [u64; 2],
}

impl Coverage {
    fn new<P: Pose>(level: &Level<P>, nnf: &Nnf<P>, penalty: Penalty) -> Self {
        let pixels = level.layout.side().pow(2) as f64;
        let price = |segment: u8| {
            let (targets, sources) = (level.target.count_in(segment), level.source.count_in(segment));
            // Even use (ω* of the paper), patches over a pixel.
            let even = pixels * (2 * penalty.frames + 1) as f64 * targets as f64 / sources.max(1) as f64;
            let price = f64::from(level.layout.to_distance(f64::from(penalty.weight))) / (pixels * even.max(1e-9));
            (price * 65536.0).min(f64::from(u32::MAX)) as u64
        };
        let counts = vec![0; level.source.labels().len()];
        let mut coverage = Self { counts, frames: penalty.frames, prices: SEGMENTS.map(price) };
        for (site, cell) in nnf.assigned() {
            coverage.count(&level.source, &laid(level, site, cell), true);
        }
        coverage
    }

    /// Counts a patch in or out.
    fn count(&mut self, source: &Patches, laid: &Footprint, comes: bool) {
        for pixel in laid.pixels() {
            for at in source.through_time(pixel, self.frames) {
                self.counts[at] = if comes { self.counts[at] + 1 } else { self.counts[at] - 1 };
            }
        }
    }

    /// Price of a patch for what others cover; `own` is where the same site's patch lies now.
    fn price(&self, source: &Patches, segment: u8, laid: &Footprint, own: &Footprint) -> u32 {
        let covered: u64 = laid.pixels().map(|pixel| u64::from(self.counts[pixel])).sum();
        let mine = source.overlap(laid, own, self.frames);
        (((covered - mine) * self.prices[usize::from(segment) - 1]) >> 16).min(u64::from(u32::MAX / 4)) as u32
    }

    /// All prices.
    fn total<P: Pose>(&self, level: &Level<P>, nnf: &Nnf<P>) -> u64 {
        let price = |(site, cell): (usize, Cell<P>)| {
            let here = laid(level, site, cell);
            u64::from(self.price(&level.source, level.target.labels()[site], &here, &here))
        };
        nnf.assigned().map(price).sum()
    }

    fn sweep<P: Pose>(&mut self, level: &Level<P>, nnf: &mut Nnf<P>, sweep: Sweep) {
        let (width, height) = (nnf.width, nnf.cells.len() / nnf.width);
        let (rows, columns) = (height.clamp(1, ROWS), width.clamp(1, COLUMNS));
        for batch in 0..rows * columns {
            let batch = if sweep.backwards() { rows * columns - 1 - batch } else { batch };
            let across = |y: usize| (batch % columns..width).step_by(columns).map(move |x| y * width + x);
            let sites = (batch / columns..height).step_by(rows).flat_map(across);
            let sites: Vec<usize> = sites.filter(|&site| nnf.cells[site].place != Place::NONE).collect();
            let moved = par::map(sites.len().div_ceil(RUN), |k| {
                let run = &sites[k * RUN..sites.len().min((k + 1) * RUN)];
                self.run(level, nnf, run, sweep)
            });
            for (site, cell) in moved.into_iter().flatten() {
                self.count(&level.source, &laid(level, site, nnf.cells[site]), false);
                self.count(&level.source, &laid(level, site, cell), true);
                nnf.cells[site] = cell;
            }
        }
    }

    /// Which of some sites take what instead of what they have.
    fn run<P: Pose>(&self, level: &Level<P>, nnf: &Nnf<P>, sites: &[usize], sweep: Sweep) -> Vec<(usize, Cell<P>)> {
        let search = level.search();
        let (mut candidates, mut scratch) = (Vec::new(), Scratch::default());
        let mut moved = Vec::new();
        for &site in sites {
            let band = Band { search: &search, before: &nnf.cells, first: site };
            let own = laid(level, site, nnf.cells[site]);
            band.propagated(&nnf.cells[site..=site], 0, sweep.backwards(), &mut candidates, &mut scratch);
            let cell = self.best(level, (site, nnf.cells[site]), &own, &mut candidates, &mut scratch);
            band.random(cell, site, sweep, &mut candidates, &mut scratch);
            let cell = self.best(level, (site, cell), &own, &mut candidates, &mut scratch);
            if cell != nnf.cells[site] {
                moved.push((site, cell));
            }
        }
        moved
    }

    /// The candidate that costs least with its price, or what the site has.
    fn best<P: Pose>(
        &self,
        level: &Level<P>,
        (site, held): (usize, Cell<P>),
        own: &Footprint,
        candidates: &mut [Candidate<P>],
        scratch: &mut Scratch<P>,
    ) -> Cell<P> {
        let segment = level.target.labels()[site];
        let price = |cell: Cell<P>| self.price(&level.source, segment, &laid(level, site, cell), own);
        let prices: Vec<u32> = candidates
            .iter_mut()
            .map(|candidate| {
                let cell = Cell { place: Place(candidate.centre), distance: 0, pose: candidate.pose };
                let price = price(cell);
                candidate.base = candidate.base.saturating_add(price).min(u32::MAX / 2);
                price
            })
            .collect();
        let limit = held.distance.saturating_add(price(held));
        level.search().nearest(site, candidates, limit, scratch).map_or(held, |(n, distance)| Cell {
            place: Place(candidates[n].centre),
            distance: distance - prices[n],
            pose: candidates[n].pose,
        })
    }
}

/// What a site's patch covers of its frame.
fn laid<P: Pose>(level: &Level<P>, site: usize, cell: Cell<P>) -> Footprint {
    let matrix = cell.pose.matrix().after(level.target.frame(site));
    level.source.footprint(cell.place, matrix, level.layout.radius())
}
