//! Which of a clip's frames are kept to bring it near the library's rate.
//!
//! Kept frames must follow each other evenly: where one frame in six is left out to come from 30 to 25 a second, the
//! water jumps five times a second, and where one is shown twice it stops. So of every n frames one is kept, n the whole
//! number that brings the rate nearest to the library's in ratio (25: up to 35 frames a second all are kept, up to 61
//! every second one, up to 86 every third), and they are played at the library's rate, a little slower or faster than
//! filmed; the report says by how much. (24 frames a second are played as 25 on European television since film began
//! to be shown there.)
//!
//! Presentation times decide, place by place: a clip whose rate changes is thinned out where it is fast and taken frame
//! for frame where it is slow. Where the fast part misses a frame, the nearest in time takes its place.
//!
//! Removed duplicates leave gaps. Where one or two in a row were removed (pulldown: 24 frames a second padded to 30),
//! the clip's own time is right on average, so the time of the neighbourhood is spread evenly over its frames; where
//! three or more were (a stall), their time is cut out: shown to scale it would be a stop, and the frames on either
//! side mostly follow each other.

use std::collections::VecDeque;

/// Duplicates in a row from which on a gap is a stall.
const STALL: usize = 3;
/// Gaps on either side over which time is spread, and the rate is measured.
const REACH: usize = 5;
/// Gaps so many times as long as the median, or as short, say nothing of the rate: a missing frame, a pause.
const ODD: f64 = 1.8;
/// One in n frames goes on being kept while that comes to the library's rate within this factor, so that n does not
/// waver.
const HOLD: f64 = 1.5;
/// Most frames of which one is kept; still more in a library frame's time are a fault in the times.
const MAX_EVERY: f64 = 40.0;

/// A frame's distance from the one before it.
#[derive(Debug, Clone, Copy)]
struct Gap {
    seconds: f64,
    removed: usize,
}

/// Chooses frames; `T` is whatever stands for a frame.
#[derive(Debug)]
pub struct Clock<T> {
    tick: f64,
    /// Seconds between the source's frames, as a rule.
    period: f64,
    gaps: Vec<Gap>,
    /// Frames whose spacing is not settled yet; the last belongs to the last gap.
    held: VecDeque<T>,
    /// Of so many frames one is kept; 0 before the first choice.
    every: usize,
    /// Seconds since the frame kept last.
    since: f64,
    ready: VecDeque<T>,
    /// Seconds from the first kept frame to the last, stalls cut out.
    elapsed: f64,
    kept: usize,
    dropped: usize,
}

impl<T> Clock<T> {
    /// For a library `rate` and a source with frames every `period` seconds.
    pub fn new(rate: f64, period: f64) -> Self {
        let (held, ready) = (VecDeque::new(), VecDeque::new());
        let (tick, gaps) = (1.0 / rate, Vec::new());
        Self { tick, period, gaps, held, every: 0, since: 0.0, ready, elapsed: 0.0, kept: 0, dropped: 0 }
    }

    /// Adds a frame shown `seconds` after the one added before it, with `removed` duplicates in between.
    pub fn push(&mut self, frame: T, seconds: f64, removed: usize) {
        if self.kept == 0 {
            self.keep(frame);
            return;
        }
        self.gaps.push(Gap { seconds: seconds.max(0.0), removed });
        self.held.push_back(frame);
        if self.held.len() > REACH {
            self.settle();
        }
    }

    /// No more frames come: all that is left becomes ready.
    pub fn finish(&mut self) {
        while !self.held.is_empty() {
            self.settle();
        }
    }

    /// The next chosen frame.
    pub fn pop(&mut self) -> Option<T> {
        self.ready.pop_front()
    }

    /// Frames left out to come down to the library's rate.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// How much faster than filmed the chosen frames play at the library's rate; 1 while there are fewer than two.
    pub fn speed(&self) -> f64 {
        if self.kept < 2 { 1.0 } else { self.elapsed / self.tick / (self.kept - 1) as f64 }
    }

    fn settle(&mut self) {
        let Some(next) = self.held.pop_front() else { return };
        let j = self.gaps.len() - 1 - self.held.len();
        self.since += self.spacing(j);
        let usual = self.usual(j);
        self.every = self.every_nth(usual);
        let following = if j + 1 < self.gaps.len() { self.spacing(j + 1) } else { usual };
        // Kept when the next frame would not be nearer.
        if self.every == 1 || self.since + 0.5 * following >= self.every as f64 * usual {
            self.keep(next);
        } else {
            self.dropped += 1;
        }
    }

