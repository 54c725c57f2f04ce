//! The frames of the clips that are used: looped, as differences from their average, and split into bands.
//!
//! Luma is held in 16 bits, whether a frame is kept from the study or read again, so that both give the same bytes.

use std::sync::{Arc, Mutex, PoisonError};

use half::f16;
use macro_rules_attribute::apply;

use crate::base::error::Result;
use crate::base::instructions::kernel;
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::flow::field::Field;
use crate::flow::tv_l1::{Params, TvL1};
use crate::library::frames::KEYFRAME_EVERY;
use crate::library::reader::{FrameReader, Pack};
use crate::library::variant::{CELL, level_size};
use crate::raster::image::Plane;
use crate::raster::pyramid::reduce;
use crate::raster::resample::resize;
use crate::render::blend::{Bands, bands};
use crate::render::contrast::Contrast;
use crate::render::layout::BANDS;
use crate::video::looping::{Blend, Distances, LoopPlan, Part, plan_loop, thumbnail};
use crate::video::steps::isolated_steps;

/// Most frames of a cross-fade where a loop closes.
const FADE: usize = 20;
/// A loop is looked for in the clip's first frames, this many times the frames of the output.
const SEARCHED: usize = 2;
/// Every so many frames are measured for the strength of the differences.
const SAMPLE_STEP: usize = 8;
/// Pairs of neighbouring frames that are compared.
const PAIRS: usize = 3;
/// Frames whose motion is estimated one after another.
const MOTION_RUN: usize = 8;
/// White in 16 bits.
const WHITE: f32 = 65535.0;

/// Luma of a frame in 16 bits, row by row.
type Luma = Vec<u16>;

/// One clip that is used.
pub struct Clip {
    pack: Arc<Pack>,
    /// Number of the clip within its pack.
    pub clip: u32,
    /// Width and height, working pixels.
    pub size: (usize, usize),
    /// Scale numbers that are used, ascending.
    scales: Vec<u8>,
    average: Plane,
    /// Its loop.
    pub plan: LoopPlan,
    /// The frames from the loop's start to its end, where they are kept.
    kept: Option<Vec<Luma>>,
    contrast: Vec<Contrast>,
    /// Per used scale and pair of frames that the loop mixes ([`LoopPlan::mixed`]): how alike they are, band by band.
    alike: Vec<Vec<[f32; BANDS]>>,
    /// Per used scale: how alike neighbouring frames are, band by band.
    neighbours: Vec<[f32; BANDS]>,
    /// Motion from each frame of the loop to the next, where it is wanted.
    motion: Option<Motion>,
}

/// What [`Clip::study`] is to keep.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// The frames of the loop stay in memory, [`loop_bytes`] at most, and are not read again.
    pub frames: bool,
    /// The motion from frame to frame is estimated.
    pub motion: bool,
}

