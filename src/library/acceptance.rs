//! Whether a clip can serve the library: steady camera, no cut or fade, something moving, long and large enough.

use std::fmt;
use std::ops::Range;

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::base::text::counted;
use crate::raster::image::Rgb8;
use crate::raster::resample;

use super::analyse::{Frames, MIN_FRAMES};
use super::camera::{self, Pose, STEP, Segment, Tracker};
use super::changes::{Change, Thumbnails};
use super::options::RATE;
use super::variant::PIECE;

/// Largest motion of the camera that still leaves a sharp mean picture, working pixels over the frames used.
pub const CAMERA_TOLERANCE: f32 = 3.0;
/// Fewest different frames per second: below, motion between them is too large to follow.
pub const MIN_RATE: f32 = 12.0;

/// Why a clip, or a part of it, cannot be used.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// The camera moves: largest distance between two of its positions, in pixels of the working size.
    CameraMoves {
        /// That distance, over the measured frames.
        pixels: f32,
        /// Frames over which it was measured.
        frames: Range<usize>,
    },
    /// The whole picture changes at once: a cut, at this frame.
    Cut {
        /// First frame after it.
        frame: usize,
    },
    /// The whole picture changes within a second: a fade or cross-fade.
    Fade {
        /// Frames it takes.
        frames: Range<usize>,
    },
    /// The picture stands still for a second or more.
    Frozen {
        /// Those frames.
        frames: Range<usize>,
    },
    /// Fewer than [`MIN_FRAMES`] frames.
    TooShort {
        /// Frames there are, at 25 frames/s.
        frames: usize,
    },
    /// The picture has no room for pieces.
    TooSmall {
        /// Working width in pixels.
        width: usize,
        /// Working height in pixels.
        height: usize,
    },
    /// No area as large as a piece changes more than noise does.
    NothingMoves {
        /// Share of the picture that changes.
        share: f32,
    },
    /// Too few different frames per second.
    RateTooLow {
        /// Different frames per second.
        rate: f32,
    },
}

/// How the camera was judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Camera {
    /// Background was followed: largest distance between two camera positions, pixels of the working size.
    Measured {
        /// That distance.
        pixels: f32,
        /// Share of the clip's frames in which background could be followed.
        coverage: f32,
    },
    /// No background stays recognisable for long (the fluid fills the frame); the clip is taken as steady.
    NotMeasurable,
}

/// The judgement of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Frames read.
    pub frames: usize,
    /// The camera.
    pub camera: Camera,
    /// Share of the picture that changes more than noise does.
    pub moving: f32,
    /// What is wrong with the whole clip; empty when it can be used from end to end.
    pub reasons: Vec<Reason>,
    /// Longest stretch of at least [`MIN_FRAMES`] frames without any of the faults; the whole clip when accepted,
    /// `None` when refused.
    pub usable: Option<Range<usize>>,
}

impl Report {
    /// True when the whole clip can be used.
    pub fn accepted(&self) -> bool {
        self.reasons.is_empty()
    }

    /// The judgement once the rate of the source is known, different frames per second: repeated frames may have been
    /// removed before the clip came here.
    pub fn at_source_rate(mut self, rate: f32) -> Self {
        if rate < MIN_RATE && !self.reasons.iter().any(|reason| matches!(reason, Reason::RateTooLow { .. })) {
            self.reasons.insert(0, Reason::RateTooLow { rate });
            self.usable = None;
        }
        self
    }
}

/// Judges a clip frame by frame; a few kilobytes are kept of each.
#[derive(Debug, Clone)]
pub struct Inspector {
    size: (usize, usize),
    thumbnails: Thumbnails,
    tracker: Tracker,
}

impl Inspector {
    /// For frames of `width` × `height` working pixels (multiples of 16) at 25 frames/s.
    pub fn new(width: usize, height: usize) -> Self {
        Self { size: (width, height), thumbnails: Thumbnails::default(), tracker: Tracker::default() }
    }

    /// Takes the next frame.
    ///
    /// # Errors
    /// When its size differs from the clip's.
    pub fn push(&mut self, frame: &Rgb8) -> Result<()> {
        if (frame.width, frame.height) != self.size {
            let problem = format!("a frame of {} × {} px among others", frame.width, frame.height);
            let allowed = format!("{} × {} px", self.size.0, self.size.1);
            return Err(Error::new(Kind::Data, "clip", problem).allowed(allowed));
        }
        let luma = frame.luma();
        let number = self.thumbnails.len();
        if number.is_multiple_of(STEP) {
            let half = resample::resize(&luma, (self.size.0 / 2).max(1), (self.size.1 / 2).max(1));
            self.tracker.push(number, &half);
        }
        self.thumbnails.push(&luma);
        Ok(())
    }

