//! Distances between patches: sums of weighted squared differences of bytes, in whole numbers.
//!
//! Written as loops over arrays of fixed length, which compile to multiply–add instructions on 16-bit lanes. Many candidates
//! are compared with one patch in a call, so that what is chosen at run time (the instruction set, the shape of the patch)
//! is chosen once, and each candidate is given up after its first two rows if those are already too far.

use macro_rules_attribute::apply;

use super::data::channels::{LANES, Layout, MAX_SIDE, Stack};
use super::data::patches::{Patches, Place, gather};
use super::data::pose::{Matrix, Upright};
use crate::base::instructions::kernel;

/// A patch that may be nearer than the best so far.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate<P = Upright> {
    /// Pixel number of its centre.
    pub centre: u32,
    /// What is added to its distance.
    pub base: u32,
    /// Step of the modulation at which it is compared.
    pub step: u8,
    /// How it is laid on the site.
    pub pose: P,
}

/// The patch that candidates are compared with: from its first byte on, and the bytes from row to row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows<'a> {
    pub bytes: &'a [u8],
    pub stride: usize,
}

/// The nearest of the candidates, as they lie in `to`: its number and its distance, if that is below `limit`; the first of
/// equals.
#[inline]
pub(super) fn nearest_in_place<P: Copy>(
    layout: &Layout,
    from: Rows,
    to: &Stack,
    candidates: &[Candidate<P>],
    limit: u32,
) -> Option<(usize, u32)> {
    (Kernels::of_layout(layout).nearest)(&Patch::new(layout, from, to), candidates, layout, limit)
}

/// The distances of all candidates as they lie in `to`, with what is added to them.
pub(super) fn distances_in_place<P: Copy>(
    layout: &Layout,
    from: Rows,
    to: &Stack,
    candidates: &[Candidate<P>],
    out: &mut Vec<u32>,
) {
    (Kernels::of_layout(layout).all)(&Patch::new(layout, from, to), candidates, layout, out);
}

