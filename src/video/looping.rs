//! Loop points of a clip: a seamless sequence of any length out of the frames there are.
//!
//! After Schödl, Szeliski, Salesin & Essa, "Video Textures" (SIGGRAPH 2000), §3.1 and §4: a jump is good when the frames
//! around its two ends are alike, weighted binomially, so that the motion goes on and not only the picture. Here the
//! neighbourhood is the cross-fade itself. All jumps go back to one start frame; a clip that is long enough is used
//! once, a shorter one is gone through several times, each time for as many frames as suits the jump and the sum. No
//! frame is shown longer or shorter than in the clip, and none backwards. Steps of the clip that stand out alone
//! ([`crate::video::steps`]) are avoided where that is cheap, and softened by mixing the two frames where it is not.

use crate::base::error::{Error, Kind, Result};
use crate::base::par;
use crate::raster::image::Plane;
use crate::raster::resample::{resize, shrunk};

/// Long side of a thumbnail, in pixels.
const THUMBNAIL_SIDE: usize = 64;
/// Fewest frames of a cross-fade, where the clip has enough: a jump is judged over at least these.
const MIN_FADE: usize = 4;
/// Frames of a cross-fade per frame of the fluid's memory. A fade then changes the picture more slowly than the fluid
/// does, and two pictures are not seen one through the other for longer than they would be remembered.
const FADE_PER_MEMORY: usize = 3;
/// Fewest frames between jumps, where clip and loop have enough.
const MIN_SEGMENT: usize = 16;
/// What a jump costs by itself, where 1 is a jump between unrelated frames: a repetition must make up for it.
const JUMP_COST: f64 = 0.5;
/// What a softened step costs.
const SOFTENED_COST: f64 = 0.25;
/// What a step costs that stands out within a fade, where it cannot be softened: as much as the worst jump.
const POP_COST: f64 = 1.0;
/// Share of the other frame on either side of a softened step. A step of `p` times the usual leaves one of `p / 2`
/// between two of `√(1 + p² / 16)`: about alike for 2.3.
const SOFTENED_SHARE: f32 = 0.25;

/// Luma shrunk to 64 pixels on the long side, to compare frames by.
pub fn thumbnail(luma: &Plane) -> Plane {
    let (width, height) = shrunk((luma.width, luma.height), THUMBNAIL_SIDE);
    resize(luma, width, height)
}

/// Mean squared differences between all pairs of frames of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct Distances {
    frames: usize,
    squared: Vec<f32>,
}

impl Distances {
    /// Between thumbnails of equal size, `frames²` numbers in all.
    ///
    /// # Panics
    /// When their sizes differ.
    pub fn between(thumbnails: &[Plane]) -> Self {
        let row = |i: usize| -> Vec<f32> {
            (0..i).map(|j| mean_squared_difference(&thumbnails[i].data, &thumbnails[j].data)).collect()
        };
        let frames = thumbnails.len();
        let mut squared = vec![0.0; frames * frames];
        for (i, row) in par::map(frames, row).into_iter().enumerate() {
            for (j, value) in row.into_iter().enumerate() {
                squared[i * frames + j] = value;
                squared[j * frames + i] = value;
            }
        }
        Self { frames, squared }
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Squared difference of frames `i` and `j`.
    pub fn at(&self, i: usize, j: usize) -> f64 {
        f64::from(self.squared[i * self.frames + j])
    }

    /// Frames after which half of what was to be seen has changed: the first lag with a mean difference of at least
    /// half of that between unrelated frames. At least 1, and no more than a quarter of the clip.
    pub fn memory(&self) -> usize {
        let mean = |lag: usize| {
            let count = self.frames.saturating_sub(lag).max(1);
            (0..self.frames.saturating_sub(lag)).map(|i| self.at(i, i + lag)).sum::<f64>() / count as f64
        };
        let (longest, half) = ((self.frames / 4).max(1), 0.5 * self.unrelated());
        (1..longest).find(|&lag| mean(lag) >= half).unwrap_or(longest)
    }

    /// Mean over pairs of frames at least a quarter of the clip apart: what unrelated frames differ by. Not 0.
    fn unrelated(&self) -> f64 {
        let lag = (self.frames / 4).max(1);
        let pairs = (0..self.frames).flat_map(|i| (i + lag..self.frames).map(move |j| (i, j)));
        let (sum, count) = pairs.fold((0.0, 0usize), |(sum, count), (i, j)| (sum + self.at(i, j), count + 1));
        (sum / count.max(1) as f64).max(1e-12)
    }
}

fn mean_squared_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    // Sixteen sums side by side, so that the compiler may keep them in one register.
    let mut sums = [0.0f32; 16];
    let (a_chunks, b_chunks) = (a.chunks_exact(16), b.chunks_exact(16));
    let tail: f32 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(a, b)| (a - b) * (a - b)).sum();
    for (a, b) in a_chunks.zip(b_chunks) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += (a - b) * (a - b);
        }
    }
    (sums.iter().sum::<f32>() + tail) / a.len().max(1) as f32
}