impl Clip {
    /// Reads the clip once: finds its loop of `frames` library frames and measures its differences at `scales`.
    ///
    /// The differences are from the average of the frames that the loop shows, not of the whole clip: what stands still
    /// in the loop but moved at another time (a twig, the light) would otherwise stay as a ghost in every frame.
    ///
    /// # Errors
    /// A damaged pack, a clip that cannot be looped, a cancel.
    pub fn study(
        pack: &Arc<Pack>,
        clip: u32,
        scales: Vec<u8>,
        frames: usize,
        wanted: Wanted,
        observer: &dyn Observer,
    ) -> Result<Self> {
        let meta = &pack.clips()[clip as usize];
        let size = (meta.width as usize, meta.height as usize);
        let searched = searched(meta.frames as usize, frames);
        let (mut lumas, thumbnails) = read(pack, clip, searched, observer)?;
        let plan = plan_loop(&Distances::between(&thumbnails), &isolated_steps(&steps(&lumas)), frames, FADE)?;
        let average = loop_average(&plan, &lumas, size);
        let of_frame = |frame: usize, scale: u8| {
            let mut differences = Plane::zeros(size.0, size.1);
            add_difference(&mut differences.data, 1.0, &lumas[frame], &average.data);
            level_bands(&differences, size, scale)
        };
        let stills: Vec<Bands> = scales.iter().map(|&scale| level_bands(&average, size, scale)).collect();
        let mut contrast = vec![Contrast::default(); scales.len()];
        for t in (0..frames).step_by(SAMPLE_STEP) {
            for ((contrast, still), &scale) in contrast.iter_mut().zip(&stills).zip(&scales) {
                contrast.add(&of_frame(plan.at(t).a.frame, scale), still);
            }
        }
        let likeness = |&(a, b): &(usize, usize), scale| correlations(&of_frame(a, scale), &of_frame(b, scale));
        let alike = |&scale: &u8| plan.mixed().iter().map(|pair| likeness(pair, scale)).collect();
        let alike = scales.iter().map(alike).collect();
        let pairs: Vec<(usize, usize)> =
            (0..PAIRS).map(|k| plan.at(k * frames / PAIRS).a.frame).map(|f| (f, f + 1)).collect();
        let pairs = || pairs.iter().filter(|p| p.1 < searched);
        let mean = |all: Vec<[f32; BANDS]>| {
            std::array::from_fn(|b| all.iter().map(|a| a[b]).sum::<f32>() / all.len().max(1) as f32)
        };
        let neighbours =
            scales.iter().map(|&scale| mean(pairs().map(|pair| likeness(pair, scale)).collect())).collect();
        let shown = plan.start()..end(&plan, searched);
        let motion = wanted.motion.then(|| Motion::estimate(&lumas[shown.clone()], size, &plan));
        let kept = wanted.frames.then(|| lumas.drain(shown).collect());
        Ok(Self { pack: pack.clone(), clip, size, scales, average, plan, kept, contrast, alike, neighbours, motion })
    }

    /// A frame of the loop that was kept.
    fn kept(&self, frame: usize) -> Option<&Luma> {
        self.kept.as_ref().map(|kept| &kept[frame - self.plan.start()])
    }

    /// How strong its bands are at one of the scales it was studied at, unless it was let go.
    pub fn contrast(&self, scale: u8) -> Option<&Contrast> {
        self.scales.iter().position(|&s| s == scale).and_then(|i| self.contrast.get(i))
    }

    /// Lets go of what [`Self::contrast`] gives.
    pub fn forget_contrast(&mut self) {
        self.contrast.clear();
    }

    /// Factors of the bands that keep the contrast through a mixture: fine detail is unlike between two frames whose
    /// coarse forms are still alike, so each band has its own.
    fn gains(&self, blend: &Blend, scale: u8) -> [f32; BANDS] {
        let alike = self.scales.iter().position(|&s| s == scale).and_then(|i| self.alike[i].get(blend.pair));
        std::array::from_fn(|band| alike.map_or(1.0, |alike| blend.gain(alike[band])))
    }

    /// Factors of the bands that keep the contrast of one frame where `share` of it and the rest of its neighbour are
    /// shown: fine detail would pulse, sharp on the frames of the clip and dull between them.
    fn evens(&self, share: f32, scale: u8) -> [f32; BANDS] {
        let alike = self.scales.iter().position(|&s| s == scale).map(|i| &self.neighbours[i]);
        std::array::from_fn(|band| alike.map_or(1.0, |alike| even(share, alike[band])))
    }
}

/// The first `count` frames of a clip, and their thumbnails.
fn read(pack: &Pack, clip: u32, count: usize, observer: &dyn Observer) -> Result<(Vec<Luma>, Vec<Plane>)> {
    // Runs of frames begin at keyframes, so that none is decoded twice.
    let runs = par::try_map(count.div_ceil(KEYFRAME_EVERY), |run| {
        let mut reader = pack.frames(clip)?;
        let frame = |t: usize| {
            observe::check(observer)?;
            let luma = reader.luma_at(t)?;
            // Two cheap halvings first: most of the cost of a thumbnail is reading the full frame.
            Ok((rounded(&luma), thumbnail(&reduce(&reduce(&luma)))))
        };
        let first = run * KEYFRAME_EVERY;
        (first..(first + KEYFRAME_EVERY).min(count)).map(frame).collect::<Result<Vec<_>>>()
    })?;
    Ok(runs.into_iter().flatten().unzip())
}

