//! The frames of the clips that are used: looped, as differences from their average, and split into bands.

use std::sync::{Arc, Mutex, PoisonError};

use crate::base::error::Result;
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::library::reader::{FrameReader, Pack};
use crate::library::variant::level_size;
use crate::raster::image::Plane;
use crate::raster::pyramid::reduce;
use crate::raster::resample::resize;
use crate::render::blend::{Bands, bands};
use crate::render::contrast::Variance;
use crate::render::layout::BANDS;
use crate::video::looping::{Blend, Distances, LoopPlan, Part, plan_loop, thumbnail};

/// Most frames of a cross-fade where a loop closes.
const FADE: usize = 20;
/// A loop is looked for in the clip's first frames, this many times the frames of the output.
const SEARCHED: usize = 2;
/// Every so many frames are measured for the strength of the differences.
const SAMPLE_STEP: usize = 8;
/// Pairs of neighbouring frames that are compared.
const PAIRS: usize = 3;

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
    variance: Vec<Variance>,
    /// Per used scale and jump of the loop: how alike the two frames in the middle of the fade are, band by band.
    alike: Vec<Vec<[f32; BANDS]>>,
    /// Per used scale: how alike neighbouring frames are, band by band.
    neighbours: Vec<[f32; BANDS]>,
}

impl Clip {
    /// Reads the clip once: finds its loop of `frames` library frames and measures its differences at `scales`.
    ///
    /// The differences are from the average of the frames that the loop shows, not of the whole clip: what stands still
    /// in the loop but moved at another time (a twig, the light) would otherwise stay as a ghost in every frame.
    ///
    /// # Errors
    /// A damaged pack, a clip that cannot be looped, a cancel.
    pub fn study(pack: &Arc<Pack>, clip: u32, scales: Vec<u8>, frames: usize, observer: &dyn Observer) -> Result<Self> {
        let meta = &pack.clips()[clip as usize];
        let size = (meta.width as usize, meta.height as usize);
        let searched = (meta.frames as usize).min((SEARCHED * frames).max(SEARCHED * FADE));
        let mut lumas = Vec::with_capacity(searched);
        let mut thumbnails = Vec::with_capacity(searched);
        let mut reader = pack.frames(clip)?;
        for t in 0..searched {
            observe::check(observer)?;
            let luma = reader.luma_at(t)?;
            // Two cheap halvings first: most of the cost of a thumbnail is reading the full frame.
            thumbnails.push(thumbnail(&reduce(&reduce(&luma))));
            lumas.push(luma.data.iter().map(|l| (l * 255.0 + 0.5) as u8).collect::<Vec<u8>>());
        }
        let plan = plan_loop(&Distances::between(&thumbnails), frames, FADE)?;
        let average = loop_average(&plan, &lumas, size);
        let of_frame = |frame: usize, scale: u8| {
            let luma = lumas[frame].iter().map(|&l| f32::from(l) / 255.0).collect();
            level_bands(&minus(Plane::from_vec(size.0, size.1, luma), &average), size, scale)
        };
        let mut variance = vec![Variance::default(); scales.len()];
        for t in (0..frames).step_by(SAMPLE_STEP) {
            for (variance, &scale) in variance.iter_mut().zip(&scales) {
                variance.add(&of_frame(plan.at(t).a.frame, scale));
            }
        }
        let likeness = |&(a, b): &(usize, usize), scale| correlations(&of_frame(a, scale), &of_frame(b, scale));
        let alike = |&scale: &u8| plan.middle().iter().map(|pair| likeness(pair, scale)).collect();
        let alike = scales.iter().map(alike).collect();
        let pairs: Vec<(usize, usize)> =
            (0..PAIRS).map(|k| plan.at(k * frames / PAIRS).a.frame).map(|f| (f, f + 1)).collect();
        let pairs = || pairs.iter().filter(|p| p.1 < searched);
        let mean = |all: Vec<[f32; BANDS]>| {
            std::array::from_fn(|b| all.iter().map(|a| a[b]).sum::<f32>() / all.len().max(1) as f32)
        };
        let neighbours =
            scales.iter().map(|&scale| mean(pairs().map(|pair| likeness(pair, scale)).collect())).collect();
        Ok(Self { pack: pack.clone(), clip, size, scales, average, plan, variance, alike, neighbours })
    }

    /// How strong its differences are at one of the scales it was studied at.
    pub fn variance(&self, scale: u8) -> Option<&Variance> {
        self.scales.iter().position(|&s| s == scale).map(|i| &self.variance[i])
    }

    /// Factors of the bands that keep the contrast through a cross-fade: fine detail is unlike between two frames whose
    /// coarse forms are still alike, so each band has its own.
    fn gains(&self, blend: &Blend, scale: u8) -> [f32; BANDS] {
        let alike = self.scales.iter().position(|&s| s == scale).and_then(|i| self.alike[i].get(blend.jump));
        std::array::from_fn(|band| alike.map_or(1.0, |alike| blend.gain(alike[band])))
    }

