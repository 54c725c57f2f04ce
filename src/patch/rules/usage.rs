//! How often source patches are used, and how often they may be (LazyFluids, Eq. 5).

use super::leftovers;
use crate::patch::data::field::{Cell, Nnf};
use crate::patch::data::patches::Place;
use crate::patch::data::segments::SEGMENTS;
use crate::patch::level::Level;

/// How often every source patch of a segment is to be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Bounds {
    /// Every patch at least so often: K of Eq. 5.
    pub least: u32,
    /// No patch more often.
    pub most: u32,
    /// Uses beyond `least`, all patches together: R of §4.1.
    pub beyond: u64,
}

impl Bounds {
    /// δ − K ∈ {0, 1} with K = ⌊|X| / |Z|⌋ and R = |X| mod |Z| (Eq. 5). More source than target patches: K = 0, each is used
    /// once or not at all. Without source patches nothing can be used.
    pub fn uniform(targets: usize, sources: usize) -> Self {
        if sources == 0 {
            return Self { least: 0, most: 0, beyond: 0 };
        }
        let (least, rest) = ((targets / sources) as u32, targets % sources);
        Self { least, most: least + u32::from(rest > 0), beyond: rest as u64 }
    }

    /// At most twice the uniform level, rounded up (the occurrence map of Kaspar et al. 2015).
    pub fn occurrence(targets: usize, sources: usize) -> Self {
        let most = (2 * targets).div_ceil(sources.max(1)) as u32;
        Self { least: 0, most, beyond: targets as u64 }
    }
}

/// The bounds of each segment, by its size in the target and in the source.
pub(super) type BoundsOf = fn(usize, usize) -> Bounds;

/// A field whose places keep to bounds, with the count of every place.
#[derive(Debug)]
pub(super) struct Usage {
    /// Bounds by segment, in the order of [`SEGMENTS`].
    bounds: [Bounds; 2],
    /// Uses of every pixel of the source.
    counts: Vec<u32>,
}

impl Usage {
    /// Makes `nnf` keep to the bounds: each place keeps its nearest patches, and what is let go is spread over the places
    /// that lack some. Distances of what changed are computed; the others must be known.
    pub fn enforce(level: &Level, nnf: &mut Nnf, of: BoundsOf) -> Self {
        let sizes = |s| (level.target.count_in(s), level.source.count_in(s));
        let bounds = SEGMENTS.map(|s| of(sizes(s).0, sizes(s).1));
        let mut usage = Self { bounds, counts: vec![0; level.source.labels().len()] };
        for segment in SEGMENTS {
            let free = usage.let_go(level, nnf, segment);
            let slots = usage.slots(level, segment, free.len());
            for (target, place) in leftovers::matched(level, free, slots) {
                usage.counts[place.index()] += 1;
                let distance = level.search().distance(target as usize, Cell::new(place, 0));
                nnf.cells[target as usize] = Cell::new(place, distance);
            }
        }
        usage
    }

    /// Counts the nearest patches of each place as far as the bounds allow, and takes the place of all others, which are
    /// returned in order.
    fn let_go(&mut self, level: &Level, nnf: &mut Nnf, segment: u8) -> Vec<u32> {
        let bounds = self.bounds(segment);
        let targets: Vec<u32> = level.target.centres(segment).collect();
        let mut order: Vec<(u32, u32)> = targets.iter().map(|&t| (nnf.cells[t as usize].distance, t)).collect();
        order.sort_unstable();
        let mut beyond = bounds.beyond;
        for (_, t) in order {
            let cell = &mut nnf.cells[t as usize];
            let count = self.counts.get(cell.place.index()).copied();
            let within = count.is_some_and(|n| n < bounds.least);
            let extra = !within && count.is_some_and(|n| n < bounds.most) && beyond > 0;
            if within || extra {
                beyond -= u64::from(extra);
                self.counts[cell.place.index()] += 1;
            } else {
                *cell = Cell::NONE;
            }
        }
        targets.into_iter().filter(|&t| nnf.cells[t as usize].place == Place::NONE).collect()
    }

