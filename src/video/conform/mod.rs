//! From a clip as it was filmed to frames as the library wants them: upright, without bars and duplicates, at the
//! working size and the library's rate. Streamed: a handful of frames in memory, whatever the clip's length.

pub mod bars;
pub mod clock;
pub mod repeats;
pub mod scale;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use bars::{Bars, Crop};
use clock::Clock;

use super::clip::{RawFrame, Source, Turn};
use super::read::source::{self, Decoder};
use crate::base::error::{Error, Kind, Result};
use crate::raster::image::Rgb8;
use scale::{Scaler, Window};

/// Working sizes are multiples of this, so that SIFT grids coincide under flips and scales.
const MULTIPLE: usize = 16;
/// Frames of the first look at a clip.
const LOOK: usize = 50;
/// Frames after which the look ends though all was dark.
const LONG_LOOK: usize = 500;

/// How clips are brought to one form.
#[derive(Debug, Clone, PartialEq)]
pub struct ConformOptions {
    /// Frames per second at which the library plays clips.
    pub rate: f64,
    /// Longest side of the working size in pixels; smaller clips are not enlarged.
    pub long_side: usize,
    /// Which decoders may be used.
    pub decoder: Decoder,
}

impl Default for ConformOptions {
    fn default() -> Self {
        Self { rate: 25.0, long_side: 640, decoder: Decoder::Auto }
    }
}

/// What was found and done; complete after the last frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ConformReport {
    /// Stored size in pixels, before rotation.
    pub source: (usize, usize),
    /// Codec, for people.
    pub codec: String,
    /// Which decoder read it.
    pub decoder: &'static str,
    /// Rotation applied.
    pub turn: Turn,
    /// What the black bars left, in stored pixels; `None` without bars.
    pub black_bars: Option<Crop>,
    /// Size of the frames given out: multiples of 16, after rotation.
    pub working: (usize, usize),
    /// Average frames per second of the source.
    pub source_rate: f64,
    /// Whether more than 2 % of the source's frames last 20 % longer or shorter than most.
    pub variable_rate: bool,
    /// Frames decoded.
    pub frames_read: usize,
    /// Near-duplicates among them that were removed.
    pub duplicates_removed: usize,
    /// Frames left out to come near the library's rate: one in n is kept, see [`clock`].
    pub frames_dropped: usize,
    /// Frames given out.
    pub frames_out: usize,
    /// How much faster than filmed the frames given out play at the library's rate: 1.04 for 24 frames a second taken as
    /// 25, 0.83 for 30.
    pub speed: f64,
}

/// What the first look at a clip tells.
struct Look {
    size: (usize, usize),
    crop: Option<Crop>,
    /// Threshold of [`repeats::difference`] for duplicates.
    same: f32,
    /// Median seconds between frames.
    period: f64,
}

/// A frame that waits until the frames after it tell whether it is a duplicate.
struct Waiting {
    image: Rgb8,
    luma: Vec<u8>,
    time_ns: u64,
    /// Difference from the source's frame before it; infinite for the first.
    step: f32,
}

/// The frame kept last.
struct Kept {
    luma: Vec<u8>,
    time_ns: u64,
    step: f32,
}

/// A clip in the library's form, read frame by frame.
pub struct Conformed {
    path: PathBuf,
    source: Box<dyn Source>,
    scaler: Scaler,
    same: f32,
    clock: Clock<Rgb8>,
    waiting: VecDeque<Waiting>,
    kept: Option<Kept>,
    /// Duplicates since.
    removed: usize,
    first_ns: u64,
    last_ns: u64,
    gaps: Vec<f32>,
    failure: Option<Error>,
    over: bool,
    report: ConformReport,
}

impl Conformed {
    /// Opens a clip and takes a first look at it (bars, size, noise).
    ///
    /// # Errors
    /// When it cannot be read, has no frames or is smaller than 16 × 16 pixels.
    pub fn open(path: &Path, options: &ConformOptions) -> Result<Self> {
        let look = look(path, options)?;
        let source = source::open_with(path, options.decoder)?;
        let info = source.info();
        let (window, working) = window(&look, info.turn, options.long_side).ok_or_else(|| {
            let (w, h) = look.crop.map_or(look.size, |c| (c.width, c.height));
            Error::file(Kind::Unusable, path, format!("{w} × {h} pixels are too small"))
                .allowed(format!("at least {MULTIPLE} × {MULTIPLE}"))
        })?;
        let report = ConformReport {
            source: look.size,
            codec: info.codec.clone(),
            decoder: info.decoder,
            turn: info.turn,
            black_bars: look.crop,
            working,
            source_rate: 1.0 / look.period,
            variable_rate: false,
            frames_read: 0,
            duplicates_removed: 0,
            frames_dropped: 0,
            frames_out: 0,
            speed: 1.0,
        };
        Ok(Self {
            path: path.to_path_buf(),
            source,
            scaler: Scaler::new(look.size.0, look.size.1, window),
            same: look.same,
            clock: Clock::new(options.rate, look.period),
            waiting: VecDeque::new(),
            kept: None,
            removed: 0,
            first_ns: 0,
            last_ns: 0,
            gaps: Vec::new(),
            failure: None,
            over: false,
            report,
        })
    }