    /// Factors of the bands that keep the contrast of one frame where `share` of it and the rest of its neighbour are
    /// shown: fine detail would pulse, sharp on the frames of the clip and dull between them.
    fn evens(&self, share: f32, scale: u8) -> [f32; BANDS] {
        let alike = self.scales.iter().position(|&s| s == scale).map(|i| &self.neighbours[i]);
        std::array::from_fn(|band| alike.map_or(1.0, |alike| even(share, alike[band])))
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

/// A clip at a phase of its loop, being read forwards.
pub struct Stream<'a> {
    clip: &'a Clip,
    /// Library frames of the loop that it is ahead.
    ahead: usize,
    /// Frames of the output's loop.
    frames: usize,
    scales: Vec<u8>,
    readers: Mutex<[FrameReader<'a>; 2]>,
}

impl<'a> Stream<'a> {
    /// Shows the loop of `clip` once in `frames` output frames, at `scales` (ascending), from about the share `phase` of
    /// it on (a whole number of library frames, so that they need not be mixed).
    ///
    /// # Errors
    /// A damaged pack.
    pub fn new(clip: &'a Clip, phase: f64, frames: usize, scales: Vec<u8>) -> Result<Self> {
        let readers = Mutex::new([clip.pack.frames(clip.clip)?, clip.pack.frames(clip.clip)?]);
        let ahead = (phase * clip.plan.length() as f64).round() as usize;
        Ok(Self { clip, ahead, frames, scales, readers })
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

    /// The bands of output frame `t`, for every scale that is used; cheapest in order of `t`.
    fn bands(&self, t: usize) -> Result<Vec<Bands>> {
        let shown: Vec<_> = self.loop_frames(t).into_iter().filter(|f| f.1 > 0.0).collect();
        let blends: Vec<_> = shown.iter().map(|&(place, share)| (self.clip.plan.at(place), share)).collect();
        let differences = blends.iter().map(|(blend, _)| self.differences(blend)).collect::<Result<Vec<_>>>()?;
        let of_scale = |&scale: &u8| {
            let evens = self.clip.evens(shown[0].1, scale);
            let scaled = blends.iter().zip(&differences).map(|((blend, share), differences)| {
                let gains = self.clip.gains(blend, scale);
                let gains = std::array::from_fn(|band| share * evens[band] * gains[band]);
                times(level_bands(differences, self.clip.size, scale), gains)
            });
            scaled.reduce(plus).expect("an output frame shows some library frame")
        };
        Ok(self.scales.iter().map(of_scale).collect())
    }

    /// The plain sum of a blend's frames as differences from the average.
    fn differences(&self, blend: &Blend) -> Result<Plane> {
        // A reader holds nothing that an earlier panic could have left half-done: it seeks from a keyframe.
        let mut readers = self.readers.lock().unwrap_or_else(PoisonError::into_inner);
        let mut sum = Plane::zeros(self.clip.size.0, self.clip.size.1);
        let parts = [Some(blend.a), blend.b].into_iter().flatten();
        for (reader, Part { frame, weight }) in readers.iter_mut().zip(parts) {
            let luma = reader.luma_at(frame)?;
            for ((s, l), a) in sum.data.iter_mut().zip(&luma.data).zip(&self.clip.average.data) {
                *s += weight * (l - a);
            }
        }
        Ok(sum)
    }
}

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

/// The bands of all streams for the output frames `range`, frame by frame, the levels of a frame ordered by stream and
/// scale (the order of [`crate::render::layout::Layout::levels`]).
///
/// # Errors
/// A damaged pack, a cancel.
pub fn bands_of(streams: &[Stream], range: std::ops::Range<usize>, observer: &dyn Observer) -> Result<Vec<Vec<Bands>>> {
    let by_stream = par::try_map(streams.len(), |s| {
        let of = |t| observe::check(observer).and_then(|()| streams[s].bands(t));
        range.clone().map(of).collect::<Result<Vec<_>>>()
    })?;
    let mut by_frame: Vec<Vec<Bands>> = range.map(|_| Vec::new()).collect();
    for stream in by_stream {
        for (frame, levels) in by_frame.iter_mut().zip(stream) {
            frame.extend(levels);
        }
    }
    Ok(by_frame)
}

/// Bytes of the bands of one output frame.
pub fn frame_bytes(streams: &[Stream]) -> usize {
    let level = |clip: &Clip, scale: u8| {
        let (w, h) = level_size(clip.size.0, clip.size.1, scale);
        w * h * size_of::<f32>() * 4 / 3
    };
    streams.iter().map(|s| s.scales.iter().map(|&scale| level(s.clip, scale)).sum::<usize>()).sum()
}

/// Average of the frames of a loop, each as often as it is shown, so that the differences have mean 0 over the loop.
fn loop_average(plan: &LoopPlan, lumas: &[Vec<u8>], size: (usize, usize)) -> Plane {
    let mut weights = vec![0.0f32; lumas.len()];
    for t in 0..plan.length() {
        let blend = plan.at(t);
        [Some(blend.a), blend.b].into_iter().flatten().for_each(|part| weights[part.frame] += part.weight);
    }
    let total = 255.0 * weights.iter().sum::<f32>();
    let mut average = Plane::zeros(size.0, size.1);
    for (luma, &weight) in lumas.iter().zip(&weights).filter(|(_, w)| **w > 0.0) {
        average.data.iter_mut().zip(luma).for_each(|(a, &l)| *a += weight / total * f32::from(l));
    }
    average
}

fn minus(mut plane: Plane, other: &Plane) -> Plane {
    plane.data.iter_mut().zip(&other.data).for_each(|(p, o)| *p -= o);
    plane
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