    /// `count` places of a segment that may be used once more each: all that the least use asks for, the rest spread evenly.
    fn slots(&self, level: &Level, segment: u8, count: usize) -> Vec<Place> {
        let bounds = self.bounds(segment);
        let centres: Vec<u32> = level.source.centres(segment).collect();
        let repeat = |c: &u32, n: u32| std::iter::repeat_n(Place(*c), n as usize);
        let used = |c: &u32| self.counts[*c as usize];
        let mut slots: Vec<Place> =
            centres.iter().flat_map(|c| repeat(c, bounds.least.saturating_sub(used(c)))).collect();
        let spare: Vec<Place> =
            centres.iter().flat_map(|c| repeat(c, bounds.most - used(c).max(bounds.least))).collect();
        let more = count.saturating_sub(slots.len()).min(spare.len());
        slots.extend((0..more).map(|i| spare[i * spare.len() / more]));
        slots
    }

    fn bounds(&self, segment: u8) -> Bounds {
        self.bounds[usize::from(segment) - 1]
    }

    /// Whether a place may be used once more, if another of its segment is used once less.
    pub fn has_room(&self, place: Place, segment: u8) -> bool {
        self.counts[place.index()] < self.bounds(segment).most
    }

    /// Whether a place may be used once less.
    pub fn can_spare(&self, place: Place, segment: u8) -> bool {
        self.counts[place.index()] > self.bounds(segment).least
    }

