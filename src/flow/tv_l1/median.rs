//! Median filters of the motion between warps (Wedel et al. 2009), as networks of minima and maxima.

use multiversion::multiversion;

use super::iterate::{Channel, State};

/// Scratch rows of a median filter.
#[derive(Debug, Clone, Default)]
pub(super) struct Median {
    padded: Vec<f32>,
}

impl Median {
    /// Replaces both components of the motion by their medians over windows of side `2 radius + 1` (radius 1 or 2; 0
    /// does nothing), borders repeated.
    pub fn apply(&mut self, state: &mut State, radius: usize) {
        for channel in [Channel::U, Channel::V] {
            match radius {
                0 => {}
                1 => filter3(state, channel, &mut self.padded),
                _ => filter5(state, channel, &mut self.padded),
            }
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn filter3(state: &mut State, channel: Channel, padded: &mut Vec<f32>) {
    filter::<1, 9>(state, channel, padded);
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn filter5(state: &mut State, channel: Channel, padded: &mut Vec<f32>) {
    filter::<2, 25>(state, channel, padded);
}

/// Median over windows of `N = (2R + 1)²`.
#[inline(always)]
fn filter<const R: usize, const N: usize>(state: &mut State, channel: Channel, padded: &mut Vec<f32>) {
    let (width, height) = (state.width, state.height);
    let stride = width + 2 * R;
    padded.clear();
    for y in 0..height + 2 * R {
        let row = state.row(channel, y.saturating_sub(R).min(height - 1));
        padded.extend_from_slice(&[row[0]; R]);
        padded.extend_from_slice(row);
        padded.extend_from_slice(&[row[width - 1]; R]);
    }
    for y in 0..height {
        let rows = &padded[y * stride..][..(2 * R + 1) * stride];
        let windows: [&[f32]; N] =
            std::array::from_fn(|i| &rows[i / (2 * R + 1) * stride + i % (2 * R + 1)..][..width]);
        let out = &mut state.row_mut(y)[channel as usize][..width];
        for x in 0..width {
            out[x] = median::<N>(std::array::from_fn(|i| windows[i][x]));
        }
    }
}

/// Median of an odd number of values by forgetful selection: the extremes of a bit more than half of the values cannot
/// be the median; forget them, take in the next value, repeat until three are left.
#[inline(always)]
fn median<const N: usize>(mut values: [f32; N]) -> f32 {
    let start = N / 2 + 2;
    for count in (4..=start).rev() {
        extremes_to_ends(&mut values, count);
        values[0] = values[start + (start - count)];
    }
    extremes_to_ends(&mut values, 3);
    values[1]
}

/// Moves the least of the first `count` values to the front and the largest to the back.
#[inline(always)]
fn extremes_to_ends<const N: usize>(values: &mut [f32; N], count: usize) {
    let half = count / 2;
    for i in 0..half {
        sort(values, i, count - 1 - i);
    }
    let low = count.div_ceil(2);
    for i in 1..low {
        sort(values, 0, i);
    }
    for i in half..count - 1 {
        sort(values, i, count - 1);
    }
}

#[inline(always)]
fn sort<const N: usize>(values: &mut [f32; N], i: usize, j: usize) {
    let (a, b) = (values[i], values[j]);
    values[i] = a.min(b);
    values[j] = a.max(b);
}
