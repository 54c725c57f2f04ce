//! MP4 and QuickTime files (ISO/IEC 14496-12): our own small demuxer, and a clip read through it.

pub mod boxes;
pub mod timeline;
pub mod track;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use timeline::Stretch;
use track::Track;

use super::decoder::{Failure, MAX_PIXELS, Picture, VideoDecoder};
use super::h264::{Configuration, H264};
use super::mjpeg::Mjpeg;
use super::vp9::Vp9;
use crate::base::error::{Error, Kind, Result};
use crate::video::clip::{ClipInfo, RawFrame, Source};

/// Largest `moov` box that is read into memory.
const MAX_MOOV: u64 = 256 << 20;
/// Frames that may wait for an earlier one; H.264 never needs more than 16.
const MAX_WAITING: usize = 20;

/// What a file holds, before a decoder is chosen.
pub enum Content {
    /// An embedded decoder reads it.
    Clip(Box<Mp4>),
    /// The file is sound, but needs another decoder, for the codec or feature named.
    Other(String),
}

/// A clip in an MP4 or QuickTime file.
pub struct Mp4 {
    path: PathBuf,
    file: File,
    length: u64,
    info: ClipInfo,
    track: Track,
    decoder: Box<dyn VideoDecoder>,
    stretches: std::vec::IntoIter<Stretch>,
    now: Option<Stretch>,
    /// How many of the present stretch's frames were shown or given up.
    shown: usize,
    waiting: BTreeMap<usize, Option<Picture>>,
    damage: Option<Error>,
}

/// Opens a file.
///
/// # Errors
/// When the file cannot be read, is damaged or has no video.
pub fn open(path: &Path) -> Result<Content> {
    let mut file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    let length = file.metadata().map_err(|e| Error::io(path, "read", e))?.len();
    let damaged = |problem: String| {
        Error::file(Kind::Data, path, problem).remedy("the recording may have been cut off; export the clip again")
    };
    let moov = read_moov(&mut file, length).map_err(|e| Error::io(path, "read", e))?;
    let moov = moov.ok_or_else(|| damaged("it has no movie header ('moov'), as if it had been cut off".into()))?;
    if boxes::child(&moov, b"mvex").is_some() {
        return Ok(Content::Other("fragmented MP4".into()));
    }
    let track = Track::from_moov(&moov).map_err(damaged)?;
    let (codec, size, decoder) = match choose(&track) {
        Choice::Decoder(codec, size, decoder) => (codec, size, decoder),
        Choice::Other(codec) => return Ok(Content::Other(codec)),
        Choice::Damaged(problem) => return Err(damaged(problem)),
    };
    let stretches = timeline::stretches(&track.samples, &track.edits).map_err(damaged)?;
    let frames: usize = stretches.iter().map(|s| s.show.len()).sum();
    let end = stretches
        .iter()
        .filter_map(|s| s.show.last())
        .map(|&(t, i)| t.saturating_add(track.samples[i].duration.into()))
        .max();
    let info = ClipInfo {
        width: size.0,
        height: size.1,
        turn: track.turn,
        frames: Some(frames),
        duration_ns: end.map(|end| nanoseconds(end, track.timescale)),
        codec,
        decoder: decoder.1,
    };
    let stretches = stretches.into_iter();
    let (now, shown, waiting, damage) = (None, 0, BTreeMap::new(), None);
    let path = path.to_path_buf();
    let clip = Mp4 { path, file, length, info, track, decoder: decoder.0, stretches, now, shown, waiting, damage };
    Ok(Content::Clip(Box::new(clip)))
}