/// Most bytes that the loop of `frames` library frames of a clip takes when it is kept.
pub fn loop_bytes(pack: &Pack, clip: u32, frames: usize) -> u64 {
    let meta = &pack.clips()[clip as usize];
    let kept = (meta.frames as usize).min(frames + FADE);
    kept as u64 * u64::from(meta.width) * u64::from(meta.height) * size_of::<u16>() as u64
}

/// Most bytes of the frames that a clip's study holds, for a loop of `frames` library frames.
pub fn study_bytes(pack: &Pack, clip: u32, frames: usize) -> u64 {
    let meta = &pack.clips()[clip as usize];
    searched(meta.frames as usize, frames) as u64
        * u64::from(meta.width)
        * u64::from(meta.height)
        * size_of::<u16>() as u64
}

/// Frames of a clip that a loop of `frames` is looked for in.
fn searched(clip: usize, frames: usize) -> usize {
    clip.min((SEARCHED * frames).max(SEARCHED * FADE))
}

/// The frame after the last one that a loop shows, of a clip of which `searched` frames were looked at.
fn end(plan: &LoopPlan, searched: usize) -> usize {
    let longest = plan.segments().into_iter().max().unwrap_or(0);
    (plan.start() + longest + plan.fade()).min(searched)
}

/// Mean absolute differences of neighbouring frames at full size, where a coder's renewed detail shows.
fn steps(lumas: &[Luma]) -> Vec<f64> {
    let step = |t: usize| absolute_difference(&lumas[t], &lumas[t + 1]) as f64 / lumas[t].len().max(1) as f64;
    par::map(lumas.len().saturating_sub(1), step)
}

#[apply(kernel)]
fn absolute_difference(a: &[u16], b: &[u16]) -> u64 {
    a.iter().zip(b).map(|(&a, &b)| u64::from(a.abs_diff(b))).sum()
}

fn rounded(luma: &Plane) -> Luma {
    let mut out = vec![0; luma.data.len()];
    round(&luma.data, &mut out);
    out
}

#[apply(kernel)]
fn round(luma: &[f32], out: &mut [u16]) {
    out.iter_mut().zip(luma).for_each(|(o, l)| *o = (l * WHITE + 0.5) as u16);
}

/// Adds `weight` times a frame's difference from the average.
#[apply(kernel)]
fn add_difference(sum: &mut [f32], weight: f32, luma: &[u16], average: &[f32]) {
    for ((s, &l), a) in sum.iter_mut().zip(luma).zip(average) {
        *s += weight * (f32::from(l) * (1.0 / WHITE) - a);
    }
}

/// One over the deviation of `share` of one signal and the rest of another, of deviation 1 and so correlated.
fn even(share: f32, correlation: f32) -> f32 {
    let rest = 1.0 - share;
    (share * share + rest * rest + 2.0 * correlation.clamp(0.0, 1.0) * share * rest).sqrt().recip()
}

/// Correlation of two frames' differences, band by band.
fn correlations(a: &Bands, b: &Bands) -> [f32; BANDS] {
    let dot = |a: &Plane, b: &Plane| a.data.iter().zip(&b.data).map(|(a, b)| f64::from(a * b)).sum::<f64>();
    let of = |k: usize| dot(&a[k], &b[k]) / (dot(&a[k], &a[k]) * dot(&b[k], &b[k])).sqrt().max(1e-12);
    std::array::from_fn(|k| of(k) as f32)
}

/// A clip at a phase of its loop.
#[derive(Clone, Copy)]
pub struct Playing<'a> {
    clip: &'a Clip,
    /// Library frames of the loop that it is ahead.
    ahead: usize,
    /// Frames of the output's loop.
    frames: usize,
}