    /// Counts a patch that goes from one place to another.
    pub fn moved(&mut self, from: Place, to: Place) {
        self.counts[from.index()] -= 1;
        self.counts[to.index()] += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::super::Rule;
    use super::*;
    use crate::base::rng::{below, hash, unit};
    use crate::patch::data::channels::{Layout, Stack};
    use crate::patch::data::patches::Patches;
    use crate::patch::data::segments::{BOUNDARY, INTERIOR, Thresholds, labels};
    use crate::patch::terms::Pass;
    use crate::patch::testing::{assignment, grey_layout, grey_patches, texture};
    use crate::patch::vote::Manner;
    use crate::raster::image::Plane;
    use proptest::prelude::*;

    fn level<'a>(layout: &'a Layout, source: &'a Patches, target: Patches) -> Level<'a> {
        Level {
            layout,
            source: std::borrow::Cow::Borrowed(source),
            colours: source.stack.first(layout.synthesised()),
            target,
            swapped: None,
            fixed: None,
            steps: None,
            anchor: None,
            coarsest: true,
            seed: 3,
            terms: None,
            pass: Pass::default(),
            manner: Manner::Mean,
        }
    }

    fn source(plane: Plane, blurred: Option<Plane>, radius: usize) -> Patches {
        let labels = labels((plane.width, plane.height), radius, blurred.as_ref(), Thresholds::default());
        Patches::new(Stack::from_planes(&[plane]), labels)
    }

    fn all(patches: &Patches, segment: u8) -> Vec<u32> {
        patches.centres(segment).collect()
    }

    /// The field after `rounds` without voting.
    fn searched(level: &Level, rule: Rule, rounds: usize) -> Nnf {
        let mut nnf = Nnf::random(&level.target, &level.source, 5);
        let mut rule = rule.constraint(4);
        (0..rounds).for_each(|round| rule.search(level, &mut nnf, round));
        nnf
    }

    fn assert_uniform(level: &Level, nnf: &Nnf) {
        let usage = nnf.usage(&level.source);
        for segment in SEGMENTS {
            let (targets, sources) = (all(&level.target, segment), all(&level.source, segment));
            if targets.is_empty() || sources.is_empty() {
                assert!(targets.iter().all(|&t| nnf.cells[t as usize].place == Place::NONE));
                assert!(sources.iter().all(|&s| usage[s as usize] == 0));
                continue;
            }
            let least = (targets.len() / sources.len()) as u32;
            assert!(sources.iter().all(|&s| usage[s as usize] == least || usage[s as usize] == least + 1));
            assert_eq!(sources.iter().map(|&s| usage[s as usize] as usize).sum::<usize>(), targets.len());
        }
        for (i, cell) in nnf.assigned() {
            assert_eq!(level.target.labels()[i], level.source.labels()[cell.place.index()]);
            assert_eq!(cell.distance, level.search().distance(i, cell));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn usage_is_exact_for_any_sizes(
            tw in 3usize..34, th in 3usize..34, sw in 3usize..26, sh in 3usize..26, shape in 0u64..1000, sweeps in 0usize..3,
        ) {
            // Alpha in blobs, from nearly nothing to nearly everything.
            let alpha = |w: usize, h: usize, salt: u64| {
                let (level, size) = (unit(hash(shape, &[salt])) * 1.6 - 0.3, 2 + below(hash(shape, &[salt, 1]), 6) as usize);
                let blob = |x: usize, y: usize| unit(hash(shape, &[salt, 2, (x / size) as u64, (y / size) as u64])) * 0.6 + level;
                (!shape.is_multiple_of(4)).then(|| Plane::from_fn(w, h, |x, y| blob(x, y).clamp(0.0, 1.0)))
            };
            let layout = grey_layout(1);
            let source = source(texture(sw, sh, 0.0), alpha(sw, sh, 8), 1);
            let labels = labels((tw, th), 1, alpha(tw, th, 9).as_ref(), Thresholds::default());
            let target = Patches::new(Stack::from_planes(&[texture(tw, th, 17.0)]), labels);
            let level = level(&layout, &source, target);
            let mut nnf = Nnf::random(&level.target, &level.source, shape);
            let mut rule = Rule::Uniform.constraint(sweeps);
            rule.search(&level, &mut nnf, 0);
            assert_uniform(&level, &nnf);
            rule.search(&level, &mut nnf, 1);
            assert_uniform(&level, &nnf);
            let capped = searched(&level, Rule::Occurrence, 1);
            for segment in SEGMENTS {
                let most = Bounds::occurrence(level.target.count_in(segment), level.source.count_in(segment)).most;
                let usage = capped.usage(&source);
                prop_assert!(all(&source, segment).iter().all(|&s| usage[s as usize] <= most));
            }
        }
    }

    #[test]
    fn without_a_remainder_every_patch_is_used_equally_often() {
        let layout = grey_layout(1);
        let source = source(texture(12, 12, 0.0), None, 1);
        let level = level(&layout, &source, grey_patches(&texture(22, 22, 40.0), 1));
        let usage = searched(&level, Rule::Uniform, 3).usage(&source);
        assert!(all(&source, INTERIOR).iter().all(|&s| usage[s as usize] == 4));
        assert!(all(&source, BOUNDARY).is_empty());
    }

    /// The least total distance under the constraint: `δ − K ∈ {0, 1}` as an assignment of patches, and of nobodies to what
    /// is left of the R places beyond K.
    fn optimum(level: &Level) -> f64 {
        let (targets, sources) = (all(&level.target, INTERIOR), all(&level.source, INTERIOR));
        let bounds = Bounds::uniform(targets.len(), sources.len());
        let slots: Vec<(u32, bool)> =
            sources.iter().flat_map(|&s| (0..=bounds.least).map(move |k| (s, k == bounds.least))).collect();
        let cost = |row: usize, column: usize| match (targets.get(row), slots[column]) {
            (Some(&t), (s, _)) => f64::from(level.search().distance(t as usize, Cell::new(Place(s), 0))),
            (None, (_, true)) => 0.0,
            (None, (_, false)) => 1e15,
        };
        assignment(slots.len(), cost)
    }

    #[test]
    fn the_uniform_field_is_nearly_the_best_there_is() {
        let layout = grey_layout(2);
        // K = 2 with a remainder, nearly one to one, and K = 0.
        for (target, exemplar) in [((24, 22), (16, 15)), ((20, 18), (20, 19)), ((18, 18), (26, 24))] {
            let source = source(texture(exemplar.0, exemplar.1, 0.0), None, 2);
            let level = level(&layout, &source, grey_patches(&texture(target.0, target.1, 50.0), 2));
            let best = optimum(&level);
            let ours = searched(&level, Rule::Uniform, 20).total() as f64;
            let mut by_chance = Nnf::random(&level.target, &source, 1);
            level.search().evaluate(&mut by_chance);
            assert!(ours >= best * 0.999 && ours <= best * 1.2, "{}", ours / best);
            assert!(by_chance.total() as f64 > 3.0 * ours);
        }
    }

    #[test]
    fn the_energy_never_rises_and_threads_do_not_change_it() {
        let layout = grey_layout(2);
        let source = source(texture(40, 33, 0.0), None, 2);
        let level = level(&layout, &source, grey_patches(&texture(70, 60, 50.0), 2));
        let run = |threads| {
            let totals = || {
                let mut nnf = Nnf::random(&level.target, &source, 5);
                let mut rule = Rule::Uniform.constraint(1);
                let total = |round| {
                    rule.search(&level, &mut nnf, round);
                    nnf.total()
                };
                ((0..12).map(total).collect::<Vec<_>>(), nnf)
            };
            crate::base::par::with_threads(threads, totals).unwrap()
        };
        let one = run(1);
        assert!(one.0.windows(2).all(|t| t[1] <= t[0]), "{:?}", one.0);
        assert!(one == run(2) && one == run(3));
    }
}
