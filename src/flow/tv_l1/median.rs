//! Median filters of the motion between warps (Wedel et al. 2009), as networks of minima and maxima.
//!
//! The columns of all windows are sorted once per row and shared by the windows they belong to.

use macro_rules_attribute::apply;

use super::iterate::{Channel, State};
use crate::base::instructions::kernel;

/// Scratch rows of the median filters.
#[derive(Debug, Clone, Default)]
pub(super) struct Median {
    /// The component with its borders repeated outwards.
    padded: Vec<f32>,
    /// Sorted columns of one row of windows, least first.
    sorted: Vec<f32>,
}

impl Median {
    /// Replaces both components of the motion by their medians over windows of side `2 radius + 1` (radius 1 or 2; 0
    /// does nothing), borders repeated.
    pub fn apply(&mut self, state: &mut State, radius: usize) {
        if radius == 0 {
            return;
        }
        let (side, stride) = (2 * radius + 1, state.width + 2 * radius);
        self.sorted.clear();
        self.sorted.resize(side * stride, 0.0);
        for channel in [Channel::U, Channel::V] {
            self.pad(state, channel, radius);
            for y in 0..state.height {
                let rows = &self.padded[y * stride..][..side * stride];
                let out = &mut state.row_mut(y)[channel as usize];
                match radius {
                    1 => {
                        sort_columns3(rows, &mut self.sorted);
                        medians3(&self.sorted, out);
                    }
                    _ => {
                        sort_columns5(rows, &mut self.sorted);
                        medians5(&self.sorted, out);
                    }
                }
            }
        }
    }

    fn pad(&mut self, state: &State, channel: Channel, radius: usize) {
        self.padded.clear();
        for y in 0..state.height + 2 * radius {
            let row = state.row(channel, y.saturating_sub(radius).min(state.height - 1));
            self.padded.extend(std::iter::repeat_n(row[0], radius));
            self.padded.extend_from_slice(row);
            self.padded.extend(std::iter::repeat_n(row[row.len() - 1], radius));
        }
    }
}

#[apply(kernel)]
fn sort_columns3(rows: &[f32], sorted: &mut [f32]) {
    sort_columns::<3>(rows, sorted);
}

#[apply(kernel)]
fn sort_columns5(rows: &[f32], sorted: &mut [f32]) {
    sort_columns::<5>(rows, sorted);
}

/// Sorts the columns of `N` rows; `sorted` holds the least values, then the second least …
#[inline(always)]
fn sort_columns<const N: usize>(rows: &[f32], sorted: &mut [f32]) {
    let n = rows.len() / N;
    let rows: [&[f32]; N] = std::array::from_fn(|i| &rows[i * n..(i + 1) * n]);
    let mut chunks = sorted.chunks_exact_mut(n);
    let sorted: [&mut [f32]; N] = std::array::from_fn(|_| chunks.next().expect("N rows of the same length"));
    for x in 0..n {
        let values = sort::<N>(std::array::from_fn(|i| rows[i][x]));
        for i in 0..N {
            sorted[i][x] = values[i];
        }
    }
}

/// Median of 3 × 3 from sorted columns: the middle one of the largest minimum, the median median, the least maximum.
#[apply(kernel)]
fn medians3(sorted: &[f32], out: &mut [f32]) {
    let (n, width) = (sorted.len() / 3, out.len());
    let at: [[&[f32]; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| &sorted[i * n + j..][..width]));
    for x in 0..width {
        let [low, middle, high]: [[f32; 3]; 3] = std::array::from_fn(|i| sort(std::array::from_fn(|j| at[i][j][x])));
        out[x] = sort([low[2], middle[1], high[0]])[1];
    }
}

/// Median of 5 × 5 from sorted columns. With the rows sorted as well, twelve values are known to lie below or above
/// the median, six on either side; the median of the other thirteen is the median of all.
#[apply(kernel)]
fn medians5(sorted: &[f32], out: &mut [f32]) {
    let (n, width) = (sorted.len() / 5, out.len());
    let at: [[&[f32]; 5]; 5] = std::array::from_fn(|i| std::array::from_fn(|j| &sorted[i * n + j..][..width]));
    for x in 0..width {
        let [a, b, c, d, e]: [[f32; 5]; 5] = std::array::from_fn(|i| sort(std::array::from_fn(|j| at[i][j][x])));
        let left = [a[3], a[4], b[2], b[3], b[4], c[1], c[2], c[3], d[0], d[1], d[2], e[0], e[1]];
        out[x] = median13(left);
    }
}

/// Median of thirteen by forgetful selection: of eight values the extremes cannot be the median of thirteen; forget
/// them, take in the next value, repeat until three are left.
#[inline(always)]
fn median13(v: [f32; 13]) -> f32 {
    let [_, b, c, d, e, f, g, _] = extremes([v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7]]);
    let [_, b, c, d, e, f, _] = extremes([b, c, d, e, f, g, v[8]]);
    let [_, b, c, d, e, _] = extremes([b, c, d, e, f, v[9]]);
    let [_, b, c, d, _] = extremes([b, c, d, e, v[10]]);
    let [_, b, c, _] = extremes([b, c, d, v[11]]);
    sort([b, c, v[12]])[1]
}

/// Moves the least value to the front and the largest to the back.
#[inline(always)]
fn extremes<const N: usize>(mut v: [f32; N]) -> [f32; N] {
    for i in 0..N / 2 {
        exchange(&mut v, i, N - 1 - i);
    }
    for i in 1..N.div_ceil(2) {
        exchange(&mut v, 0, i);
    }
    for i in N / 2..N - 1 {
        exchange(&mut v, i, N - 1);
    }
    v
}

/// Sorts a few values by odd-even transposition.
#[inline(always)]
fn sort<const N: usize>(mut v: [f32; N]) -> [f32; N] {
    for round in 0..N {
        let mut i = round % 2;
        while i + 1 < N {
            exchange(&mut v, i, i + 1);
            i += 2;
        }
    }
    v
}

#[inline(always)]
fn exchange<const N: usize>(v: &mut [f32; N], i: usize, j: usize) {
    let (a, b) = (v[i], v[j]);
    v[i] = if a < b { a } else { b };
    v[j] = if a < b { b } else { a };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    #[test]
    fn equals_sorting_every_window() {
        for (radius, width, height) in [(1, 1, 1), (1, 7, 5), (2, 3, 2), (2, 19, 8), (2, 64, 9), (1, 33, 6)] {
            let mut state = State::default();
            state.resize(width, height);
            for y in 0..height {
                for (x, u) in state.row_mut(y)[0].iter_mut().enumerate() {
                    *u = rng::unit(rng::hash(3, &[x as u64, y as u64])) - 0.5;
                }
            }
            let before: Vec<Vec<f32>> = (0..height).map(|y| state.row(Channel::U, y).to_vec()).collect();
            Median::default().apply(&mut state, radius);
            let r = radius as isize;
            let at = |x: isize, y: isize| {
                before[y.clamp(0, height as isize - 1) as usize][x.clamp(0, width as isize - 1) as usize]
            };
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let offsets = (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| (dx, dy)));
                let mut window: Vec<f32> = offsets.map(|(dx, dy)| at(x as isize + dx, y as isize + dy)).collect();
                window.sort_by(f32::total_cmp);
                assert_eq!(state.row(Channel::U, y)[x], window[window.len() / 2], "radius {radius} at {x},{y}");
            }
        }
    }
}
