//! AVI files (RIFF) with Motion JPEG.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::decoder::{Failure, MAX_PIXELS, Picture, VideoDecoder};
use super::mjpeg::Mjpeg;
use crate::base::error::{Error, Kind, Result};
use crate::video::clip::{ClipInfo, RawFrame, Source, Turn};

/// Largest coded frame; a JPEG larger than its pixels would be nonsense.
const MAX_PACKET: u32 = 256 << 20;
/// Largest header list that is read into memory.
const MAX_HEADER: u32 = 16 << 20;

/// What a file holds.
pub enum Content {
    /// The embedded decoder reads it.
    Clip(Box<Avi>),
    /// The file needs another decoder, for the codec named.
    Other(String),
}

/// An AVI file being read.
pub struct Avi {
    path: PathBuf,
    input: BufReader<File>,
    length: u64,
    /// Where the next chunk begins.
    at: u64,
    info: ClipInfo,
    /// First two characters of the video stream's chunks.
    prefix: [u8; 2],
    /// Stream time units per second as a ratio.
    rate: (u32, u32),
    frames: u64,
    last: Option<Picture>,
    over: bool,
}

/// The video stream's description.
struct Video {
    index: usize,
    handler: [u8; 4],
    compression: [u8; 4],
    size: (usize, usize),
    rate: (u32, u32),
    length: u32,
}

/// A RIFF chunk's name, payload size and payload offset.
type Chunk = ([u8; 4], u32, u64);

fn u32_at(data: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(data.get(at..at + 4)?.try_into().ok()?))
}

fn code_at(data: &[u8], at: usize) -> Option<[u8; 4]> {
    data.get(at..at + 4)?.try_into().ok()
}

/// Chunks within a list's payload.
fn chunks(mut data: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    std::iter::from_fn(move || {
        let (name, size) = (code_at(data, 0)?, u32_at(data, 4)? as usize);
        let body = data.get(8..8usize.checked_add(size)?)?;
        data = data.get(8 + size.next_multiple_of(2)..).unwrap_or_default();
        Some((name, body))
    })
}

/// The first video stream of a header list.
fn video(header: &[u8]) -> Option<Video> {
    let streams = chunks(header).filter(|(name, body)| name == b"LIST" && body.starts_with(b"strl"));
    streams.enumerate().find_map(|(index, (_, body))| {
        let find = |wanted: &[u8; 4]| chunks(body.get(4..)?).find(|(name, _)| name == wanted).map(|(_, b)| b);
        let (strh, strf) = (find(b"strh")?, find(b"strf")?);
        (strh.starts_with(b"vids")).then_some(())?;
        let size = (u32_at(strf, 4)? as i32, u32_at(strf, 8)? as i32);
        Some(Video {
            index,
            handler: code_at(strh, 4)?,
            compression: code_at(strf, 16)?,
            size: (usize::try_from(size.0).ok()?, size.1.unsigned_abs() as usize),
            rate: (u32_at(strh, 24)?, u32_at(strh, 20)?),
            length: u32_at(strh, 32)?,
        })
    })
}

/// Opens a file.
///
/// # Errors
/// When it cannot be read or its header is damaged.
pub fn open(path: &Path) -> Result<Content> {
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    let length = file.metadata().map_err(|e| Error::io(path, "read", e))?.len();
    let mut input = BufReader::with_capacity(1 << 18, file);
    let header = header(&mut input, length).map_err(|e| Error::io(path, "read", e))?;
    let damaged = |what: &str| {
        Error::file(Kind::Data, path, format!("its AVI header is damaged: {what}")).remedy("export the clip again")
    };
    let (header, after) = header.ok_or_else(|| damaged("it has no header list"))?;
    let video = video(&header).ok_or_else(|| damaged("it describes no video stream"))?;
    let codes = [video.compression, video.handler].map(|c| c.map(|b| b.to_ascii_uppercase()));
    if !codes.iter().any(|c| matches!(c, b"MJPG" | b"AVRN" | b"JPEG")) {
        return Ok(Content::Other(codec_name(video.compression)));
    }
    let (width, height) = video.size;
    if width == 0 || height == 0 || width.saturating_mul(height) > MAX_PIXELS || video.index > 99 {
        return Err(damaged(&format!("{width} × {height} pixels")));
    }
    let rate = if video.rate.0 == 0 || video.rate.1 == 0 { (25, 1) } else { video.rate };
    let ns = |frames: u64| duration_ns(frames, rate);
    let info = ClipInfo {
        width,
        height,
        turn: Turn::None,
        frames: Some(video.length as usize),
        duration_ns: Some(ns(video.length.into())),
        codec: "Motion JPEG".into(),
        decoder: "embedded mjpeg",
    };
    let prefix = [b'0' + (video.index / 10) as u8, b'0' + (video.index % 10) as u8];
    let path = path.to_path_buf();
    let clip = Avi { path, input, length, at: after, info, prefix, rate, frames: 0, last: None, over: false };
    Ok(Content::Clip(Box::new(clip)))
}

/// A codec's name for people, with its code.
fn codec_name(code: [u8; 4]) -> String {
    let name = match &code.map(|b| b.to_ascii_uppercase()) {
        b"MP42" | b"DIV2" => "msmpeg4v2",
        b"MP43" | b"DIV3" => "msmpeg4v3",
        b"XVID" | b"DIVX" | b"DX50" | b"MP4V" | b"FMP4" => "MPEG-4 part 2",
        b"H264" | b"X264" | b"AVC1" => "H.264 in AVI",
        b"DVSD" => "DV",
        [0, 0, 0, 0] => "uncompressed video in AVI",
        _ => "codec",
    };
    format!("{name} ({})", code.escape_ascii())
}