impl<'a> Playing<'a> {
    /// Shows the loop of `clip` once in `frames` output frames, from about the share `phase` of it on (a whole number of
    /// library frames, so that they need not be mixed).
    pub fn new(clip: &'a Clip, phase: f64, frames: usize) -> Self {
        Self { clip, ahead: (phase * clip.plan.length() as f64).round() as usize, frames }
    }

    /// Frames of the loop that make up output frame `t`, with their weights: one, or two neighbours where the output
    /// has another rate than the library.
    fn loop_frames(&self, t: usize) -> [(usize, f32); 2] {
        let length = self.clip.plan.length();
        let place = t as f64 / self.frames as f64 * length as f64 + self.ahead as f64;
        let first = (place + 1e-6).floor();
        let share = (place - first).max(0.0) as f32;
        let share = if share < 1e-4 { 0.0 } else { share };
        [(first as usize, 1.0 - share), (first as usize + 1, share)]
    }

    /// How the motion in output frame `t` differs from its mean over the loop, pixels of the clip per output frame, on
    /// cells of [`crate::library::variant::CELL`] of them; none where it was not wanted.
    pub fn fluctuation(&self, t: usize) -> Option<Field> {
        let Clip { plan, motion, .. } = self.clip;
        let motion = motion.as_ref()?;
        let pace = plan.length() as f32 / self.frames as f32;
        let mut sum = Field { u: motion.mean.u.map(|u| -pace * u), v: motion.mean.v.map(|v| -pace * v) };
        for (place, share) in self.loop_frames(t).into_iter().filter(|shown| shown.1 > 0.0) {
            motion.add(&plan.at(place), pace * share, plan.start(), &mut sum);
        }
        Some(sum)
    }
}

/// Motion of a loop's frames on cells, pixels of the clip per library frame.
struct Motion {
    /// From each frame, from the loop's start on, to the next.
    steps: Vec<Vec<[f16; 2]>>,
    /// Over the loop.
    mean: Field,
}

impl Motion {
    /// TV-L1 on a quarter of the size, where a pixel is a cell: motion finer than that would not be used, and it is a
    /// sixteenth of the work.
    fn estimate(lumas: &[Luma], (width, height): (usize, usize), plan: &LoopPlan) -> Self {
        let small = |luma: &Luma| {
            let white = luma.iter().map(|l| f32::from(*l) * (1.0 / WHITE)).collect();
            reduce(&reduce(&Plane::from_vec(width, height, white)))
        };
        let small = par::map(lumas.len(), |t| small(&lumas[t]));
        let runs = par::map((lumas.len() - 1).div_ceil(MOTION_RUN), |run| {
            let mut solver = TvL1::new(small[0].width, small[0].height, Params::library());
            let steps = (run * MOTION_RUN..((run + 1) * MOTION_RUN).min(lumas.len() - 1)).map(|t| {
                let mut flow = Field::default();
                solver.flow(&small[t], &small[t + 1], &mut flow);
                let cell = |(u, v): (&f32, &f32)| [u, v].map(|v| f16::from_f32(CELL as f32 * v));
                flow.u.data.iter().zip(&flow.v.data).map(cell).collect::<Vec<_>>()
            });
            steps.collect::<Vec<_>>()
        });
        let mut steps: Vec<Vec<[f16; 2]>> = runs.into_iter().flatten().collect();
        // What comes after the last frame is not known; it goes on as before.
        steps.extend(steps.last().cloned());
        let mut motion = Self { steps, mean: Field::default() };
        let mut mean = Field::zeros(small[0].width, small[0].height);
        for t in 0..plan.length() {
            motion.add(&plan.at(t), 1.0 / plan.length() as f32, plan.start(), &mut mean);
        }
        motion.mean = mean;
        motion
    }