/// One source frame with its weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Frame of the clip.
    pub frame: usize,
    /// Factor for the frame's difference from the clip's mean.
    pub weight: f32,
}

/// What one output frame is made of: `mean + Σ weight · (frame − mean)`, the weights having the sum 1. Such a sum of
/// unlike frames lacks contrast: see [`Blend::gain`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blend {
    /// The frame that goes on.
    pub a: Part,
    /// During a cross-fade, the frame that is left; beside a softened step, the frame on the other side of it.
    pub b: Option<Part>,
    /// Number of the jump or the step that is softened, where there is a `b`; see [`LoopPlan::mixed`].
    pub pair: usize,
}

impl Blend {
    /// Factor that gives the sum the contrast of one frame, when the two have a correlation of `correlation`:
    /// `1 / √(w² + (1 − w)²)` for 0.
    pub fn gain(&self, correlation: f32) -> f32 {
        let product = self.b.map_or(0.0, |b| self.a.weight * b.weight);
        1.0 / (1.0 - 2.0 * product * (1.0 - correlation.clamp(0.0, 1.0))).sqrt()
    }
}

/// A run of consecutive source frames.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Segment {
    /// Output frame it begins at.
    begin: usize,
    /// Output frames until the next segment begins.
    length: usize,
}

/// Which source frames make up a seamless loop.
#[derive(Debug, Clone, PartialEq)]
pub struct LoopPlan {
    length: usize,
    fade: usize,
    start: usize,
    segments: Vec<Segment>,
    /// Steps of the clip that are softened where they are shown outside fades, each named by the frame before it.
    softened: Vec<usize>,
    worst: f64,
}

impl LoopPlan {
    /// Frames of the loop.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Frames of a cross-fade.
    pub fn fade(&self) -> usize {
        self.fade
    }

    /// Source frame that every segment starts from.
    pub fn start(&self) -> usize {
        self.start
    }

    /// Frames from jump to jump, in order; their sum is [`LoopPlan::length`].
    pub fn segments(&self) -> Vec<usize> {
        self.segments.iter().map(|segment| segment.length).collect()
    }

    /// Root mean squared difference across the worst jump, relative to unrelated frames: 0 is a perfect loop, 1 a fade
    /// between frames that have nothing in common.
    pub fn worst_jump(&self) -> f64 {
        self.worst
    }

    /// What output frame `t` is made of; frame [`LoopPlan::length`] is frame 0 again.
    pub fn at(&self, t: usize) -> Blend {
        let t = t % self.length;
        let current = self.segments.partition_point(|segment| segment.begin <= t) - 1;
        let k = t - self.segments[current].begin;
        let jump = (current + self.segments.len() - 1) % self.segments.len();
        if k >= self.fade {
            return self.plain(k, self.segments[current].length);
        }
        let w = (k + 1) as f32 / (self.fade + 1) as f32;
        let b = Part { frame: self.start + self.segments[jump].length + k, weight: 1.0 - w };
        Blend { a: Part { frame: self.start + k, weight: w }, b: Some(b), pair: jump }
    }