    /// The judgement of the frames seen.
    pub fn finish(self) -> Report {
        let frames = self.thumbnails.len();
        let segments = self.tracker.finish();
        let poses = poses(&segments, frames);
        let moved = 2.0 * camera::extent(&poses);
        let covered: usize = segments.iter().map(|s| (STEP * s.path.len()).min(frames - s.start)).sum();
        let coverage = covered as f32 / frames.max(1) as f32;
        let moves = moved > CAMERA_TOLERANCE;
        let camera =
            if moves || coverage >= 0.5 { Camera::Measured { pixels: moved, coverage } } else { Camera::NotMeasurable };
        // A camera that sets off changes the whole picture too; it has its own reason.
        let mut changes = self.thumbnails.changes();
        changes.retain(|change| match change {
            Change::Cut(_) => true,
            Change::Fade(frames) => 2.0 * camera::extent(&poses[frames.clone()]) <= CAMERA_TOLERANCE,
        });
        let frozen = self.thumbnails.frozen();
        let (moving, rate) = (self.thumbnails.moving(), RATE as f32 * self.thumbnails.distinct());
        let mut reasons = whole(frames, self.size, moving, rate, &frozen);
        let hopeless = !reasons.is_empty();
        if let (true, Some(first), Some(last)) = (moves, segments.first(), segments.last()) {
            let end = (last.start + STEP * last.path.len()).min(frames);
            reasons.push(Reason::CameraMoves { pixels: moved, frames: first.start..end });
        }
        reasons.extend(changes.iter().map(|change| match change {
            Change::Cut(frame) => Reason::Cut { frame: *frame },
            Change::Fade(frames) => Reason::Fade { frames: frames.clone() },
        }));
        reasons.extend(frozen.iter().map(|frames| Reason::Frozen { frames: frames.clone() }));
        let usable = if hopeless { None } else { longest(&poses, &changes, &frozen) };
        Report { frames, camera, moving, reasons, usable }
    }
}

/// Judges a whole clip of `width` × `height` working pixels at 25 frames/s; far cheaper than analysing it.
///
/// # Errors
/// Those of `frames`; a frame of another size; a cancel.
pub fn inspect(frames: &mut dyn Frames, (width, height): (usize, usize), observer: &dyn Observer) -> Result<Report> {
    let mut inspector = Inspector::new(width, height);
    let mut frame = frames.next_frame()?;
    while let Some(current) = frame {
        observe::check(observer)?;
        let (next, pushed) = par::join(|| frames.next_frame(), || inspector.push(&current));
        pushed?;
        frame = next?;
    }
    Ok(inspector.finish())
}

/// What is wrong with the clip from end to end.
fn whole(
    frames: usize,
    (width, height): (usize, usize),
    moving: f32,
    rate: f32,
    frozen: &[Range<usize>],
) -> Vec<Reason> {
    let mut reasons = Vec::new();
    if frames < MIN_FRAMES {
        reasons.push(Reason::TooShort { frames });
    }
    if width < PIECE || height < PIECE {
        reasons.push(Reason::TooSmall { width, height });
    }
    let all_frozen = frozen.iter().map(Range::len).sum::<usize>() == frames;
    if frames > 1 && !all_frozen && rate < MIN_RATE {
        reasons.push(Reason::RateTooLow { rate });
    }
    if frames > 1 && !all_frozen && moving * ((width * height) as f32) < (PIECE * PIECE) as f32 {
        reasons.push(Reason::NothingMoves { share: moving });
    }
    reasons
}

/// Where the camera points in every frame, half-size pixels; held where it was not measured, segments joined.
fn poses(segments: &[Segment], frames: usize) -> Vec<Pose> {
    let mut poses = vec![Pose::default(); frames];
    let mut base = Pose::default();
    for segment in segments {
        let add = |pose: &Pose| std::array::from_fn(|i| std::array::from_fn(|c| base[i][c] + pose[i][c]));
        for (frame, out) in poses.iter_mut().enumerate().skip(segment.start) {
            *out = add(&segment.path[((frame - segment.start) / STEP).min(segment.path.len() - 1)]);
        }
        base = poses.last().copied().unwrap_or_default();
    }
    poses
}

