//! From which phase of its loop each clip is shown.

use super::footage::{Clip, Playing};
use super::placing::Placed;

/// Per source of the layout: its clip at its phase, in a loop of `frames` frames.
pub fn playing<'a>(placed: &Placed, clips: &'a [Clip], frames: usize) -> Vec<Playing<'a>> {
    let phases = placed.sources.iter().map(|s| s.1).max().unwrap_or(0) + 1;
    let phase = |clip: usize, phase: usize| stagger(clip) + phase as f64 / phases as f64;
    placed.sources.iter().map(|&(clip, number)| Playing::new(&clips[clip], phase(clip, number), frames)).collect()
}

/// Phase of the loop at which the `clip`th clip begins, spread evenly however many there are (multiples of the golden
/// ratio): with all loops closing at the same frame, their fades would be seen as one.
fn stagger(clip: usize) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    (clip as f64 * GOLDEN).fract()
}
