//! Near-duplicate frames, measured on decoded pixels.

use crate::raster::image::Rgb8;

/// Side of the blocks that are compared, in pixels of the working size.
const BLOCK: usize = 16;

/// Smallest and largest threshold on the difference of the most different block, in code values of 255: below the
/// first nothing is visible, above the second it is more than coding noise.
const THRESHOLD: std::ops::RangeInclusive<f32> = 0.25..=2.0;

/// Part of the clip's typical difference below which a frame counts as the same as the one before.
const SHARE: f32 = 0.1;

/// A frame is also a duplicate when its difference is a *dip*: below this share of the differences on either side.
/// Duplicates coded anew carry noise that no fixed threshold tells from slow motion, but motion does not stop for one
/// frame.
const DIP: f32 = 0.22;
/// Frames that must be known after a frame to tell a dip: two duplicates in a row still end in a full difference.
pub const AHEAD: usize = 2;

/// Whether `here` is a dip between the difference of the frame kept last and those of the next [`AHEAD`] frames; the
/// clip's last frame has none after it.
pub fn is_dip(here: f32, before: f32, after: impl Iterator<Item = f32>) -> bool {
    here < DIP * before.min(after.take(AHEAD).reduce(f32::max).unwrap_or(before))
}

/// Luma of an image, 8 bits.
pub fn luma(image: &Rgb8) -> Vec<u8> {
    let weigh = |p: &[u8]| ((54 * u16::from(p[0]) + 183 * u16::from(p[1]) + 19 * u16::from(p[2]) + 128) >> 8) as u8;
    image.data.chunks_exact(3).map(weigh).collect()
}

/// Mean absolute difference of the 16 × 16 block where `a` and `b` (rows of `width`) differ most. The largest block
/// counts, not the whole frame, so that a small flame in front of a still wall is motion.
pub fn difference(a: &[u8], b: &[u8], width: usize) -> f32 {
    let mut sums = vec![0u32; width.div_ceil(BLOCK)];
    let mut most = 0.0f32;
    for (a, b) in a.chunks(width * BLOCK).zip(b.chunks(width * BLOCK)) {
        sums.fill(0);
        let rows = a.len() / width;
        for (a, b) in a.chunks_exact(width).zip(b.chunks_exact(width)) {
            for ((sum, a), b) in sums.iter_mut().zip(a.chunks(BLOCK)).zip(b.chunks(BLOCK)) {
                *sum += a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>();
            }
        }
        for (i, &sum) in sums.iter().enumerate() {
            let columns = BLOCK.min(width - i * BLOCK);
            most = most.max(sum as f32 / (rows * columns) as f32);
        }
    }
    most
}

/// The threshold for a clip whose consecutive frames differ by `differences` (a sample of them). The typical
/// difference is the 90th percentile, which also holds when most frames are duplicates.
pub fn threshold(mut differences: Vec<f32>) -> f32 {
    differences.sort_by(f32::total_cmp);
    let typical = differences.get(differences.len() * 9 / 10).copied().unwrap_or(0.0);
    (SHARE * typical).clamp(*THRESHOLD.start(), *THRESHOLD.end())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_small_moving_spot_is_a_difference() {
        let a = vec![50u8; 100 * 40];
        let mut b = a.clone();
        (0..8).for_each(|i| b[20 * 100 + 40 + i] = 200);
        assert!(difference(&a, &b, 100) > 4.0);
        assert_eq!(difference(&a, &a, 100), 0.0);
    }

    #[test]
    fn dips_are_told_from_calm() {
        let dip = |here, before, after: [f32; 2]| is_dip(here, before, after.into_iter());
        assert!(dip(3.0, 24.0, [22.0, 25.0]));
        assert!(dip(3.0, 24.0, [1.0, 25.0]));
        assert!(!dip(3.0, 24.0, [3.1, 2.9]));
        assert!(!dip(3.0, 3.0, [24.0, 24.0]));
        assert!(is_dip(0.5, 9.0, std::iter::empty()));
    }

    #[test]
    fn thresholds_follow_the_clip_within_limits() {
        assert_eq!(threshold(vec![]), 0.25);
        assert_eq!(threshold(vec![10.0; 50]), 1.0);
        assert_eq!(threshold([vec![0.1; 40], vec![12.0; 10]].concat()), 1.2);
        assert_eq!(threshold(vec![90.0; 50]), 2.0);
    }
}