    fn keep(&mut self, frame: T) {
        self.ready.push_back(frame);
        self.elapsed += std::mem::take(&mut self.since);
        self.kept += 1;
    }

    /// Of how many frames one is kept where they stand `usual` seconds apart.
    fn every_nth(&self, usual: f64) -> usize {
        let ratio = self.tick / usual;
        if ratio.is_nan() || ratio > MAX_EVERY {
            return 1;
        }
        let held = self.every as f64 / ratio;
        if (1.0 / HOLD..=HOLD).contains(&held) {
            return self.every;
        }
        // Of the whole numbers on either side the nearer one in ratio.
        let below = ratio.floor().max(1.0);
        if ratio * ratio > below * (below + 1.0) { below as usize + 1 } else { below as usize }
    }

    /// Seconds that gap `j` is taken for.
    fn spacing(&self, j: usize) -> f64 {
        if self.gaps[j].removed >= STALL || !self.is_padded(j) {
            return self.cut(&self.gaps[j]);
        }
        mean(self.around(j).iter().map(|gap| self.cut(gap)))
    }

    /// Seconds between frames about gap `j`, as a rule.
    fn usual(&self, j: usize) -> f64 {
        let around = self.around(j).iter().map(|gap| self.cut(gap));
        if self.is_padded(j) {
            return mean(around);
        }
        let mut sorted: Vec<f64> = around.collect();
        sorted.sort_by(f64::total_cmp);
        let median = sorted[sorted.len() / 2];
        mean(sorted.into_iter().filter(|&gap| gap <= ODD * median && gap * ODD >= median))
    }

    /// Whether pulldown was removed about gap `j`.
    fn is_padded(&self, j: usize) -> bool {
        self.around(j).iter().any(|gap| (1..STALL).contains(&gap.removed))
    }

    fn around(&self, j: usize) -> &[Gap] {
        &self.gaps[j.saturating_sub(REACH)..(j + REACH + 1).min(self.gaps.len())]
    }

    /// A gap's length; a stall is as long as any gap.
    fn cut(&self, gap: &Gap) -> f64 {
        if gap.removed >= STALL { self.period } else { gap.seconds }
    }
}

