//! Which of a clip's frames are kept to bring it to the library's rate.
//!
//! Frames are chosen by presentation time, the nearest to every tick, under one rule: no frame is shown twice. A
//! repeated frame would read as water that stops. So a clip slower than the library's rate plays faster than life, and
//! the report says by how much; rates within 5 % are taken frame for frame (24 frames a second become 25, as on
//! European television since film began to be shown there).
//!
//! Removed duplicates leave gaps. Where one or two in a row were removed (pulldown: 24 frames a second padded to 30),
//! the clip's own time is right on average, so the time of the neighbourhood is spread evenly over its frames; where
//! three or more were (a stall), their time is cut out: shown to scale it would be a stop, and the frames on either
//! side mostly follow each other.

use std::collections::VecDeque;

/// Duplicates in a row from which on a gap is a stall.
const STALL: usize = 3;
/// Gaps on either side over which time is spread.
const REACH: usize = 5;

/// A frame's distance from the one kept before it.
#[derive(Debug, Clone, Copy)]
struct Gap {
    seconds: f64,
    removed: usize,
}

/// Chooses frames; `T` is whatever stands for a frame.
#[derive(Debug)]
pub struct Clock<T> {
    tick: f64,
    stretch: f64,
    /// Seconds between the source's frames, as a rule.
    period: f64,
    gaps: Vec<Gap>,
    /// Frames whose spacing is not settled yet; the last belongs to the last gap.
    held: VecDeque<T>,
    current: Option<T>,
    /// Time of `current` minus the tick that is due.
    offset: f64,
    ready: VecDeque<T>,
    /// Sum of all settled spacings.
    elapsed: f64,
    dropped: usize,
}

impl<T> Clock<T> {
    /// For a library `rate`, a tolerance `stretch` (0.05 = 5 %) and a source with frames every `period` seconds.
    pub fn new(rate: f64, stretch: f64, period: f64) -> Self {
        let (held, ready) = (VecDeque::new(), VecDeque::new());
        let tick = 1.0 / rate;
        let (gaps, current) = (Vec::new(), None);
        Self { tick, stretch, period, gaps, held, current, offset: 0.0, ready, elapsed: 0.0, dropped: 0 }
    }

    /// Adds a frame shown `seconds` after the one kept before it, with `removed` duplicates in between.
    pub fn push(&mut self, frame: T, seconds: f64, removed: usize) {
        if self.current.is_none() && self.gaps.is_empty() {
            self.current = Some(frame);
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
        self.ready.extend(self.current.take());
    }

    /// The next chosen frame.
    pub fn pop(&mut self) -> Option<T> {
        self.ready.pop_front()
    }

    /// Frames left out because their time was not near a tick.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// Seconds of the source that the chosen frames span, stalls cut out.
    pub fn elapsed(&self) -> f64 {
        self.elapsed
    }

    fn settle(&mut self) {
        let Some(next) = self.held.pop_front() else { return };
        let spacing = self.spacing(self.gaps.len() - 1 - self.held.len());
        self.elapsed += spacing;
        if spacing >= (1.0 - self.stretch) * self.tick {
            self.ready.extend(self.current.replace(next));
            let near = spacing <= (1.0 + self.stretch) * self.tick;
            self.offset = if near { 0.0 } else { (self.offset + spacing - self.tick).min(0.0) };
        } else if (self.offset + spacing).abs() < self.offset.abs() {
            self.current = Some(next);
            self.offset += spacing;
            self.dropped += 1;
        } else {
            self.ready.extend(self.current.replace(next));
            self.offset += spacing - self.tick;
        }
    }

    /// Seconds that gap `j` is taken for.
    fn spacing(&self, j: usize) -> f64 {
        let around = &self.gaps[j.saturating_sub(REACH)..(j + REACH + 1).min(self.gaps.len())];
        let cut = |gap: &Gap| if gap.removed >= STALL { self.period } else { gap.seconds };
        if self.gaps[j].removed >= STALL || around.iter().all(|gap| gap.removed == 0 || gap.removed >= STALL) {
            return cut(&self.gaps[j]);
        }
        around.iter().map(cut).sum::<f64>() / around.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Indices chosen from frames at `times` (seconds) with the duplicates marked.
    fn chosen(times: &[f64], duplicate: impl Fn(usize) -> bool, rate: f64) -> Vec<usize> {
        let mut clock = Clock::new(rate, 0.05, times[1] - times[0]);
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
        std::iter::from_fn(|| clock.pop()).collect()
    }

    fn steady(n: usize, rate: f64) -> Vec<f64> {
        (0..n).map(|i| i as f64 / rate).collect()
    }

    #[test]
    fn near_rates_are_taken_frame_for_frame() {
        for rate in [23.976, 24.0, 25.0, 26.0, 8.0, 15.0] {
            assert_eq!(chosen(&steady(100, rate), |_| false, 25.0).len(), 100, "{rate}");
        }
    }

    #[test]
    fn faster_clips_keep_their_duration_and_the_nearest_frames() {
        for rate in [29.97, 30.0, 50.0, 59.94, 60.0, 72.7, 120.0] {
            let times = steady(600, rate);
            let frames = chosen(&times, |_| false, 25.0);
            let expected = 600.0 / rate * 25.0;
            assert!((frames.len() as f64 - expected).abs() <= 1.5, "{rate}: {}", frames.len());
            for (k, &i) in frames.iter().enumerate().take(frames.len() - 1) {
                assert!((times[i] - k as f64 / 25.0).abs() <= 0.5 / rate + 1e-6, "{rate}: frame {k}");
            }
        }
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
        assert!((49..=51).contains(&frames.len()), "{}", frames.len());
        assert!(frames.windows(2).all(|w| w[1] > w[0]));
    }

    #[test]
    fn broken_times_do_no_harm() {
        assert_eq!(chosen(&[0.0, 0.0, 0.0, 0.0], |_| false, 25.0).len(), 4);
        assert_eq!(chosen(&[0.0, 5.0, 3.0, 1e9], |_| false, 25.0).len(), 4);
    }
}
