//! How a clip's frames differ as wholes: cuts, fades, standstill, repeated frames, whether anything moves.
//!
//! Judged on means of 8 × 8 pixels, which noise hardly moves.

use std::ops::Range;

use crate::raster::image::Plane;

/// Side of the square that one thumbnail pixel averages.
const SIDE: usize = 8;
/// One step of 8-bit luma in the units of the thumbnails.
const STEP8: i32 = 257;
/// Frames between which a fade is looked for (half a second).
const LAG: usize = 12;
/// Least change of a thumbnail pixel in a cut or fade, thumbnail units (5 % of white).
const LEAST_CHANGE: i32 = 3277;
/// A change this many times the pixel's typical one is extraordinary.
const EXTRAORDINARY: i32 = 4;
/// Share of the picture that changes extraordinarily in a cut or fade.
const WHOLE: f32 = 0.6;
/// Least share of all places that must change so, however few are calm.
const LEAST_SHARE: f32 = 0.3;
/// Frames that a standstill lasts at least (1 s).
const STANDSTILL: usize = 25;

/// A change of the whole picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    /// From one frame to the next: the first frame after it.
    Cut(usize),
    /// Over these frames.
    Fade(Range<usize>),
}

/// Small luma pictures of all frames, 16 bits for [0, 1].
#[derive(Debug, Clone, Default)]
pub struct Thumbnails {
    frames: Vec<Vec<u16>>,
}

impl Thumbnails {
    /// Number of frames.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// True before the first frame.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Adds a frame's luma, in [0, 1].
    pub fn push(&mut self, luma: &Plane) {
        let (width, height) = (luma.width / SIDE, luma.height / SIDE);
        let mut sums = vec![0.0f32; width * height];
        for y in 0..height * SIDE {
            let sums = &mut sums[y / SIDE * width..][..width];
            for (sum, part) in sums.iter_mut().zip(luma.row(y).chunks_exact(SIDE)) {
                *sum += part.iter().sum::<f32>();
            }
        }
        let scale = 65535.0 / (SIDE * SIDE) as f32;
        self.frames.push(sums.into_iter().map(|s| (s * scale + 0.5) as u16).collect());
    }

    /// Largest difference between two frames, thumbnail units.
    fn largest(&self, a: usize, b: usize) -> i32 {
        let pairs = self.frames[a].iter().zip(&self.frames[b]);
        pairs.map(|(a, b)| (i32::from(*a) - i32::from(*b)).abs()).max().unwrap_or(0)
    }

    /// Stretches of a second or more in which no place leaves its first value by more than a step of 8-bit luma.
    pub fn frozen(&self) -> Vec<Range<usize>> {
        let mut runs = Vec::new();
        let mut start = 0;
        for frame in 1..=self.len() {
            if frame == self.len() || self.largest(start, frame) > STEP8 {
                if frame - start >= STANDSTILL {
                    runs.push(start..frame);
                }
                start = frame;
            }
        }
        runs
    }

    /// Share of the frames that differ from the one before (standstills left out), 0 to 1; 1 for a single frame.
    pub fn distinct(&self) -> f32 {
        let frozen = self.frozen();
        let judged = |frame: &usize| !frozen.iter().any(|run| run.contains(frame));
        let frames: Vec<usize> = (1..self.len()).filter(judged).collect();
        let repeats = frames.iter().filter(|&&frame| self.largest(frame - 1, frame) <= STEP8 / 4).count();
        1.0 - repeats as f32 / frames.len().max(1) as f32
    }

    /// Share of the picture that changes over a fifth of a second by more than noise does, after the whole picture's
    /// own change of brightness and contrast is taken out.
    pub fn moving(&self) -> f32 {
        const APART: usize = 5;
        const LEAST: f32 = STEP8 as f32;
        let pairs = self.len().saturating_sub(APART);
        let size = self.frames.first().map_or(0, Vec::len);
        let mut squares = vec![0.0f32; size];
        let times: Vec<usize> = (0..pairs).step_by(pairs.div_ceil(64).max(1)).collect();
        for &t in &times {
            let (a, b) = (&self.frames[t], &self.frames[t + APART]);
            let (gain, offset) = common_line(a, b);
            for ((sum, a), b) in squares.iter_mut().zip(a).zip(b) {
                *sum += (f32::from(*b) - gain * f32::from(*a) - offset).powi(2);
            }
        }
        let limit = LEAST * LEAST * times.len() as f32;
        squares.iter().filter(|s| **s > limit).count() as f32 / size.max(1) as f32
    }

