//! WebM and Matroska files with VP9.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use matroska_demuxer::{Frame, MatrixCoefficients, MatroskaFile, TrackEntry, TrackType};

use super::decoder::{Failure, MAX_PIXELS, VideoDecoder, guarded};
use super::h264::Colour;
use super::vp9::Vp9;
use crate::base::error::{Error, Kind, Result};
use crate::video::clip::{ClipInfo, RawFrame, Source, Turn};

/// How long the demuxer may take for its headers, and for one frame.
const TIME_LIMIT: Duration = Duration::from_secs(30);

/// What a file holds.
pub enum Content {
    /// The embedded decoder reads it.
    Clip(Box<WebM>),
    /// The file is sound, but needs another decoder, for the codec named.
    Other(String),
}

/// A file that stops reading when time is up, so that a damaged file cannot make the demuxer search for ever.
struct Limited {
    inner: BufReader<File>,
    start: Instant,
    /// Milliseconds after `start` at which reading stops.
    deadline: Arc<AtomicU64>,
    expired: Arc<AtomicBool>,
}

impl Limited {
    fn check(&self) -> std::io::Result<()> {
        if self.start.elapsed().as_millis() as u64 > self.deadline.load(Ordering::Relaxed) {
            self.expired.store(true, Ordering::Relaxed);
            return Err(std::io::ErrorKind::TimedOut.into());
        }
        Ok(())
    }
}

impl Read for Limited {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.check()?;
        self.inner.read(buffer)
    }
}

impl Seek for Limited {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.check()?;
        let now = self.inner.stream_position()?;
        match to {
            SeekFrom::Current(0) => Ok(now),
            SeekFrom::Current(step) => self.inner.seek_relative(step).and_then(|()| self.inner.stream_position()),
            SeekFrom::Start(to) if to.abs_diff(now) < 1 << 16 => {
                self.inner.seek_relative(to as i64 - now as i64).map(|()| to)
            }
            to => self.inner.seek(to),
        }
    }
}

/// A WebM file being read.
pub struct WebM {
    path: PathBuf,
    file: MatroskaFile<Limited>,
    start: Instant,
    deadline: Arc<AtomicU64>,
    expired: Arc<AtomicBool>,
    info: ClipInfo,
    track: u64,
    /// Nanoseconds per timestamp unit.
    unit: u64,
    decoder: Vp9,
    packets: u64,
    /// Whether the segment is longer than the file.
    cut_off: bool,
    over: bool,
}

/// Opens a file.
///
/// # Errors
/// When it cannot be read or is damaged.
pub fn open(path: &Path) -> Result<Content> {
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    let cut_off = is_cut_off(path).map_err(|e| Error::io(path, "read", e))?;
    let start = Instant::now();
    let deadline = Arc::new(AtomicU64::new(TIME_LIMIT.as_millis() as u64));
    let expired = Arc::new(AtomicBool::new(false));
    let inner = BufReader::with_capacity(1 << 17, file);
    let limited = Limited { inner, start, deadline: deadline.clone(), expired: expired.clone() };
    let file = guarded(|| MatroskaFile::open(limited).map_err(|e| Failure::Damaged(e.to_string())));
    let file = file.map_err(|failure| {
        let (Failure::Damaged(why) | Failure::Unsupported(why)) = failure;
        Error::file(Kind::Data, path, format!("its WebM header is damaged: {why}")).remedy("export the clip again")
    })?;
    let Some(track) = file.tracks().iter().find(|t| t.track_type() == TrackType::Video) else {
        return Err(Error::file(Kind::Data, path, "it has no video track"));
    };
    if track.codec_id() != "V_VP9" || track.content_encodings().is_some() {
        return Ok(Content::Other(codec_name(track.codec_id())));
    }
    let info = info(path, &file, track)?;
    let (decoder, number) = (Vp9::new(colour(track)), track.track_number().get());
    let unit = file.info().timestamp_scale().get();
    let path = path.to_path_buf();
    let (packets, over) = (0, false);
    let track = number;
    let clip = WebM { path, file, start, deadline, expired, info, track, unit, decoder, packets, cut_off, over };
    Ok(Content::Clip(Box::new(clip)))
}

fn info(path: &Path, file: &MatroskaFile<Limited>, track: &TrackEntry) -> Result<ClipInfo> {
    let size = track.video().map_or((0, 0), |v| (v.pixel_width().get(), v.pixel_height().get()));
    if size.0 == 0 || size.1 == 0 || size.0.saturating_mul(size.1) > MAX_PIXELS as u64 {
        let problem = format!("its frames are said to be {} × {} pixels", size.0, size.1);
        return Err(Error::file(Kind::Data, path, problem).allowed(format!("1 to {MAX_PIXELS} pixels")));
    }
    let unit = file.info().timestamp_scale().get() as f64;
    let duration_ns = file.info().duration().filter(|d| d.is_finite() && *d > 0.0).map(|d| (d * unit) as u64);
    Ok(ClipInfo {
        width: size.0 as usize,
        height: size.1 as usize,
        turn: Turn::None,
        frames: None,
        duration_ns,
        codec: "VP9".into(),
        decoder: "embedded vp9",
    })
}