    /// What frame `k` of a segment of `length` frames is made of, after the fade.
    fn plain(&self, k: usize, length: usize) -> Blend {
        let frame = self.start + k;
        let beside = self.softened.iter().enumerate().find_map(|(number, &step)| {
            let shown = self.start + self.fade <= step && step + 1 < self.start + length;
            let other = if frame == step { step + 1 } else { step };
            (shown && (frame == step || frame == step + 1)).then_some((number, other))
        });
        let Some((number, other)) = beside else {
            return Blend { a: Part { frame, weight: 1.0 }, b: None, pair: 0 };
        };
        let b = Part { frame: other, weight: SOFTENED_SHARE };
        Blend { a: Part { frame, weight: 1.0 - SOFTENED_SHARE }, b: Some(b), pair: self.segments.len() + number }
    }

    /// Pairs of frames that are mixed: the two in the middle of the fade over each jump, then those of each softened
    /// step. None where there is no fade.
    pub fn mixed(&self) -> Vec<(usize, usize)> {
        if self.fade == 0 {
            return Vec::new();
        }
        let first = self.start + self.fade / 2;
        let jumps = self.segments.iter().map(|segment| (first, first + segment.length));
        jumps.chain(self.softened.iter().map(|&step| (step, step + 1))).collect()
    }
}

/// Plans a loop of `length` frames over a clip, with cross-fades of at most `fade` frames (and a quarter of the clip and
/// half of the loop; at least 4 where these allow). Quick fluids get shorter ones: see [`Distances::memory`]. `pops` are
/// the steps of the clip that stand out alone, ascending, each named by the frame before it.
///
/// # Errors
/// A clip or a loop without frames.
pub fn plan_loop(distances: &Distances, pops: &[usize], length: usize, fade: usize) -> Result<LoopPlan> {
    let frames = distances.frames();
    if frames == 0 || length == 0 {
        let problem = format!("{frames} frames cannot become a loop of {length}");
        return Err(Error::new(Kind::Unusable, "loop", problem).allowed("at least 1 of each"));
    }
    let fade = fade.min(FADE_PER_MEMORY * distances.memory()).max(MIN_FADE).min(frames / 4).min(length / 2);
    let longest = frames - fade;
    // Any sum can be reached when twice the shortest is at most one more than the longest.
    let shortest = MIN_SEGMENT.max(2 * fade).min(longest.div_ceil(2)).min(length).max(1);
    let weights = binomial(fade);
    let unrelated = distances.unrelated();
    // Without a fade, the frame after the last may be missing; the last stands for it.
    let cost = |start: usize, length: usize| {
        let squared = |(k, w): (usize, &f64)| w * distances.at(start + k, (start + length + k).min(frames - 1));
        weights.iter().enumerate().map(squared).sum::<f64>() / unrelated
    };
    let plans = par::map(longest - shortest + 1, |start| {
        let cost = |l: usize| cost(start, l) + pops_cost(pops, start, l, fade);
        let costs: Vec<f64> = (shortest..=(longest - start).min(length)).map(cost).collect();
        best_lengths(&costs, shortest, length)
    });
    let best =
        plans.into_iter().enumerate().filter_map(|(start, plan)| plan.map(|(total, lengths)| (total, start, lengths)));
    let best = best.min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, start, lengths)) = best else {
        return Err(Error::new(Kind::Unusable, "loop", format!("{frames} frames do not make a loop of {length}")));
    };
    let mut begin = 0;
    let segments = lengths.into_iter().map(|length| {
        let segment = Segment { begin, length };
        begin += length;
        segment
    });
    let segments: Vec<Segment> = segments.collect();
    let worst = segments.iter().map(|segment| cost(start, segment.length)).fold(0.0, f64::max).sqrt();
    let longest = segments.iter().map(|segment| segment.length).max().unwrap_or(0);
    let softened = pops.iter().copied().filter(|&pop| fade > 0 && start + fade <= pop && pop + 1 < start + longest);
    Ok(LoopPlan { length, fade, start, softened: softened.collect(), segments, worst })
}

/// What the steps that stand out cost a segment of `length` frames from `start` on, with the fades at its two ends.
fn pops_cost(pops: &[usize], start: usize, length: usize, fade: usize) -> f64 {
    let of = |&pop: &usize| match pop.checked_sub(start) {
        Some(step) if step < fade || (length - 1..length - 1 + fade).contains(&step) => POP_COST,
        Some(step) if step + 1 < length => SOFTENED_COST,
        _ => 0.0,
    };
    pops.iter().map(of).sum()
}

