//! Distances between patches: sums of weighted squared differences of bytes, in whole numbers.
//!
//! Written as loops over arrays of fixed length, which compile to multiply–add instructions on 16-bit lanes. Many candidates
//! are compared with one patch in a call, so that what is chosen at run time (the instruction set, the shape of the patch)
//! is chosen once, and each candidate is given up after its first two rows if those are already too far.

use macro_rules_attribute::apply;

use super::channels::{LANES, Layout, RowWeights, Stack};
use crate::base::instructions::kernel;

/// A patch that may be nearer than the best so far.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    /// Pixel number of its centre.
    pub centre: u32,
    /// What is added to its distance.
    pub base: u32,
    /// Step of the modulation at which it is compared.
    pub step: u8,
}

/// Compares patches of one image with those of another.
#[derive(Debug, Clone, Copy)]
pub(super) struct Comparison<'a> {
    pub layout: &'a Layout,
    /// Whose patch is compared.
    pub from: &'a Stack,
    /// Whose patches are the candidates.
    pub to: &'a Stack,
}

impl Comparison<'_> {
    /// The place in `candidates` of the patch nearest to the one around pixel `centre`, and its distance, if that is below
    /// `limit`; the first of equals.
    #[inline]
    pub fn nearest(&self, centre: u32, candidates: &[Candidate], limit: u32) -> Option<(usize, u32)> {
        (self.kernels().nearest)(&self.patch(centre), candidates, self.layout, limit)
    }

    /// The distances of all candidates, with what is added to them.
    pub fn distances(&self, centre: u32, candidates: &[Candidate], out: &mut Vec<u32>) {
        out.clear();
        (self.kernels().all)(&self.patch(centre), candidates, self.layout, out);
    }

    fn patch(&self, centre: u32) -> Patch<'_> {
        let radius = self.layout.radius();
        let corner = (centre as usize - radius * (self.from.width + 1)) * self.from.channels;
        Patch {
            from: &self.from.bytes()[corner..],
            from_stride: self.from.stride(),
            to: self.to.bytes(),
            to_stride: self.to.stride(),
            corner: radius * (self.to.width + 1),
            channels: self.to.channels,
        }
    }

    #[inline]
    fn kernels(&self) -> Kernels {
        let lanes = (self.layout.side() * self.layout.channels().len()).div_ceil(LANES);
        match (lanes, self.layout.radius()) {
            (1, 1) => Kernels::of::<1, 1>(),
            (1, 2) => Kernels::of::<1, 3>(),
            (1, 3) => Kernels::of::<1, 5>(),
            (1, _) => Kernels::of::<1, 7>(),
            (2, 1) => Kernels::of::<2, 1>(),
            (2, 2) => Kernels::of::<2, 3>(),
            (2, 3) => Kernels::of::<2, 5>(),
            (2, _) => Kernels::of::<2, 7>(),
            (3, 1) => Kernels::of::<3, 1>(),
            (3, 2) => Kernels::of::<3, 3>(),
            (3, 3) => Kernels::of::<3, 5>(),
            (3, _) => Kernels::of::<3, 7>(),
            (_, 1) => Kernels::of::<4, 1>(),
            (_, 2) => Kernels::of::<4, 3>(),
            (_, 3) => Kernels::of::<4, 5>(),
            (_, _) => Kernels::of::<4, 7>(),
        }
    }

    /// The distance of the patches around two pixels.
    pub fn distance(&self, from: u32, to: u32, step: u8) -> u32 {
        self.nearest(from, &[Candidate { centre: to, base: 0, step }], u32::MAX).map_or(u32::MAX, |found| found.1)
    }
}

/// One patch and where its candidates lie.
struct Patch<'a> {
    /// Begins at the patch's first byte.
    from: &'a [u8],
    from_stride: usize,
    to: &'a [u8],
    to_stride: usize,
    /// Pixels from the first pixel of a patch to its centre.
    corner: usize,
    channels: usize,
}

/// The nearest of many, see [`nearest`].
type Nearest = fn(&Patch, &[Candidate], &Layout, u32) -> Option<(usize, u32)>;

/// The comparisons of one shape of patches.
struct Kernels {
    nearest: Nearest,
    all: fn(&Patch, &[Candidate], &Layout, &mut Vec<u32>),
}

impl Kernels {
    #[inline]
    fn of<const K: usize, const TAIL: usize>() -> Self {
        Self { nearest: nearest::<K, TAIL>, all: all::<K, TAIL> }
    }
}

/// The distances of all candidates; the rows as in [`nearest`].
#[apply(kernel)]
fn all<const K: usize, const TAIL: usize>(
    patch: &Patch,
    candidates: &[Candidate],
    layout: &Layout,
    out: &mut Vec<u32>,
) {
    for candidate in candidates {
        let to = &patch.to[(candidate.centre as usize - patch.corner) * patch.channels..];
        let weights = layout.weights(candidate.step);
        let head = rows::<K, 2>(patch.from, patch.from_stride, to, patch.to_stride, weights);
        let (from, to) = (&patch.from[2 * patch.from_stride..], &to[2 * patch.to_stride..]);
        let tail = rows::<K, TAIL>(from, patch.from_stride, to, patch.to_stride, weights);
        out.push(candidate.base + head + tail);
    }
}