enum Choice {
    Decoder(String, (usize, usize), (Box<dyn VideoDecoder>, &'static str)),
    Other(String),
    Damaged(String),
}

fn choose(track: &Track) -> Choice {
    let size = track.size;
    let fits = size.0 > 0 && size.1 > 0 && size.0.saturating_mul(size.1) <= MAX_PIXELS;
    match &track.codec {
        b"avc1" | b"avc3" => {
            let Some(configuration) = track.avcc.as_deref().and_then(Configuration::parse) else {
                return Choice::Damaged("its H.264 configuration ('avcC') is missing or damaged".into());
            };
            let Some(sps) = configuration.sps() else {
                return Choice::Damaged("its H.264 parameter sets are missing or damaged".into());
            };
            if let Some(reason) = sps.unsupported() {
                return Choice::Other(format!("H.264 {} with {reason}", sps.profile_name()));
            }
            let name = format!("H.264 {}", sps.profile_name());
            let decoder = H264::new(configuration, track.colour);
            Choice::Decoder(name, sps.size(), (Box::new(decoder), "embedded h264"))
        }
        _ if !fits => Choice::Damaged(format!("its frames are said to be {} × {} pixels", size.0, size.1)),
        b"vp09" => Choice::Decoder("VP9".into(), size, (Box::new(Vp9::new(track.colour)), "embedded vp9")),
        b"jpeg" | b"mjpa" => Choice::Decoder("Motion JPEG".into(), size, (Box::new(Mjpeg), "embedded mjpeg")),
        other => Choice::Other(codec_name(other)),
    }
}

/// A codec's name for people, with its four-character code.
fn codec_name(code: &[u8; 4]) -> String {
    let name = match code {
        b"hvc1" | b"hev1" | b"dvh1" | b"dvhe" => "HEVC",
        b"av01" => "AV1",
        b"vp08" => "VP8",
        b"mp4v" => "MPEG-4 part 2",
        b"apcn" | b"apch" | b"apcs" | b"apco" | b"ap4h" | b"ap4x" => "ProRes",
        b"encv" => "encrypted video",
        _ => "codec",
    };
    format!("{name} ({})", code.escape_ascii())
}

/// Payload of the first `moov` box; `None` when there is none.
fn read_moov(file: &mut File, length: u64) -> std::io::Result<Option<Vec<u8>>> {
    let mut at = 0u64;
    while at + 8 <= length {
        file.seek(SeekFrom::Start(at))?;
        let mut head = [0; 16];
        let got = if at + 16 <= length { 16 } else { 8 };
        file.read_exact(&mut head[..got])?;
        let size = u64::from(u32::from_be_bytes([head[0], head[1], head[2], head[3]]));
        let (header, size) = match size {
            0 => (8, length - at),
            1 if got == 16 => (16, u64::from_be_bytes(head[8..].try_into().unwrap_or_default())),
            size => (8, size),
        };
        let Some(end) = at.checked_add(size).filter(|_| size >= header) else { return Ok(None) };
        if &head[4..8] == b"moov" {
            let body = size - header;
            if end > length || body > MAX_MOOV {
                return Ok(None);
            }
            let mut payload = vec![0; body as usize];
            file.seek(SeekFrom::Start(at + header))?;
            file.read_exact(&mut payload)?;
            return Ok(Some(payload));
        }
        at = end;
    }
    Ok(None)
}

fn nanoseconds(time: i64, timescale: u32) -> u64 {
    let ns = i128::from(time.max(0)) * 1_000_000_000 / i128::from(timescale);
    u64::try_from(ns).unwrap_or(u64::MAX)
}

impl Mp4 {
    fn read_sample(&mut self, index: usize) -> Result<Vec<u8>> {
        let sample = self.track.samples[index];
        let end = sample.offset.checked_add(sample.size.into());
        if end.is_none_or(|end| end > self.length) {
            return Err(self.damaged(index, "the file ends before it"));
        }
        let mut data = vec![0; sample.size as usize];
        self.file
            .seek(SeekFrom::Start(sample.offset))
            .and_then(|_| self.file.read_exact(&mut data))
            .map_err(|e| Error::io(&self.path, "read", e))?;
        Ok(data)
    }

    fn damaged(&self, index: usize, why: &str) -> Error {
        Error::file(Kind::Data, &self.path, format!("frame {index} cannot be decoded: {why}"))
            .remedy("cut the clip before this frame, or export it again")
    }

    /// Decodes the next sample of the present stretch; `false` at its end.
    fn step(&mut self) -> Result<bool> {
        let Some(index) = self.now.as_mut().and_then(|stretch| stretch.decode.next()) else { return Ok(false) };
        let data = self.read_sample(index)?;
        // An empty sample shows nothing new.
        let picture = if data.is_empty() { Ok(None) } else { self.decoder.decode(&data) };
        let picture = picture.map_err(|failure| match failure {
            Failure::Damaged(why) => self.damaged(index, &why),
            Failure::Unsupported(what) => {
                Error::file(Kind::Unsupported, &self.path, format!("{} uses {what}", self.info.codec))
                    .remedy("install ffmpeg (ffmpeg and ffprobe on PATH), or convert the clip to progressive H.264")
            }
        })?;
        self.waiting.insert(index, picture);
        Ok(true)
    }

    /// The frame that is due, when it has been decoded.
    fn due(&mut self) -> Option<RawFrame> {
        while let Some(&(time, index)) = self.now.as_ref().and_then(|s| s.show.get(self.shown)) {
            match self.waiting.remove(&index) {
                Some(Some(picture)) => {
                    self.shown += 1;
                    let time_ns = nanoseconds(time, self.track.timescale);
                    return Some(RawFrame {
                        width: picture.width,
                        height: picture.height,
                        time_ns,
                        pixels: picture.pixels,
                    });
                }
                Some(None) => self.shown += 1,
                // Never decoded, or too far ahead of its turn: go on without it rather than keep everything else.
                None if self.is_behind(index) => self.shown += 1,
                None => return None,
            }
        }
        None
    }

    fn is_behind(&self, index: usize) -> bool {
        let decoded = self.now.as_ref().is_none_or(|s| !s.decode.contains(&index));
        decoded || self.waiting.len() > MAX_WAITING
    }

    /// Forgets decoded samples that are not shown.
    fn prune(&mut self) {
        let Some(stretch) = &self.now else { return };
        let late = &stretch.show[self.shown.min(stretch.show.len())..];
        let window = &late[..late.len().min(4 * MAX_WAITING)];
        self.waiting.retain(|index, _| window.iter().any(|&(_, i)| i == *index));
    }
}

impl Source for Mp4 {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<RawFrame>> {
        loop {
            if let Some(frame) = self.due() {
                return Ok(Some(frame));
            }
            if let Some(damage) = self.damage.take() {
                self.now = None;
                self.stretches = Vec::new().into_iter();
                return Err(damage);
            }
            match self.step() {
                Ok(true) => self.prune(),
                Ok(false) => {
                    let Some(next) = self.stretches.next() else { return Ok(None) };
                    self.now = Some(next);
                    self.shown = 0;
                    self.waiting.clear();
                    self.decoder.reset();
                }
                Err(damage) => {
                    // What was decoded before the damage is shown first.
                    if let Some(stretch) = &mut self.now {
                        stretch.decode = 0..0;
                    }
                    self.damage = Some(damage);
                }
            }
        }
    }
}