    /// Cuts and fades, in order.
    pub fn changes(&self) -> Vec<Change> {
        if self.len() <= 2 * LAG {
            return Vec::new();
        }
        let (slow, fast) = (self.typical(LAG), self.typical(1));
        let flagged = |t: &usize| self.share(*t, *t + LAG, &slow) > WHOLE;
        let times: Vec<usize> = (0..self.len() - LAG).filter(flagged).collect();
        let mut changes = Vec::new();
        for run in times.chunk_by(|a, b| a + 1 == *b) {
            let span = run[0]..run[run.len() - 1] + LAG + 1;
            let jump = |t: &usize| self.share(*t - 1, *t, &fast) > WHOLE;
            let cuts: Vec<usize> = (span.start + 1..span.end).filter(jump).collect();
            if cuts.is_empty() {
                changes.push(Change::Fade(span));
            } else {
                changes.extend(cuts.into_iter().map(Change::Cut));
            }
        }
        if changes.is_empty() && self.dims() {
            changes.push(Change::Fade(0..self.len()));
        }
        changes
    }

    /// Each place's median change over `lag` frames.
    fn typical(&self, lag: usize) -> Vec<i32> {
        let pairs = self.len() - lag;
        let times: Vec<usize> = (0..pairs).step_by(pairs.div_ceil(64)).collect();
        let place = |i: usize| {
            let change = |&t: &usize| (i32::from(self.frames[t + lag][i]) - i32::from(self.frames[t][i])).abs();
            let mut changes: Vec<i32> = times.iter().map(change).collect();
            changes.sort_unstable();
            changes[changes.len() / 2]
        };
        (0..self.frames[0].len()).map(place).collect()
    }

    /// Share of the places that change extraordinarily from frame `a` to frame `b`. Where a part of the picture is calm
    /// only that part is asked, for nothing is extraordinary in a torrent.
    fn share(&self, a: usize, b: usize, typical: &[i32]) -> f32 {
        let calm = |typical: i32| EXTRAORDINARY * typical <= LEAST_CHANGE;
        let calms = typical.iter().filter(|t| calm(**t)).count();
        let judged = |i: &usize| calms * 10 < typical.len() || calm(typical[*i]);
        let change = |i: usize| (i32::from(self.frames[a][i]) - i32::from(self.frames[b][i])).abs();
        let large = |i: &usize| change(*i) > (EXTRAORDINARY * typical[*i]).max(LEAST_CHANGE);
        let places: Vec<usize> = (0..typical.len()).filter(judged).collect();
        let count = places.iter().filter(|i| large(i)).count();
        let enough = count as f32 >= LEAST_SHARE * typical.len() as f32;
        if enough { count as f32 / places.len().max(1) as f32 } else { 0.0 }
    }

    /// True when the end is the beginning with another brightness or contrast: a ramp too slow for [`LAG`].
    fn dims(&self) -> bool {
        let mean = |frames: &[Vec<u16>]| -> Vec<u16> {
            let at = |i: usize| frames.iter().map(|f| u32::from(f[i])).sum::<u32>() / frames.len() as u32;
            (0..frames[0].len()).map(|i| at(i) as u16).collect()
        };
        let (first, last) = (mean(&self.frames[..LAG]), mean(&self.frames[self.len() - LAG..]));
        let (gain, offset) = common_line(&first, &last);
        let error = |i: &usize| (f32::from(last[*i]) - gain * f32::from(first[*i]) - offset).abs();
        let alike = (0..last.len()).filter(|i| error(i) < 0.5 * LEAST_CHANGE as f32).count();
        let darker = (1.0 - gain) * 0.5 * 65535.0 - offset;
        let changed = !(0.7..1.4).contains(&gain) || darker.abs() > 0.15 * 65535.0;
        alike * 5 > last.len() * 2 && changed
    }
}

/// Gain and offset that most of the picture shares from `a` to `b`: three fits to the better half of the places.
fn common_line(a: &[u16], b: &[u16]) -> (f32, f32) {
    let (mut gain, mut offset) = (1.0, 0.0);
    for _ in 0..3 {
        let error = |i: &usize| (f32::from(b[*i]) - gain * f32::from(a[*i]) - offset).abs();
        let mut places: Vec<usize> = (0..a.len()).collect();
        places.sort_by(|i, j| error(i).total_cmp(&error(j)).then(i.cmp(j)));
        places.truncate(a.len().div_ceil(2));
        let pick = |v: &[u16]| -> Vec<u16> { places.iter().map(|i| v[*i]).collect() };
        (gain, offset) = line(&pick(a), &pick(b));
    }
    (gain, offset)
}

/// Gain and offset that turn `a` into `b` best; near 1 where `a` is flat.
fn line(a: &[u16], b: &[u16]) -> (f32, f32) {
    let n = a.len().max(1) as f64;
    let mean = |v: &[u16]| v.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    let (ma, mb) = (mean(a), mean(b));
    let (mut product, mut square) = (0.0, 0.0);
    for (a, b) in a.iter().zip(b) {
        let (a, b) = (f64::from(*a) - ma, f64::from(*b) - mb);
        product += a * b;
        square += a * a;
    }
    let rounding = n * f64::from(STEP8 * STEP8);
    let gain = (product + rounding) / (square + rounding);
    (gain as f32, (mb - gain * ma) as f32)
}