/// Longest stretch of [`MIN_FRAMES`] or more without a fault.
fn longest(poses: &[Pose], changes: &[Change], frozen: &[Range<usize>]) -> Option<Range<usize>> {
    let mut faults: Vec<Range<usize>> = frozen.to_vec();
    faults.extend(changes.iter().map(|change| match change {
        Change::Cut(frame) => *frame..*frame,
        Change::Fade(frames) => frames.clone(),
    }));
    faults.sort_by_key(|fault| (fault.start, fault.end));
    faults.push(poses.len()..poses.len());
    let mut best = 0..0;
    let mut start = 0;
    for fault in faults {
        let steady = steady(poses, start..fault.start.max(start));
        if steady.len() > best.len() {
            best = steady;
        }
        start = start.max(fault.end);
    }
    (best.len() >= MIN_FRAMES).then_some(best)
}

/// Longest part of `frames` over which the camera stays within [`CAMERA_TOLERANCE`].
fn steady(poses: &[Pose], frames: Range<usize>) -> Range<usize> {
    let within = |range: Range<usize>| 2.0 * camera::extent(&poses[range]) <= CAMERA_TOLERANCE;
    let (mut best, mut start) = (frames.start..frames.start, frames.start);
    for end in frames.start + 1..=frames.end {
        while !within(start..end) {
            start += 1;
        }
        if end - start > best.len() {
            best = start..end;
        }
    }
    best
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::CameraMoves { pixels, frames } => {
                write!(f, "camera moves: {pixels:.1} px in frames {} to {}", frames.start, frames.end)
            }
            Self::Cut { frame } => write!(f, "cut at frame {frame}"),
            Self::Fade { frames } => write!(f, "fade in frames {} to {}", frames.start, frames.end),
            Self::Frozen { frames } => write!(f, "frozen in frames {} to {}", frames.start, frames.end),
            Self::TooShort { frames } => {
                write!(f, "too short: {}, needs {MIN_FRAMES}", counted(*frames as u64, "frame"))
            }
            Self::TooSmall { width, height } => write!(f, "too small: {width} × {height} px"),
            Self::NothingMoves { share } => write!(f, "nothing moves: {:.1} % of the picture changes", share * 100.0),
            Self::RateTooLow { rate } => write!(f, "rate too low: {rate:.1} different frames per second"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::observe::Silent;
    use crate::base::rng;

    const SIZE: (usize, usize) = (320, 192);

    /// A smooth random texture at a continuous position.
    fn texture(seed: u64, x: f32, y: f32) -> f32 {
        let value = |x: i32, y: i32| rng::unit(rng::hash(seed, &[x as u64, y as u64]));
        let (x, y) = (x / 6.0 + 1000.0, y / 6.0 + 1000.0);
        let (ax, ay) = (x.fract(), y.fract());
        let (x, y) = (x as i32, y as i32);
        let top = value(x, y) * (1.0 - ax) + value(x + 1, y) * ax;
        top * (1.0 - ay) + (value(x, y + 1) * (1.0 - ax) + value(x + 1, y + 1) * ax) * ay
    }

    fn judge(frames: usize, picture: impl Fn(usize, f32, f32) -> f32 + Sync) -> Report {
        let mut t = 0;
        let mut next = || {
            if t == frames {
                return Ok(None);
            }
            let mut frame = Rgb8::black(SIZE.0, SIZE.1);
            for (i, pixel) in frame.data.chunks_exact_mut(3).enumerate() {
                let value = picture(t, (i % SIZE.0) as f32, (i / SIZE.0) as f32);
                pixel.fill((255.0 * value.clamp(0.0, 1.0)).round() as u8);
            }
            t += 1;
            Ok(Some(frame))
        };
        inspect(&mut next, SIZE, &Silent).unwrap()
    }

    /// A still background whose lower right part flows to the right, 2 px per frame, and changes as it goes.
    fn stream(t: usize, x: f32, y: f32) -> f32 {
        if x > 120.0 && y > 60.0 {
            let mix = 0.5 + 0.5 * (t as f32 * 0.7 + x * 0.05).sin();
            mix * texture(2, x - 2.0 * t as f32, y) + (1.0 - mix) * texture(3, x - 2.0 * t as f32, y)
        } else {
            texture(1, x, y)
        }
    }

    fn only(report: &Report) -> &Reason {
        assert_eq!(report.reasons.len(), 1, "{report:?}");
        &report.reasons[0]
    }

    #[test]
    fn a_stream_before_a_still_background_is_accepted() {
        let report = judge(60, stream);
        assert!(report.accepted() && report.usable == Some(0..60), "{report:?}");
        assert!(matches!(report.camera, Camera::Measured { pixels, .. } if pixels < 0.2), "{report:?}");
        assert!((0.3..0.6).contains(&report.moving), "{report:?}");
    }

    #[test]
    fn a_pan_is_measured_in_pixels() {
        let report = judge(60, |t, x, y| stream(t, x + 0.2 * t as f32, y + 0.1 * t as f32));
        // Measured every second frame: up to frame 58.
        let expected = 58.0 * 0.2f32.hypot(0.1);
        assert!(
            matches!(only(&report), Reason::CameraMoves { pixels, .. } if (pixels - expected).abs() < 0.5),
            "{report:?}"
        );
        assert_eq!(report.usable, None);
    }

    #[test]
    fn a_zoom_is_a_moving_camera_and_a_little_drift_is_not() {
        let zoom = judge(60, |t, x, y| {
            let s = 1.0 + 0.001 * t as f32;
            stream(t, (x - 160.0) * s + 160.0, (y - 96.0) * s + 96.0)
        });
        assert!(matches!(only(&zoom), Reason::CameraMoves { .. }), "{zoom:?}");
        assert!(judge(60, |t, x, y| stream(t, x + 0.02 * t as f32, y)).accepted());
    }

    #[test]
    fn a_steady_start_before_a_pan_is_offered() {
        let report = judge(90, |t, x, y| stream(t, x + t.saturating_sub(50) as f32, y));
        let usable = report.usable.clone().unwrap();
        assert!(usable.start == 0 && (50..56).contains(&usable.end), "{report:?}");
    }

    #[test]
    fn cuts_and_fades_are_found_and_the_rest_is_offered() {
        let cut = judge(100, |t, x, y| if t < 60 { stream(t, x, y) } else { texture(7, x, y + 3.0 * t as f32) });
        assert!(cut.reasons.contains(&Reason::Cut { frame: 60 }) && cut.usable == Some(0..60), "{cut:?}");
        let fade = judge(100, |t, x, y| stream(t, x, y) * (1.0 - t.saturating_sub(70) as f32 / 20.0).max(0.0));
        assert!(fade.reasons.iter().any(|r| matches!(r, Reason::Fade { frames } if frames.start >= 55)), "{fade:?}");
        let ramp = judge(100, |t, x, y| stream(t, x, y) * (1.0 - 0.006 * t as f32));
        assert!(matches!(only(&ramp), Reason::Fade { .. }), "{ramp:?}");
    }

    #[test]
    fn stillness_noise_and_flicker_are_no_motion() {
        let still = judge(60, |_, x, y| texture(1, x, y));
        assert!(matches!(only(&still), Reason::Frozen { frames } if *frames == (0..60)), "{still:?}");
        let noise = judge(60, |t, x, y| {
            let noise = rng::unit(rng::hash(5, &[t as u64, x as u64, y as u64])) - 0.5;
            texture(1, x, y) + 6.0 / 255.0 * noise
        });
        assert!(matches!(only(&noise), Reason::NothingMoves { .. }), "{noise:?}");
        let flicker = judge(60, |t, x, y| texture(1, x, y) * (0.6 + 0.1 * (t as f32 * 1.3).sin()));
        assert!(matches!(only(&flicker), Reason::NothingMoves { .. }), "{flicker:?}");
    }

    #[test]
    fn repeated_frames_and_short_clips_are_named() {
        let told = judge(60, stream).at_source_rate(8.0);
        assert!(matches!(only(&told), Reason::RateTooLow { .. }) && told.usable.is_none());
        let slow = judge(90, |t, x, y| stream(t / 3, x, y));
        assert!(matches!(only(&slow), Reason::RateTooLow { rate } if (rate - 8.3).abs() < 0.3), "{slow:?}");
        assert!(matches!(only(&judge(30, stream)), Reason::TooShort { frames: 30 }));
        assert_eq!(judge(0, stream).usable, None);
    }

    #[test]
    fn fluid_that_fills_the_picture_leaves_the_camera_unmeasured() {
        let report = judge(60, |t, x, y| texture(t as u64 / 4, x, y) * 0.5 + texture(1 + t as u64 / 4, x, y) * 0.5);
        assert_eq!(report.camera, Camera::NotMeasurable, "{report:?}");
    }
}