fn colour(track: &TrackEntry) -> Colour {
    let Some(tags) = track.video().and_then(|v| v.colour()) else { return Colour::default() };
    let matrix = match tags.matrix_coefficients() {
        Some(MatrixCoefficients::Bt709 | MatrixCoefficients::Smpte240) => Some(1),
        Some(MatrixCoefficients::Bt470bg | MatrixCoefficients::Smpte170) => Some(6),
        _ => None,
    };
    let full_range = tags.range().and_then(|range| match range {
        matroska_demuxer::Range::Full => Some(true),
        matroska_demuxer::Range::Broadcast => Some(false),
        _ => None,
    });
    Colour { matrix, full_range }
}

/// A codec's name for people.
fn codec_name(id: &str) -> String {
    match id {
        "V_VP8" => "VP8".into(),
        "V_AV1" => "AV1".into(),
        "V_MPEGH/ISO/HEVC" => "HEVC in Matroska".into(),
        "V_MPEG4/ISO/AVC" => "H.264 in Matroska".into(),
        other => format!("codec {other} in Matroska"),
    }
}

/// A variable-length integer of EBML: its value and its bytes; `None` for "unknown size".
fn vint(data: &[u8]) -> Option<(u64, usize)> {
    let length = data.first()?.leading_zeros() as usize + 1;
    let bytes = data.get(..length).filter(|_| length <= 8)?;
    let raw = bytes.iter().fold(0u64, |n, &b| n << 8 | u64::from(b));
    let value = raw & ((1u64 << (7 * length)) - 1);
    (value != (1u64 << (7 * length)) - 1).then_some((value, length))
}

/// Whether the segment says it is longer than the file: the demuxer takes the end of the file for the end of the clip.
fn is_cut_off(path: &Path) -> std::io::Result<bool> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let mut head = [0; 64];
    let got = file.read(&mut head)?;
    let read = |file: &mut File| {
        let (header, n) = vint(head.get(4..got)?)?;
        let segment = 4 + n as u64 + header;
        file.seek(SeekFrom::Start(segment)).ok()?;
        let mut start = [0; 12];
        file.read_exact(&mut start).ok()?;
        start.starts_with(&[0x18, 0x53, 0x80, 0x67]).then_some(())?;
        let (size, n) = vint(&start[4..])?;
        segment.checked_add(4 + n as u64)?.checked_add(size)
    };
    Ok(read(&mut file).is_some_and(|end| end > length))
}

impl WebM {
    /// The next packet of the video track.
    fn packet(&mut self) -> Result<Option<Frame>> {
        let until = self.start.elapsed() + TIME_LIMIT;
        self.deadline.store(until.as_millis() as u64, Ordering::Relaxed);
        loop {
            let mut frame = Frame::default();
            let file = &mut self.file;
            let read = guarded(|| file.next_frame(&mut frame).map_err(|e| Failure::Damaged(e.to_string())));
            if self.expired.load(Ordering::Relaxed) {
                return Err(self.damaged("the file is damaged so badly that reading did not end"));
            }
            match read {
                Ok(true) if frame.track == self.track => return Ok(Some(frame)),
                Ok(true) => {}
                Ok(false) if self.cut_off => return Err(self.damaged("the file is cut off before its end")),
                Ok(false) => return Ok(None),
                Err(Failure::Damaged(why) | Failure::Unsupported(why)) => return Err(self.damaged(&why)),
            }
        }
    }

    fn damaged(&mut self, why: &str) -> Error {
        self.over = true;
        let problem = format!("packet {} cannot be decoded: {why}", self.packets);
        Error::file(Kind::Data, &self.path, problem).remedy("cut the clip before it, or export it again")
    }
}

impl Source for WebM {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<RawFrame>> {
        while !self.over {
            let Some(packet) = self.packet()? else {
                self.over = true;
                break;
            };
            let picture = self.decoder.decode(&packet.data).map_err(|failure| match failure {
                Failure::Damaged(why) => self.damaged(&why),
                Failure::Unsupported(what) => {
                    self.over = true;
                    Error::file(Kind::Unsupported, &self.path, format!("VP9 with {what}")).remedy(super::ffmpeg::REMEDY)
                }
            })?;
            self.packets += 1;
            if let Some(p) = picture {
                let time_ns = packet.timestamp.saturating_mul(self.unit);
                return Ok(Some(RawFrame { width: p.width, height: p.height, time_ns, pixels: p.pixels }));
            }
        }
        Ok(None)
    }
}