    /// Adds `weight` times the motion of a blend; `start` is the clip's frame that the first step begins with.
    fn add(&self, blend: &Blend, weight: f32, start: usize, sum: &mut Field) {
        for part in [Some(blend.a), blend.b].into_iter().flatten() {
            let sums = sum.u.data.iter_mut().zip(&mut sum.v.data);
            for ((u, v), step) in sums.zip(&self.steps[part.frame - start]) {
                *u += weight * part.weight * step[0].to_f32();
                *v += weight * part.weight * step[1].to_f32();
            }
        }
    }

    fn bytes(&self) -> usize {
        self.steps.len() * self.mean.u.data.len() * size_of::<[f16; 2]>()
    }
}

/// A clip that is being read forwards.
pub struct Stream<'a> {
    playing: Playing<'a>,
    scales: Vec<u8>,
    readers: Mutex<[FrameReader<'a>; 2]>,
}

impl<'a> Stream<'a> {
    /// Reads what is played, at `scales` (ascending).
    ///
    /// # Errors
    /// A damaged pack.
    pub fn new(playing: Playing<'a>, scales: Vec<u8>) -> Result<Self> {
        let Clip { pack, clip, .. } = playing.clip;
        let readers = Mutex::new([pack.frames(*clip)?, pack.frames(*clip)?]);
        Ok(Self { playing, scales, readers })
    }

    /// What output frame `t` is made of; cheapest in order of `t`.
    fn mixture(&self, t: usize) -> Result<Mixture> {
        let shown = self.playing.loop_frames(t).into_iter().filter(|f| f.1 > 0.0);
        let part = |(place, share)| {
            let blend = self.playing.clip.plan.at(place);
            Ok((blend, share, self.differences(&blend)?))
        };
        Ok(Mixture(shown.map(part).collect::<Result<_>>()?))
    }

    /// Its bands, for every scale that is used.
    fn bands(&self, Mixture(parts): &Mixture) -> Vec<Bands> {
        let of_scale = |&scale: &u8| {
            let evens = self.playing.clip.evens(parts[0].1, scale);
            let scaled = parts.iter().map(|(blend, share, differences)| {
                let gains = self.playing.clip.gains(blend, scale);
                let gains = std::array::from_fn(|band| share * evens[band] * gains[band]);
                times(level_bands(differences, self.playing.clip.size, scale), gains)
            });
            scaled.reduce(plus).expect("an output frame shows some library frame")
        };
        self.scales.iter().map(of_scale).collect()
    }

    /// The plain sum of a blend's frames as differences from the average.
    fn differences(&self, blend: &Blend) -> Result<Plane> {
        let mut sum = Plane::zeros(self.playing.clip.size.0, self.playing.clip.size.1);
        let average = &self.playing.clip.average.data;
        for (number, Part { frame, weight }) in [Some(blend.a), blend.b].into_iter().flatten().enumerate() {
            match self.playing.clip.kept(frame) {
                Some(luma) => add_difference(&mut sum.data, weight, luma, average),
                None => {
                    // A reader holds nothing that an earlier panic could have left half-done: it seeks from a keyframe.
                    let mut readers = self.readers.lock().unwrap_or_else(PoisonError::into_inner);
                    let luma = rounded(&readers[number].luma_at(frame)?);
                    add_difference(&mut sum.data, weight, &luma, average);
                }
            }
        }
        Ok(sum)
    }
}

/// The library frames that an output frame shows, with their shares, each as differences from the average: one, or two
/// where the output has another rate.
struct Mixture(Vec<(Blend, f32, Plane)>);

fn times(mut bands: Bands, factors: [f32; BANDS]) -> Bands {
    for (band, factor) in bands.iter_mut().zip(factors).filter(|(_, f)| *f != 1.0) {
        band.data.iter_mut().for_each(|v| *v *= factor);
    }
    bands
}

fn plus(mut sum: Bands, bands: Bands) -> Bands {
    for (sum, band) in sum.iter_mut().zip(&bands) {
        sum.data.iter_mut().zip(&band.data).for_each(|(s, b)| *s += b);
    }
    sum
}