    /// The next frame at the library's rate, of size [`ConformReport::working`]; `None` after the last.
    ///
    /// # Errors
    /// When the clip is damaged; all frames before the damage were given out.
    pub fn next_frame(&mut self) -> Result<Option<Rgb8>> {
        loop {
            if let Some(frame) = self.clock.pop() {
                self.report.frames_out += 1;
                self.report.speed = self.clock.speed();
                return Ok(Some(turned(frame, self.report.turn)));
            }
            if self.over {
                self.complete();
                return self.failure.take().map_or(Ok(None), Err);
            }
            match self.source.next_frame() {
                Ok(Some(frame)) => self.failure = self.take(&frame).err(),
                Ok(None) => self.over = true,
                Err(failure) => self.failure = Some(failure),
            }
            if self.over || self.failure.is_some() {
                self.over = true;
                while self.sort_out() {}
                self.clock.finish();
            }
        }
    }

    /// What was found so far; complete after the last frame.
    pub fn report(&self) -> &ConformReport {
        &self.report
    }

    fn take(&mut self, frame: &RawFrame) -> Result<()> {
        if (frame.width, frame.height) != self.report.source {
            let (w, h) = self.report.source;
            let problem = format!("frame {} has {} × {} pixels", self.report.frames_read, frame.width, frame.height);
            return Err(Error::file(Kind::Data, &self.path, problem)
                .allowed(format!("{w} × {h}, as its first frame"))
                .remedy("split the clip where its size changes"));
        }
        if self.report.frames_read == 0 {
            (self.first_ns, self.last_ns) = (frame.time_ns, frame.time_ns);
        } else {
            self.gaps.push(seconds(self.last_ns, frame.time_ns) as f32);
            self.last_ns = frame.time_ns.max(self.last_ns);
        }
        self.report.frames_read += 1;
        let image = self.scaler.apply(frame);
        let luma = repeats::luma(&image);
        let before = self.waiting.back().map(|w| &w.luma);
        let step = before.map_or(f32::INFINITY, |b| repeats::difference(b, &luma, image.width));
        self.waiting.push_back(Waiting { image, luma, time_ns: frame.time_ns, step });
        if self.waiting.len() > repeats::AHEAD {
            self.sort_out();
        }
        Ok(())
    }

    /// Decides whether the frame that waits longest is a duplicate, and hands it on if not; `false` when none waits.
    fn sort_out(&mut self) -> bool {
        let Some(frame) = self.waiting.pop_front() else { return false };
        let after = self.waiting.iter().map(|w| w.step);
        let same = self.kept.as_ref().is_some_and(|kept| {
            repeats::difference(&kept.luma, &frame.luma, frame.image.width) < self.same
                || repeats::is_dip(frame.step, kept.step, after)
        });
        if same {
            self.removed += 1;
            self.report.duplicates_removed += 1;
            return true;
        }
        let before = self.kept.as_ref().map_or(frame.time_ns, |kept| kept.time_ns);
        self.clock.push(frame.image, seconds(before, frame.time_ns), std::mem::take(&mut self.removed));
        self.kept = Some(Kept { luma: frame.luma, time_ns: frame.time_ns, step: frame.step });
        true
    }

    fn complete(&mut self) {
        let span = seconds(self.first_ns, self.last_ns);
        if self.report.frames_read > 1 && span > 0.0 {
            self.report.source_rate = (self.report.frames_read - 1) as f64 / span;
        }
        let typical = median(&self.gaps);
        let odd = self.gaps.iter().filter(|g| (*g - typical).abs() > (0.2 * typical).max(0.002)).count();
        self.report.variable_rate = odd * 50 > self.gaps.len();
        self.report.frames_dropped = self.clock.dropped();
    }
}

fn seconds(from_ns: u64, to_ns: u64) -> f64 {
    to_ns.saturating_sub(from_ns) as f64 * 1e-9
}