fn mean(seconds: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = seconds.fold((0.0, 0.0), |(sum, count), s| (sum + s, count + 1.0));
    sum / count
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Indices chosen from frames at `times` (seconds) with the duplicates marked, and how much faster than filmed they
    /// play.
    fn played(times: &[f64], duplicate: impl Fn(usize) -> bool, rate: f64) -> (Vec<usize>, f64) {
        let mut clock = Clock::new(rate, times[1] - times[0]);
        let (mut last, mut removed) = (times[0], 0);
        for (i, &time) in times.iter().enumerate() {
            if i > 0 && duplicate(i) {
                removed += 1;
                continue;
            }
            clock.push(i, time - last, removed);
            (last, removed) = (time, 0);
        }
        clock.finish();
        let frames: Vec<usize> = std::iter::from_fn(|| clock.pop()).collect();
        (frames, clock.speed())
    }

    fn chosen(times: &[f64], duplicate: impl Fn(usize) -> bool, rate: f64) -> Vec<usize> {
        played(times, duplicate, rate).0
    }

    fn steady(n: usize, rate: f64) -> Vec<f64> {
        (0..n).map(|i| i as f64 / rate).collect()
    }

    fn steps(frames: &[usize]) -> Vec<usize> {
        frames.windows(2).map(|w| w[1] - w[0]).collect()
    }

    #[test]
    fn steady_clips_keep_one_frame_in_n() {
        let cases = [
            (8.0, 1, 3.125),
            (15.0, 1, 1.667),
            (23.976, 1, 1.043),
            (25.0, 1, 1.0),
            (29.97, 1, 0.834),
            (30.0, 1, 0.833),
            (35.0, 1, 0.714),
            (36.0, 2, 1.389),
            (40.0, 2, 1.25),
            (48.0, 2, 1.042),
            (50.0, 2, 1.0),
            (59.94, 2, 0.834),
            (60.0, 2, 0.833),
            (72.0, 3, 1.042),
            (90.0, 4, 1.111),
            (120.0, 5, 1.042),
            (240.0, 10, 1.042),
        ];
        for (rate, n, speed) in cases {
            // Exact times, and times in half milliseconds.
            for times in [steady(600, rate), steady(600, rate).iter().map(|t| (t * 2e3).round() / 2e3).collect()] {
                let (frames, played) = played(&times, |_| false, 25.0);
                assert!(steps(&frames).iter().all(|&s| s == n), "{rate}: {:?}", steps(&frames));
                assert!((played - speed).abs() < 2e-3, "{rate}: {played}");
            }
        }
        // The library's rate is what counts: 50 a second are all kept at 60.
        assert_eq!(chosen(&steady(100, 50.0), |_| false, 60.0).len(), 100);
    }

    #[test]
    fn a_missing_frame_or_a_pause_changes_nothing_around_it() {
        // Frame 50 of 60 a second was never written: the one after it takes its place, and every second follows.
        let mut times = steady(200, 60.0);
        times.remove(50);
        let frames = chosen(&times, |_| false, 25.0);
        assert!(steps(&frames).iter().all(|s| (1..=2).contains(s)));
        assert!(steps(&frames).iter().filter(|&&s| s != 2).count() <= 1, "{frames:?}");
        // The recorder waits two seconds.
        let paused: Vec<f64> = times.iter().enumerate().map(|(i, t)| if i > 90 { t + 2.0 } else { *t }).collect();
        let away = chosen(&paused, |_| false, 25.0);
        assert!(steps(&away).iter().filter(|&&s| s != 2).count() <= 2, "{away:?}");
    }

    #[test]
    fn pulldown_gives_back_the_film() {
        // 24 frames a second padded to 30, and 25 padded to 30: every real frame once.
        for cycle in [5, 6] {
            let frames = chosen(&steady(300, 30.0), |i| i % cycle == cycle - 1, 25.0);
            let real: Vec<usize> = (0..300).filter(|i| i % cycle != cycle - 1).collect();
            assert_eq!(frames, real);
        }
    }

    #[test]
    fn a_stall_is_cut_out() {
        let frames = chosen(&steady(100, 25.0), |i| (40..60).contains(&i), 25.0);
        assert_eq!(frames, (0..40).chain(60..100).collect::<Vec<_>>());
    }

    #[test]
    fn variable_rates_follow_presentation_time() {
        // 60 frames a second for a second, then 25.
        let times: Vec<f64> = steady(60, 60.0).into_iter().chain((0..25).map(|i| 1.0 + f64::from(i) / 25.0)).collect();
        let frames = chosen(&times, |_| false, 25.0);
        assert_eq!(frames, (0..30).map(|k| 2 * k).chain(60..85).collect::<Vec<_>>());
        // A ramp from 240 to 30 frames a second, as telephones write slow motion: n falls step by step, never rises.
        let mut time = 0.0;
        let ramp: Vec<f64> = (0..400)
            .map(|i| {
                time += 1.0 / (240.0 * 0.125f64.powf((f64::from(i - 100) / 200.0).clamp(0.0, 1.0)));
                time
            })
            .collect();
        let frames = chosen(&ramp, |_| false, 25.0);
        let kept = steps(&frames);
        assert_eq!((kept[0], kept[kept.len() - 1]), (10, 1));
        assert!(kept.windows(2).all(|w| w[1] <= w[0] + 1), "{kept:?}");
        assert!(frames.windows(2).all(|w| (1.0 / HOLD..=1.1 * HOLD).contains(&((ramp[w[1]] - ramp[w[0]]) * 25.0))));
    }

    #[test]
    fn a_rate_at_the_border_does_not_waver() {
        let times: Vec<f64> = (0..400).map(|i| (f64::from(i) + 0.2 * f64::from(i * 7 % 5)) / 35.4).collect();
        let kept = steps(&chosen(&times, |_| false, 25.0));
        assert!(kept.iter().all(|s| s == &kept[0]), "{kept:?}");
    }

    #[test]
    fn padded_fast_clips_keep_one_real_frame_in_n() {
        // 48 frames a second padded to 60.
        let frames = chosen(&steady(300, 60.0), |i| i % 5 == 4, 25.0);
        let real: Vec<usize> = (0..300).filter(|i| i % 5 != 4).collect();
        assert_eq!(frames, real.iter().step_by(2).copied().collect::<Vec<_>>());
    }

    #[test]
    fn broken_times_do_no_harm() {
        assert_eq!(chosen(&[0.0, 0.0, 0.0, 0.0], |_| false, 25.0).len(), 4);
        assert_eq!(chosen(&[0.0, 5.0, 3.0, 1e9], |_| false, 25.0).len(), 4);
        assert_eq!(chosen(&steady(50, 1e6), |_| false, 25.0).len(), 50);
    }
}
