//! Steps of a clip that stand out alone: not motion, but a coder's doing.
//!
//! Coarsely coded clips repeat old detail for some frames and renew it at the next key frame, all over the picture at
//! once. Motion that gets stronger (a flame that leaps, a wave that breaks) does so over several frames.

/// Steps on either side that a step is compared with.
const AROUND: usize = 6;
/// A step that stands out is more than so many times the median of those around it.
const STANDS_OUT: f64 = 1.5;

/// Numbers of the steps that stand out alone, ascending. `steps` are differences of neighbouring frames, step `k` from
/// frame `k` to frame `k + 1`, in any unit. Those around such a step are all nearer to their median than to it; what is
/// large beside another large step is motion, and so is what is large every few frames.
pub fn isolated_steps(steps: &[f64]) -> Vec<usize> {
    (1..steps.len().saturating_sub(1)).filter(|&k| is_isolated(steps, k)).collect()
}

fn is_isolated(steps: &[f64], k: usize) -> bool {
    let nearby = k.saturating_sub(AROUND)..(k + 1 + AROUND).min(steps.len());
    let mut around: Vec<f64> = nearby.filter(|&i| i != k).map(|i| steps[i]).collect();
    around.sort_by(f64::total_cmp);
    let (median, largest) = (around[around.len() / 2], around[around.len() - 1]);
    steps[k] > STANDS_OUT * median && largest < 0.5 * (steps[k] + median)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 60 steps of about 1, with some replaced.
    fn steps(replaced: &[(usize, f64)]) -> Vec<f64> {
        let mut steps: Vec<f64> = (0..60).map(|k| 1.0 + 0.1 * f64::from(k % 3)).collect();
        replaced.iter().for_each(|&(k, value)| steps[k] = value);
        steps
    }

    #[test]
    fn lone_steps_are_found() {
        assert_eq!(isolated_steps(&steps(&[(20, 2.2), (32, 2.0), (57, 3.0)])), [20, 32, 57]);
        assert!(isolated_steps(&steps(&[(20, 1.5)])).is_empty());
    }

    #[test]
    fn bursts_of_motion_and_rhythms_are_left_alone() {
        assert!(isolated_steps(&steps(&[(29, 1.6), (30, 2.4), (31, 1.9), (32, 1.4)])).is_empty());
        assert!(isolated_steps(&steps(&[(29, 2.4), (30, 2.4)])).is_empty());
        let rhythm: Vec<(usize, f64)> = (0..15).map(|k| (4 * k, 2.5)).collect();
        assert!(isolated_steps(&steps(&rhythm)).is_empty());
        // Scenes of different speed.
        let faster: Vec<(usize, f64)> = (30..60).map(|k| (k, 2.5)).collect();
        assert!(isolated_steps(&steps(&faster)).is_empty());
    }

    #[test]
    fn short_and_still_clips_have_none() {
        for count in 0..3 {
            assert!(isolated_steps(&vec![1.0; count]).is_empty());
        }
        assert!(isolated_steps(&[0.0; 40]).is_empty());
        assert_eq!(isolated_steps(&[0.0, 1.0, 0.0]), [1]);
    }
}