fn duration_ns(frames: u64, (rate, scale): (u32, u32)) -> u64 {
    let ns = u128::from(frames) * 1_000_000_000 * u128::from(scale) / u128::from(rate.max(1));
    u64::try_from(ns).unwrap_or(u64::MAX)
}

/// The chunk at `at`; `None` at the end of the file.
fn chunk(input: &mut BufReader<File>, at: u64, length: u64) -> std::io::Result<Option<Chunk>> {
    if at + 8 > length {
        return Ok(None);
    }
    seek(input, at)?;
    let mut head = [0; 8];
    input.read_exact(&mut head)?;
    let [a, b, c, d, size @ ..] = head;
    Ok(Some(([a, b, c, d], u32::from_le_bytes(size), at + 8)))
}

/// Seeks within the buffer where possible.
fn seek(input: &mut BufReader<File>, to: u64) -> std::io::Result<()> {
    let now = input.stream_position()?;
    match i64::try_from(i128::from(to) - i128::from(now)) {
        Ok(step) => input.seek_relative(step),
        Err(_) => input.seek(SeekFrom::Start(to)).map(drop),
    }
}

/// Payload of the `hdrl` list and the offset of what follows it.
fn header(input: &mut BufReader<File>, length: u64) -> std::io::Result<Option<(Vec<u8>, u64)>> {
    let mut at = 12;
    while let Some((name, size, body)) = chunk(input, at, length)? {
        let end = body + u64::from(size);
        if &name == b"LIST" && (4..MAX_HEADER).contains(&size) && end <= length {
            let mut payload = vec![0; size as usize];
            input.read_exact(&mut payload)?;
            if payload.starts_with(b"hdrl") {
                payload.drain(..4);
                return Ok(Some((payload, end.next_multiple_of(2))));
            }
        }
        at = end.next_multiple_of(2);
    }
    Ok(None)
}

impl Avi {
    /// Payload of the next chunk of the video stream; lists are entered, all else is skipped.
    fn next_packet(&mut self) -> Result<Option<Vec<u8>>> {
        let io = |path: &Path, e| Error::io(path, "read", e);
        loop {
            let found = chunk(&mut self.input, self.at, self.length).map_err(|e| io(&self.path, e))?;
            let Some((name, size, body)) = found else { return Ok(None) };
            let end = body + u64::from(size);
            match &name {
                b"LIST" | b"RIFF" => {
                    let mut kind = [0; 4];
                    if self.input.read_exact(&mut kind).is_err() {
                        return Ok(None);
                    }
                    let enter = matches!(&kind, b"movi" | b"rec " | b"AVIX");
                    self.at = if enter { body + 4 } else { end.next_multiple_of(2) };
                }
                [a, b, b'd', b'c' | b'b'] if [*a, *b] == self.prefix => {
                    self.at = end.next_multiple_of(2);
                    if end > self.length || size > MAX_PACKET {
                        return Err(self.damaged("the file ends inside it"));
                    }
                    let mut data = vec![0; size as usize];
                    self.input.read_exact(&mut data).map_err(|e| io(&self.path, e))?;
                    return Ok(Some(data));
                }
                _ => self.at = end.next_multiple_of(2),
            }
        }
    }

    fn damaged(&mut self, why: &str) -> Error {
        self.over = true;
        let problem = format!("frame {} cannot be decoded: {why}", self.frames);
        Error::file(Kind::Data, &self.path, problem).remedy("cut the clip before this frame, or export it again")
    }

    fn decode(&mut self, packet: &[u8]) -> Result<Option<Picture>> {
        // An empty chunk repeats the frame before.
        if packet.is_empty() {
            return Ok(self.last.clone());
        }
        let picture = match Mjpeg.decode(packet) {
            Ok(picture) => picture,
            Err(Failure::Damaged(why) | Failure::Unsupported(why)) => return Err(self.damaged(&why)),
        };
        if let Some(p) = picture.as_ref().filter(|p| (p.width, p.height) != (self.info.width, self.info.height)) {
            let why = format!("it has {} × {} pixels; interlaced Motion JPEG needs ffmpeg", p.width, p.height);
            return Err(self.damaged(&why));
        }
        self.last.clone_from(&picture);
        Ok(picture)
    }
}

impl Source for Avi {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<RawFrame>> {
        while !self.over {
            let Some(packet) = self.next_packet()? else {
                self.over = true;
                break;
            };
            let picture = self.decode(&packet)?;
            let time_ns = duration_ns(self.frames, self.rate);
            self.frames += 1;
            if let Some(Picture { width, height, pixels }) = picture {
                return Ok(Some(RawFrame { width, height, time_ns, pixels }));
            }
        }
        // The header's count tells a recording that was cut off between two frames.
        let promised = self.info.frames.unwrap_or(0) as u64;
        if self.frames > 0 && self.frames < promised && self.last.take().is_some() {
            let problem = format!("it ends after {} of {promised} frames", self.frames);
            return Err(Error::file(Kind::Data, &self.path, problem).remedy("export the clip again"));
        }
        Ok(None)
    }
}