fn median(values: &[f32]) -> f32 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f32::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Reads the clip's first frames (all of them when bars were seen, to be sure that they are constant).
fn look(path: &Path, options: &ConformOptions) -> Result<Look> {
    let mut source = source::open_with(path, options.decoder)?;
    let first = source.next_frame()?.ok_or_else(|| {
        Error::file(Kind::Data, path, "the clip has no frames").remedy("check that it is a video that plays")
    })?;
    let size = (first.width, first.height);
    let mut bars = Bars::new(size.0, size.1);
    let mut scaler = Scaler::new(size.0, size.1, small(size, options.long_side));
    let (mut before, mut differences, mut gaps) = (None, Vec::new(), Vec::new());
    let mut last_ns = first.time_ns;
    let mut next = Some(first);
    let mut count = 0;
    while let Some(frame) = next.filter(|f| (f.width, f.height) == size) {
        bars.add(&frame);
        count += 1;
        if count <= LOOK {
            let image = scaler.apply(&frame);
            let luma = repeats::luma(&image);
            differences.extend(before.map(|b: Vec<u8>| repeats::difference(&b, &luma, image.width)));
            before = Some(luma);
            gaps.push(seconds(last_ns, frame.time_ns) as f32);
            last_ns = frame.time_ns;
        }
        let enough = count >= LONG_LOOK || count >= LOOK && bars.is_decided();
        if enough && bars.crop().is_none() {
            break;
        }
        // Damage met here is met again, and told, when the frames are read in earnest.
        next = source.next_frame().unwrap_or(None);
    }
    let period = f64::from(median(gaps.get(1..).unwrap_or_default()));
    Ok(Look {
        size,
        crop: bars.crop(),
        same: repeats::threshold(differences),
        period: if period > 0.0 { period } else { 1.0 / options.rate },
    })
}

/// A window on the whole frame, shrunk to the working size.
fn small((width, height): (usize, usize), long_side: usize) -> Window {
    let step = (width.max(height) as f64 / long_side as f64).max(1.0);
    let shrunk = |n: usize| ((n as f64 / step) as usize).max(1);
    Window { left: 0.0, top: 0.0, step, width: shrunk(width), height: shrunk(height) }
}

/// The part of the frame that is kept, and its size after rotation: what the bars left, shrunk to the long side and
/// cut to multiples of 16 about its centre.
fn window(look: &Look, turn: Turn, long_side: usize) -> Option<(Window, (usize, usize))> {
    let crop = look.crop.unwrap_or(Crop { x: 0, y: 0, width: look.size.0, height: look.size.1 });
    let step = (crop.width.max(crop.height) as f64 / long_side as f64).max(1.0);
    let kept = |n: usize| ((n as f64 / step + 1e-6) as usize) / MULTIPLE * MULTIPLE;
    let (width, height) = (kept(crop.width), kept(crop.height));
    if width == 0 || height == 0 {
        return None;
    }
    let margin = |source: usize, out: usize| {
        let margin = (source as f64 - out as f64 * step) / 2.0;
        // Unscaled pixels stay as they are: no half-pixel shifts.
        if step == 1.0 { margin.floor() } else { margin }
    };
    let left = crop.x as f64 + margin(crop.width, width);
    let top = crop.y as f64 + margin(crop.height, height);
    let upright = if matches!(turn, Turn::Right | Turn::Left) { (height, width) } else { (width, height) };
    Some((Window { left, top, step, width, height }, upright))
}

/// `image` turned clockwise.
pub fn turned(image: Rgb8, turn: Turn) -> Rgb8 {
    let (w, h) = (image.width, image.height);
    let pixels = image.data.chunks_exact(3);
    match turn {
        Turn::None => image,
        Turn::Half => Rgb8 { width: w, height: h, data: pixels.rev().flatten().copied().collect() },
        Turn::Right | Turn::Left => {
            let from = |x: usize, y: usize| if turn == Turn::Right { (y, h - 1 - x) } else { (w - 1 - y, x) };
            let source = (0..w).flat_map(|y| (0..h).map(move |x| (x, y))).map(|(x, y)| from(x, y));
            let data = source.flat_map(|(x, y)| image.pixel(x, y)).collect();
            Rgb8 { width: h, height: w, data }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_clockwise_and_four_quarters_are_none() {
        let image = Rgb8 { width: 3, height: 2, data: (0..18).collect() };
        let right = turned(image.clone(), Turn::Right);
        assert_eq!((right.width, right.height), (2, 3));
        // The top left corner goes to the top right.
        assert_eq!(right.pixel(1, 0), image.pixel(0, 0));
        assert_eq!(right.pixel(0, 0), image.pixel(0, 1));
        assert_eq!(turned(right.clone(), Turn::Left), image);
        assert_eq!(turned(right.clone(), Turn::Right), turned(image.clone(), Turn::Half));
        assert_eq!(turned(turned(image.clone(), Turn::Half), Turn::Half), image);
    }

    #[test]
    fn working_sizes_are_multiples_of_16_and_never_enlarged() {
        let size = |w, h, turn| {
            let look = Look { size: (w, h), crop: None, same: 1.0, period: 0.04 };
            window(&look, turn, 640).map(|(window, working)| (window.step, working))
        };
        assert_eq!(size(1280, 720, Turn::None), Some((2.0, (640, 352))));
        assert_eq!(size(640, 360, Turn::None), Some((1.0, (640, 352))));
        assert_eq!(size(426, 240, Turn::None), Some((1.0, (416, 240))));
        assert_eq!(size(1920, 1080, Turn::Right), Some((3.0, (352, 640))));
        assert_eq!(size(15, 400, Turn::None), None);
    }
}