/// The distance of one candidate that is sampled through a matrix, if it is below `limit`; `buffer` is used again and again.
pub(super) fn gathered_below<P: Copy>(
    layout: &Layout,
    from: Rows,
    to: &Patches,
    (candidate, matrix): (Candidate<P>, Matrix),
    limit: u32,
    buffer: &mut Vec<u8>,
) -> Option<u32> {
    let row = layout.row();
    buffer.resize(layout.side() * row, 0);
    gather(to, Place(candidate.centre), matrix, (layout.radius(), row), buffer);
    let patch =
        Patch { from: from.bytes, from_stride: from.stride, to: buffer, to_stride: row, corner: 0, channels: 0 };
    let nearest = Kernels::of_layout(layout).nearest;
    nearest(&patch, &[Candidate { centre: 0, ..candidate }], layout, limit).map(|found| found.1)
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

impl<'a> Patch<'a> {
    fn new(layout: &Layout, from: Rows<'a>, to: &'a Stack) -> Self {
        Self {
            from: from.bytes,
            from_stride: from.stride,
            to: to.bytes(),
            to_stride: to.stride(),
            corner: layout.radius() * (to.width + 1),
            channels: to.channels,
        }
    }
}

/// The nearest of many, see [`nearest`].
type Nearest<P> = fn(&Patch, &[Candidate<P>], &Layout, u32) -> Option<(usize, u32)>;

/// The comparisons of one shape of patches.
struct Kernels<P> {
    nearest: Nearest<P>,
    all: fn(&Patch, &[Candidate<P>], &Layout, &mut Vec<u32>),
}

impl<P: Copy> Kernels<P> {
    #[inline]
    fn of<const K: usize, const TAIL: usize>() -> Self {
        Self { nearest: nearest::<P, K, TAIL>, all: all::<P, K, TAIL> }
    }

    #[inline]
    fn of_layout(layout: &Layout) -> Self {
        match (layout.row() / LANES, layout.radius()) {
            (1, 1) => Self::of::<1, 1>(),
            (1, 2) => Self::of::<1, 3>(),
            (1, 3) => Self::of::<1, 5>(),
            (2, 1) => Self::of::<2, 1>(),
            (2, 2) => Self::of::<2, 3>(),
            (3, 2) => Self::of::<3, 3>(),
            (4, 2) => Self::of::<4, 3>(),
            _ => Self { nearest: nearest_of_any, all: all_of_any },
        }
    }
}

/// The distances of all candidates; the rows as in [`nearest`].
#[apply(kernel)]
fn all<P: Copy, const K: usize, const TAIL: usize>(
    patch: &Patch,
    candidates: &[Candidate<P>],
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
fn nearest<P: Copy, const K: usize, const TAIL: usize>(
    patch: &Patch,
    candidates: &[Candidate<P>],
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

/// As [`all`], for patches of any shape.
#[apply(kernel)]
fn all_of_any<P: Copy>(patch: &Patch, candidates: &[Candidate<P>], layout: &Layout, out: &mut Vec<u32>) {
    for candidate in candidates {
        out.push(candidate.base + whole(patch, candidate.centre, layout.weights(candidate.step), layout.side()));
    }
}

/// As [`nearest`], for patches of any shape.
#[apply(kernel)]
fn nearest_of_any<P: Copy>(
    patch: &Patch,
    candidates: &[Candidate<P>],
    layout: &Layout,
    limit: u32,
) -> Option<(usize, u32)> {
    let (mut best, mut found) = (limit, None);
    for (n, candidate) in candidates.iter().enumerate() {
        if candidate.base < best {
            let weights = layout.weights(candidate.step);
            let sum = candidate.base + whole(patch, candidate.centre, weights, layout.side());
            if sum < best {
                (best, found) = (sum, Some(n));
            }
        }
    }
    found.map(|n| (n, best))
}

/// The weighted squared differences of all rows of two patches.
#[inline(always)]
fn whole(patch: &Patch, centre: u32, weights: &[i16], side: usize) -> u32 {
    let to = &patch.to[(centre as usize - patch.corner) * patch.channels..];
    let mut sum = 0;
    for j in 0..side.min(MAX_SIDE) {
        let (from, to) = (&patch.from[j * patch.from_stride..], &to[j * patch.to_stride..]);
        let lanes = from.chunks_exact(LANES).zip(to.chunks_exact(LANES)).zip(weights.chunks_exact(LANES));
        sum += lanes.map(|((a, b), w)| rows::<1, 1>(a, 0, b, 0, w)).sum::<u32>();
    }
    sum
}

/// The weighted squared differences of `R` rows of two patches.
#[inline(always)]
fn rows<const K: usize, const R: usize>(
    from: &[u8],
    from_stride: usize,
    to: &[u8],
    to_stride: usize,
    weights: &[i16],
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
    use super::super::data::channels::{Channel, MODULATION, Role};
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

    /// Two images, and how their patches are compared.
    struct Comparison<'a> {
        layout: &'a Layout,
        from: &'a Stack,
        to: &'a Stack,
    }

    impl Comparison<'_> {
        fn rows(&self, centre: u32) -> Rows<'_> {
            let corner = (centre as usize - self.layout.radius() * (self.from.width + 1)) * self.from.channels;
            Rows { bytes: &self.from.bytes()[corner..], stride: self.from.stride() }
        }

        fn nearest(&self, centre: u32, candidates: &[Candidate], limit: u32) -> Option<(usize, u32)> {
            nearest_in_place(self.layout, self.rows(centre), self.to, candidates, limit)
        }

        fn distance(&self, from: u32, to: u32, step: u8) -> u32 {
            let candidate = Candidate { centre: to, base: 0, step, pose: Upright };
            let found = self.nearest(from, &[candidate], u32::MAX).unwrap().1;
            let mut all = Vec::new();
            distances_in_place(self.layout, self.rows(from), self.to, &[candidate], &mut all);
            assert_eq!(all, [found]);
            found
        }
    }

    /// Eq. 9 in double precision, with the weights as asked; and with weights of 1.
    fn brute_force(c: &Comparison, from: u32, to: u32, modulation: f64) -> (f64, f64) {
        let (radius, mut sum, mut plain) = (c.layout.radius() as i64, 0.0, 0.0);
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                let pixel = |stack: &Stack, centre: u32| {
                    let at = (i64::from(centre) + dy * stack.width as i64 + dx) as usize;
                    stack.pixel(at).to_vec()
                };
                let (a, b) = (pixel(c.from, from), pixel(c.to, to));
                for (i, channel) in c.layout.channels().iter().enumerate() {
                    let share = if channel.role == Role::Modulated { modulation } else { 1.0 };
                    let squared = ((f64::from(a[i]) - f64::from(b[i])) / 255.0).powi(2);
                    sum += f64::from(channel.weight) * share * squared;
                    plain += squared;
                }
            }
        }
        (sum, plain)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn the_distance_is_that_of_the_paper(radius in 1usize..=4, count in 1usize..=44, step in 0..=MODULATION, seed in 0u64..1000) {
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
                let (exact, plain) = brute_force(&comparison, a, b, f64::from(step) / f64::from(MODULATION));
                let ours = layout.to_energy(f64::from(comparison.distance(a, b, step)));
                // Half a whole number of weight for every squared difference.
                let slack = 0.51 * layout.to_energy(65025.0) * plain;
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
        let candidate = |centre| Candidate { centre, base: 0, step: 0, pose: Upright };
        let all: Vec<Candidate> = (2..28).flat_map(|y| (2..38).map(move |x| candidate(y * 40 + x))).collect();
        let (found, distance) = comparison.nearest(here, &all, u32::MAX).unwrap();
        assert_eq!((all[found].centre, distance), (here, 0));
        assert!(comparison.nearest(here, &all, 0).is_none());
        let dear = [Candidate { base: 9, ..candidate(here) }];
        assert_eq!(comparison.nearest(here, &dear, 10), Some((0, 9)));
        assert_eq!(comparison.nearest(here, &dear, 9), None);
    }
}