/// Lengths with sum `total` whose costs (of `shortest`, `shortest + 1`…) and jumps are least in sum, with that sum.
fn best_lengths(costs: &[f64], shortest: usize, total: usize) -> Option<(f64, Vec<usize>)> {
    let mut best = vec![(f64::INFINITY, 0); total + 1];
    best[0].0 = 0.0;
    for sum in shortest..=total {
        for (i, cost) in costs.iter().enumerate().take(sum + 1 - shortest) {
            let candidate = best[sum - shortest - i].0 + cost + JUMP_COST;
            if candidate < best[sum].0 {
                best[sum] = (candidate, shortest + i);
            }
        }
    }
    let mut lengths = Vec::new();
    let mut rest = total;
    while rest > 0 && best[rest].1 > 0 {
        lengths.push(best[rest].1);
        rest -= best[rest].1;
    }
    (rest == 0).then(|| (best[total].0, lengths))
}

/// Binomial weights of `count` neighbours (1 at least), with sum 1.
fn binomial(count: usize) -> Vec<f64> {
    let mut row = vec![1.0];
    for _ in 1..count {
        let shifted = row.iter().copied().chain([0.0]).zip([0.0].into_iter().chain(row.iter().copied()));
        row = shifted.map(|(a, b)| (a + b) / 2.0).collect();
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;
    use crate::video::steps::isolated_steps;

    /// Smooth noise that moves: a wide strip of blurred noise seen through a window moving by `step` pixels a frame,
    /// repeating every `period` pixels.
    fn moving_texture(frames: usize, step: f64, period: usize) -> Vec<Plane> {
        let noise = |x: isize, y: usize| {
            let x = x.rem_euclid(period as isize) as usize;
            rng::unit(rng::hash(7, &[x as u64, y as u64])) as f64 - 0.5
        };
        let smooth =
            |x: isize, y: usize| (-3..=3).map(|d: isize| noise(x + d, y) * (4 - d.abs()) as f64 / 16.0).sum::<f64>();
        let value = |x: f64, y: usize| {
            let (floor, part) = (x.floor(), x - x.floor());
            smooth(floor as isize, y) * (1.0 - part) + smooth(floor as isize + 1, y) * part
        };
        (0..frames).map(|t| Plane::from_fn(32, 16, |x, y| value(x as f64 + step * t as f64, y) as f32)).collect()
    }

    fn mean_of(frames: &[Plane]) -> Plane {
        let mut mean = Plane::zeros(frames[0].width, frames[0].height);
        for frame in frames {
            mean.data.iter_mut().zip(&frame.data).for_each(|(m, v)| *m += v / frames.len() as f32);
        }
        mean
    }

    fn render(frames: &[Plane], mean: &Plane, plan: &LoopPlan, t: usize) -> Plane {
        let blend = plan.at(t);
        let of = |frame: usize| minus(&frames[frame], mean);
        let correlations: Vec<f64> = plan.mixed().iter().map(|&(a, b)| cosine(&of(a), &of(b))).collect();
        let gain = blend.b.map_or(1.0, |_| blend.gain(correlations[blend.pair] as f32));
        let mut out = mean.clone();
        for part in [Some(blend.a), blend.b].into_iter().flatten() {
            let pixels = out.data.iter_mut().zip(&frames[part.frame].data).zip(&mean.data);
            pixels.for_each(|((o, f), m)| *o += gain * part.weight * (f - m));
        }
        out
    }

    fn minus(a: &Plane, b: &Plane) -> Plane {
        Plane::from_vec(a.width, a.height, a.data.iter().zip(&b.data).map(|(a, b)| a - b).collect())
    }

    fn cosine(a: &Plane, b: &Plane) -> f64 {
        let dot = |a: &Plane, b: &Plane| a.data.iter().zip(&b.data).map(|(a, b)| f64::from(a * b)).sum::<f64>();
        dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(1e-12)
    }

    fn rms(a: &Plane, b: &Plane) -> f64 {
        f64::from(mean_squared_difference(&a.data, &b.data)).sqrt()
    }

    #[test]
    fn a_periodic_clip_loops_on_its_period() {
        let frames = moving_texture(90, 2.0, 40); // repeats every 20 frames
        let distances = Distances::between(&frames);
        for length in [60, 120, 100, 240] {
            let plan = plan_loop(&distances, &[], length, 8).unwrap();
            assert!(plan.segments().iter().all(|l| l % 20 == 0), "{length}: {:?}", plan.segments());
            assert!(plan.worst_jump() < 1e-3);
            // Equal frames are not made stronger by the fade.
            assert_eq!(plan.at(2).gain(1.0), 1.0);
        }
    }

    #[test]
    fn no_jump_is_greater_than_a_step() {
        let frames = moving_texture(150, 1.5, 100_003);
        let (mean, distances) = (mean_of(&frames), Distances::between(&frames));
        let step = frames.windows(2).map(|w| rms(&w[0], &w[1])).fold(0.0, f64::max);
        for length in [60, 120, 135, 300] {
            let plan = plan_loop(&distances, &[], length, 12).unwrap();
            let out: Vec<Plane> = (0..=length).map(|t| render(&frames, &mean, &plan, t)).collect();
            assert_eq!(out[0], out[length]);
            let jump = out.windows(2).map(|w| rms(&w[0], &w[1])).fold(0.0, f64::max);
            assert!(jump < 1.05 * step, "{length}: {jump} against {step}");
        }
    }

    /// A moving texture under detail that stands still and is renewed after each of the frames given.
    fn renewed(frames: usize, pops: &[usize]) -> Vec<Plane> {
        let mut all = moving_texture(frames, 0.5, 100_003);
        for (t, frame) in all.iter_mut().enumerate() {
            let epoch = pops.iter().filter(|&&pop| t > pop).count() as u64;
            let detail = (0u64..).map(|i| rng::unit(rng::hash(11, &[epoch, i])) - 0.5);
            frame.data.iter_mut().zip(detail).for_each(|(value, detail)| *value += 0.12 * detail);
        }
        all
    }

    fn steps(frames: &[Plane]) -> Vec<f64> {
        frames.windows(2).map(|w| rms(&w[0], &w[1])).collect()
    }

    /// Greatest step of a loop over the median of its steps.
    fn roughness(frames: &[Plane], plan: &LoopPlan) -> f64 {
        let mean = mean_of(frames);
        let mut steps = steps(&(0..=plan.length()).map(|t| render(frames, &mean, plan, t)).collect::<Vec<_>>());
        steps.sort_by(f64::total_cmp);
        steps[steps.len() - 1] / steps[steps.len() / 2]
    }

    #[test]
    fn a_lone_step_is_avoided_where_the_clip_is_long_enough() {
        for pops in [vec![40], vec![140], vec![20, 170], vec![40, 150]] {
            let frames = renewed(200, &pops);
            let found = isolated_steps(&steps(&frames));
            assert_eq!(found, pops);
            let plan = plan_loop(&Distances::between(&frames), &found, 80, 8).unwrap();
            let shown = plan.start()..plan.start() + 80 + plan.fade() - 1;
            assert!(!pops.iter().any(|pop| shown.contains(pop)), "{pops:?}: {shown:?}");
            assert!(roughness(&frames, &plan) < 1.5, "{pops:?}: {}", roughness(&frames, &plan));
        }
    }

    #[test]
    fn a_lone_step_is_softened_where_it_must_be_shown() {
        for (length, pops) in [(50, vec![30]), (150, vec![25]), (100, vec![20, 40])] {
            let frames = renewed(64, &pops);
            let (distances, found) = (Distances::between(&frames), isolated_steps(&steps(&frames)));
            assert_eq!(found, pops);
            let rough = roughness(&frames, &plan_loop(&distances, &[], length, 8).unwrap());
            let plan = plan_loop(&distances, &found, length, 8).unwrap();
            let soft = roughness(&frames, &plan);
            assert!(rough > 1.8 && soft < 1.5, "{length}: {rough} to {soft}");
            for t in 0..length {
                assert!(plan.at(t).b.is_none_or(|b| b.frame < 64) && plan.at(t).pair < plan.mixed().len());
            }
        }
    }

    #[test]
    fn bursts_of_motion_are_no_lone_steps() {
        // Twice as fast for some frames, every now and then.
        let all = moving_texture(260, 0.5, 100_003);
        let mut place = 0;
        let places = (0..150).map(|t| {
            place += if t % 37 < 4 { 2 } else { 1 };
            place
        });
        let frames: Vec<Plane> = places.map(|place| all[place].clone()).collect();
        assert!(isolated_steps(&steps(&frames)).is_empty());
    }

    #[test]
    fn noise_keeps_its_contrast_through_a_fade() {
        let noise =
            |t: usize| Plane::from_fn(64, 64, |x, y| rng::unit(rng::hash(3, &[t as u64, x as u64, y as u64])) - 0.5);
        let frames: Vec<Plane> = (0..80).map(noise).collect();
        let mean = mean_of(&frames);
        let plan = plan_loop(&Distances::between(&frames), &[], 60, 11).unwrap();
        let contrast = |plane: &Plane| rms(plane, &mean);
        let plain = contrast(&render(&frames, &mean, &plan, 30));
        for t in 0..plan.fade() {
            let faded = contrast(&render(&frames, &mean, &plan, t));
            assert!((faded / plain - 1.0).abs() < 0.04, "{t}: {faded} against {plain}");
        }
    }

    #[test]
    fn quick_fluids_get_short_fades() {
        let fade = |step: f64| {
            let frames = moving_texture(120, step, 100_003);
            plan_loop(&Distances::between(&frames), &[], 60, 20).unwrap().fade()
        };
        assert_eq!(fade(0.2), 20);
        assert!(fade(1.0) < 15 && fade(1.0) > fade(4.0), "{} {}", fade(1.0), fade(4.0));
    }

    #[test]
    fn a_long_clip_is_used_once_at_its_best_place() {
        // Noise, apart from frames 20.. and 80.. which are alike.
        let pattern = |t: usize| if (80..100).contains(&t) { t - 60 } else { t };
        let noise =
            |t: usize| Plane::from_fn(16, 16, |x, y| rng::unit(rng::hash(5, &[pattern(t) as u64, x as u64, y as u64])));
        let frames: Vec<Plane> = (0..200).map(noise).collect();
        let plan = plan_loop(&Distances::between(&frames), &[], 60, 8).unwrap();
        assert_eq!(plan.segments(), [60]);
        assert!((20..32).contains(&plan.start()), "{}", plan.start());
        assert!(plan.worst_jump() < 0.3);
    }

    #[test]
    fn every_length_of_clip_and_loop_works() {
        let all = moving_texture(50, 1.0, 999);
        for frames in [1, 2, 3, 5, 8, 16, 17, 40, 50] {
            let distances = Distances::between(&all[..frames]);
            for length in (1..40).chain([99, 120, 250]) {
                let plan = plan_loop(&distances, &[], length, 12).unwrap();
                assert_eq!(plan.segments().iter().sum::<usize>(), length);
                for t in 0..length {
                    let (now, next) = (plan.at(t), plan.at(t + 1));
                    assert!(now.a.frame < frames && now.b.is_none_or(|b| b.frame < frames));
                    // What is shown goes on: the next frame of this one is in the next blend, nothing is repeated.
                    let follows = |part: Option<Part>| part.is_some_and(|p| p.frame == now.a.frame + 1);
                    assert!(plan.fade() == 0 || follows(Some(next.a)) || follows(next.b), "{frames} {length} {t}");
                }
            }
        }
        assert!(plan_loop(&Distances::between(&[]), &[], 10, 4).is_err());
        assert!(plan_loop(&Distances::between(&all), &[], 0, 4).is_err());
    }

    #[test]
    fn thumbnails_are_small_and_keep_proportions() {
        let small = thumbnail(&Plane::filled(640, 360, 0.5));
        assert_eq!((small.width, small.height), (64, 36));
        assert!((small.at(5, 5) - 0.5).abs() < 1e-5);
        assert_eq!(thumbnail(&Plane::filled(20, 3, 0.5)).width, 20);
    }
}