/// The bands of all streams for the output frames `frames` (ascending), frame by frame, the levels of a frame ordered by
/// stream and scale (the order of [`crate::render::layout::Layout::levels`]).
///
/// # Errors
/// A damaged pack, a cancel.
pub fn bands_of(streams: &[Stream], frames: &[usize], observer: &dyn Observer) -> Result<Vec<Vec<Bands>>> {
    let by_stream = par::try_map(streams.len(), |s| {
        // A clip's frames are read one after another, their bands made side by side.
        let mixture = |&t: &usize| observe::check(observer).and_then(|()| streams[s].mixture(t));
        let mixtures = frames.iter().map(mixture).collect::<Result<Vec<_>>>()?;
        Ok(par::map(mixtures.len(), |i| streams[s].bands(&mixtures[i])))
    })?;
    let mut by_frame: Vec<Vec<Bands>> = frames.iter().map(|_| Vec::new()).collect();
    for stream in by_stream {
        for (frame, levels) in by_frame.iter_mut().zip(stream) {
            frame.extend(levels);
        }
    }
    Ok(by_frame)
}

/// Bytes of one output frame's bands, and of the one or two frames per stream that they are made from.
pub fn frame_bytes(streams: &[Stream]) -> usize {
    let mixed: usize =
        streams.iter().map(|s| 2 * s.playing.clip.size.0 * s.playing.clip.size.1 * size_of::<f32>()).sum();
    let level = |clip: &Clip, scale: u8| {
        let (w, h) = level_size(clip.size.0, clip.size.1, scale);
        w * h * size_of::<f32>() * 4 / 3
    };
    mixed
        + streams
            .iter()
            .map(|s| s.scales.iter().map(|&scale| level(s.playing.clip, scale)).sum::<usize>())
            .sum::<usize>()
}

/// Bytes of the frames that are kept.
pub fn kept_bytes(clips: &[Clip]) -> u64 {
    let bytes = |clip: &Clip| {
        let frames = clip.kept.as_ref().map_or(0, |kept| kept.len() * clip.size.0 * clip.size.1 * size_of::<u16>());
        frames + clip.motion.as_ref().map_or(0, Motion::bytes)
    };
    clips.iter().map(bytes).sum::<usize>() as u64
}

/// Average of the frames of a loop, each as often as it is shown, so that the differences have mean 0 over the loop.
fn loop_average(plan: &LoopPlan, lumas: &[Luma], size: (usize, usize)) -> Plane {
    let mut weights = vec![0.0f32; lumas.len()];
    for t in 0..plan.length() {
        let blend = plan.at(t);
        [Some(blend.a), blend.b].into_iter().flatten().for_each(|part| weights[part.frame] += part.weight);
    }
    let total = WHITE * weights.iter().sum::<f32>();
    let mut average = Plane::zeros(size.0, size.1);
    for (luma, &weight) in lumas.iter().zip(&weights).filter(|(_, w)| **w > 0.0) {
        average.data.iter_mut().zip(luma).for_each(|(a, &l)| *a += weight / total * f32::from(l));
    }
    average
}

fn level_bands(differences: &Plane, size: (usize, usize), scale: u8) -> Bands {
    let (width, height) = level_size(size.0, size.1, scale);
    bands(&resize(differences, width, height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{hash, unit};

    #[test]
    fn between_frames_contrast_is_kept() {
        let frame = |seed: u64| bands(&Plane::from_fn(64, 64, |x, y| unit(hash(seed, &[x as u64, y as u64])) - 0.5));
        let power = |b: &Plane| b.data.iter().map(|v| v * v).sum::<f32>();
        let (a, b) = (frame(1), frame(2));
        let alike = correlations(&a, &b);
        for band in 0..2 {
            let gain = even(0.5, alike[band]);
            let mixed = plus(times(a.clone(), [0.5 * gain; BANDS]), times(b.clone(), [0.5 * gain; BANDS]));
            let ratio = power(&mixed[band]) / power(&a[band]);
            assert!((0.9..1.1).contains(&ratio), "band {band}: {ratio}");
        }
        assert_eq!((even(1.0, 0.3), even(0.5, 1.0)), (1.0, 1.0));
    }
}