/// `K` runs of lanes a row; two rows, and if need be `TAIL` more.
#[apply(kernel)]
fn nearest<const K: usize, const TAIL: usize>(
    patch: &Patch,
    candidates: &[Candidate],
    layout: &Layout,
    limit: u32,
) -> Option<(usize, u32)> {
    let (mut best, mut found) = (limit, None);
    for (n, candidate) in candidates.iter().enumerate() {
        let to = &patch.to[(candidate.centre as usize - patch.corner) * patch.channels..];
        let weights = layout.weights(candidate.step);
        let mut sum = candidate.base + rows::<K, 2>(patch.from, patch.from_stride, to, patch.to_stride, weights);
        if sum < best {
            let (from, to) = (&patch.from[2 * patch.from_stride..], &to[2 * patch.to_stride..]);
            sum += rows::<K, TAIL>(from, patch.from_stride, to, patch.to_stride, weights);
            if sum < best {
                (best, found) = (sum, Some(n));
            }
        }
    }
    found.map(|n| (n, best))
}

/// The weighted squared differences of `R` rows of two patches.
#[inline(always)]
fn rows<const K: usize, const R: usize>(
    from: &[u8],
    from_stride: usize,
    to: &[u8],
    to_stride: usize,
    weights: &RowWeights,
) -> u32 {
    let mut differences = [[[0i16; LANES]; K]; R];
    let mut weighted = [[[0i16; LANES]; K]; R];
    let weights = &weights[..K * LANES];
    for j in 0..R {
        let (a, b) = (&from[j * from_stride..][..K * LANES], &to[j * to_stride..][..K * LANES]);
        for k in 0..K {
            for i in 0..LANES {
                let at = k * LANES + i;
                differences[j][k][i] = i16::from(a[at]) - i16::from(b[at]);
                weighted[j][k][i] = differences[j][k][i].wrapping_mul(weights[at]);
            }
        }
    }
    let pairs = differences.as_flattened().as_flattened().iter().zip(weighted.as_flattened().as_flattened());
    // Weights are bounded such that a whole patch stays far below the largest number of 32 bits.
    pairs.map(|(&d, &w)| i32::from(d) * i32::from(w)).sum::<i32>() as u32
}

#[cfg(test)]
mod tests {
    use super::super::channels::{Channel, MODULATION, Role};
    use super::*;
    use crate::base::rng::{below, hash};
    use crate::raster::image::Plane;
    use proptest::prelude::*;

    fn noise(width: usize, height: usize, channels: usize, seed: u64) -> Stack {
        let planes: Vec<Plane> = (0..channels as u64)
            .map(|c| {
                Plane::from_fn(width, height, |x, y| below(hash(seed, &[c, x as u64, y as u64]), 256) as f32 / 255.0)
            })
            .collect();
        Stack::from_planes(&planes)
    }

    /// Eq. 9 in double precision, with the weights as asked.
    fn brute_force(c: &Comparison, from: u32, to: u32, modulation: f64) -> f64 {
        let (radius, mut sum) = (c.layout.radius() as i64, 0.0);
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                let pixel = |stack: &Stack, centre: u32| {
                    let at = (i64::from(centre) + dy * stack.width as i64 + dx) as usize;
                    stack.pixel(at).to_vec()
                };
                let (a, b) = (pixel(c.from, from), pixel(c.to, to));
                for (i, channel) in c.layout.channels().iter().enumerate() {
                    let share = if channel.role == Role::Modulated { modulation } else { 1.0 };
                    sum += f64::from(channel.weight) * share * ((f64::from(a[i]) - f64::from(b[i])) / 255.0).powi(2);
                }
            }
        }
        sum
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn the_distance_is_that_of_the_paper(radius in 1usize..=4, count in 1usize..=14, step in 0..=MODULATION, seed in 0u64..1000) {
            let roles = [Role::Synthesised, Role::Guide, Role::Modulated];
            let channel = |i: usize| Channel::new("c", [1.0, 3.0, 0.6, 0.2][(i + seed as usize) % 4], roles[(i * 3 / count).min(2)]);
            let layout = Layout::new(radius, (0..count).map(channel).collect()).unwrap();
            let (from, to) = (noise(19, 15, count, seed), noise(23, 11, count, seed + 1));
            let comparison = Comparison { layout: &layout, from: &from, to: &to };
            for n in 0..8 {
                let centre = |s: &Stack, salt: u64| {
                    let along = |size: usize, k: u64| radius as u64 + below(hash(seed, &[n, salt, k]), (size - 2 * radius) as u64);
                    (along(s.height, 0) * s.width as u64 + along(s.width, 1)) as u32
                };
                let (a, b) = (centre(&from, 0), centre(&to, 1));
                let exact = brute_force(&comparison, a, b, f64::from(step) / f64::from(MODULATION));
                let ours = layout.to_energy(f64::from(comparison.distance(a, b, step)));
                // Half a whole number of weight for every squared difference.
                let slack = 0.5 / 64.0 * 3.0 * exact.max(1.0);
                prop_assert!((ours - exact).abs() <= slack, "{ours} instead of {exact}");
            }
        }
    }

    #[test]
    fn the_nearest_of_many_is_found_with_what_is_added_to_it() {
        let layout = Layout::new(2, vec![Channel::new("grey", 1.0, Role::Synthesised)]).unwrap();
        let image = noise(40, 30, 1, 5);
        let comparison = Comparison { layout: &layout, from: &image, to: &image };
        let here = 12 * 40 + 17;
        let candidate = |centre| Candidate { centre, base: 0, step: 0 };
        let all: Vec<Candidate> = (2..28).flat_map(|y| (2..38).map(move |x| candidate(y * 40 + x))).collect();
        let (found, distance) = comparison.nearest(here, &all, u32::MAX).unwrap();
        assert_eq!((all[found].centre, distance), (here, 0));
        assert!(comparison.nearest(here, &all, 0).is_none());
        let dear = [Candidate { base: 9, ..candidate(here) }];
        assert_eq!(comparison.nearest(here, &dear, 10), Some((0, 9)));
        assert_eq!(comparison.nearest(here, &dear, 9), None);
    }
}
