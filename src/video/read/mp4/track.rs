//! The video track of a movie: where its samples lie, when they are shown, what codec they use.

use super::boxes::{Bytes, Name, child, children, find};
use crate::video::clip::Turn;
use crate::video::read::h264::Colour;

/// Most samples a track may have (four days at 25 frames per second).
const MAX_SAMPLES: usize = 8 << 20;
/// Largest number of edits that is honoured.
const MAX_EDITS: usize = 4096;

/// One sample, in decoding order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sample {
    /// Byte offset in the file.
    pub offset: u64,
    /// Bytes.
    pub size: u32,
    /// Composition time in media units; may be negative.
    pub shown: i64,
    /// Duration in media units.
    pub duration: u32,
    /// Whether decoding may start here.
    pub sync: bool,
}

/// One entry of an edit list, in media units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Edit {
    /// How long it lasts.
    pub duration: i64,
    /// Media time it starts at; `None` shows nothing (an empty edit).
    pub media: Option<i64>,
}

/// A video track.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Four-character code of the sample description.
    pub codec: Name,
    /// Size in the sample description.
    pub size: (usize, usize),
    /// The `avcC` record, where there is one.
    pub avcc: Option<Vec<u8>>,
    /// Colour from a `colr` box.
    pub colour: Colour,
    /// Display rotation.
    pub turn: Turn,
    /// Media units per second.
    pub timescale: u32,
    /// Edits; none means the media as it is.
    pub edits: Vec<Edit>,
    /// Samples in decoding order.
    pub samples: Vec<Sample>,
}

/// What is wrong with a movie's tables.
pub type Problem = String;

impl Track {
    /// The video track with the most samples in the payload of `moov`.
    ///
    /// # Errors
    /// In words, when there is none or its tables contradict each other.
    pub fn from_moov(moov: &[u8]) -> Result<Self, Problem> {
        let movie_scale = find(moov, &[b"mvhd"]).and_then(timescale).filter(|&s| s > 0).unwrap_or(1000);
        let is_video =
            |trak: &&[u8]| find(trak, &[b"mdia", b"hdlr"]).is_some_and(|hdlr| hdlr.get(8..12) == Some(b"vide"));
        let mut tracks = children(moov).filter(|(name, _)| name == b"trak").map(|(_, body)| body).filter(is_video);
        // One at a time: a few bytes may claim a long table of samples, and a file many such tracks.
        let longest = tracks.try_fold(None, |best: Option<Self>, trak| {
            let track = Self::from_trak(trak, movie_scale)?;
            Ok::<_, Problem>(Some(match best {
                Some(best) if best.samples.len() >= track.samples.len() => best,
                _ => track,
            }))
        })?;
        longest.ok_or_else(|| "it has no video track".into())
    }

    fn from_trak(trak: &[u8], movie_scale: u32) -> Result<Self, Problem> {
        let missing = |what: &str| format!("its {what} is missing or damaged");
        let timescale = find(trak, &[b"mdia", b"mdhd"]).and_then(timescale).filter(|&s| s > 0);
        let timescale = timescale.ok_or_else(|| missing("time scale"))?;
        let tables = find(trak, &[b"mdia", b"minf", b"stbl"]).ok_or_else(|| missing("sample table"))?;
        let entry = child(tables, b"stsd").and_then(first_entry).ok_or_else(|| missing("sample description"))?;
        let (codec, description) = entry;
        let header = description.get(..78).unwrap_or_default();
        let size = |at: usize| header.get(at..at + 2).map_or(0, |b| usize::from(u16::from_be_bytes([b[0], b[1]])));
        let extensions = description.get(78..).unwrap_or_default();
        Ok(Self {
            codec,
            size: (size(24), size(26)),
            avcc: child(extensions, b"avcC").map(<[u8]>::to_vec),
            colour: child(extensions, b"colr").map(colour).unwrap_or_default(),
            turn: child(trak, b"tkhd").and_then(turn).unwrap_or_default(),
            timescale,
            edits: find(trak, &[b"edts", b"elst"]).map(|elst| edits(elst, movie_scale, timescale)).unwrap_or_default(),
            samples: samples(tables)?,
        })
    }
}

/// Time scale of `mvhd` and `mdhd`.
fn timescale(payload: &[u8]) -> Option<u32> {
    let mut b = Bytes(payload);
    let wide = b.version()? == 1;
    b.skip(if wide { 16 } else { 8 })?;
    b.u32()
}

fn first_entry(stsd: &[u8]) -> Option<(Name, &[u8])> {
    children(stsd.get(8..)?).next()
}

/// `colr` of type `nclx` (with a range flag) or QuickTime's `nclc`.
fn colour(payload: &[u8]) -> Colour {
    let mut b = Bytes(payload);
    let read = |b: &mut Bytes| {
        let kind: Name = b.take(4)?.try_into().ok()?;
        matches!(&kind, b"nclx" | b"nclc").then_some(())?;
        b.skip(4)?;
        let matrix = Some(b.u16()? as u8).filter(|&m| m != 2);
        let full_range = if &kind == b"nclx" { Some(b.u8()? & 0x80 != 0) } else { None };
        Some(Colour { matrix, full_range })
    };
    read(&mut b).unwrap_or_default()
}

/// Rotation of the display matrix in `tkhd` (§8.3.2), to the nearest quarter.
fn turn(payload: &[u8]) -> Option<Turn> {
    let mut b = Bytes(payload);
    let wide = b.version()? == 1;
    b.skip(if wide { 32 } else { 20 } + 16)?;
    let (a, right) = (b.i32()?, b.i32()?);
    b.skip(4)?;
    let (left, d) = (b.i32()?, b.i32()?);
    Some(if a.unsigned_abs().max(d.unsigned_abs()) >= right.unsigned_abs().max(left.unsigned_abs()) {
        if a < 0 && d < 0 { Turn::Half } else { Turn::None }
    } else if right > 0 && left < 0 {
        Turn::Right
    } else if right < 0 && left > 0 {
        Turn::Left
    } else {
        Turn::None
    })
}

/// The edit list (§8.6.6) in media units.
fn edits(elst: &[u8], movie_scale: u32, timescale: u32) -> Vec<Edit> {
    let mut b = Bytes(elst);
    let mut read = || {
        let wide = b.version()? == 1;
        let count = (b.u32()? as usize).min(MAX_EDITS);
        let mut edits = Vec::new();
        for _ in 0..count {
            let entry = if wide { (b.u64()?, b.i64()?) } else { (b.u32()?.into(), b.i32()?.into()) };
            b.skip(4)?;
            let scaled = u128::from(entry.0) * u128::from(timescale) + u128::from(movie_scale / 2);
            let duration = i64::try_from(scaled / u128::from(movie_scale)).unwrap_or(i64::MAX);
            edits.push(Edit { duration, media: (entry.1 >= 0).then_some(entry.1) });
        }
        Some(edits)
    };
    read().unwrap_or_default()
}

/// Sample tables (§8.6, §8.7) unrolled.
fn samples(tables: &[u8]) -> Result<Vec<Sample>, Problem> {
    let sizes = sizes(tables)?;
    let offsets = offsets(tables, &sizes)?;
    let times = times(tables, sizes.len());
    let mut out: Vec<Sample> = sizes
        .iter()
        .zip(offsets)
        .zip(times)
        .map(|((&size, offset), (shown, duration))| Sample { offset, size, shown, duration, sync: true })
        .collect();
    if let Some(stss) = child(tables, b"stss") {
        out.iter_mut().for_each(|s| s.sync = false);
        let mut b = Bytes(stss.get(8..).unwrap_or_default());
        while let Some(number) = b.u32() {
            if let Some(sample) = (number as usize).checked_sub(1).and_then(|i| out.get_mut(i)) {
                sample.sync = true;
            }
        }
    }
    Ok(out)
}

fn sizes(tables: &[u8]) -> Result<Vec<u32>, Problem> {
    let damaged = || "its table of sample sizes is missing or damaged".to_string();
    let compact = child(tables, b"stz2");
    let mut b = Bytes(child(tables, b"stsz").or(compact).ok_or_else(damaged)?);
    let mut head = || Some((b.version()?, b.u32()?, b.u32()? as usize));
    let (_, size, count) = head().ok_or_else(damaged)?;
    if count > MAX_SAMPLES {
        return Err(format!("it claims {count} samples"));
    }
    let all = match (compact.is_some() && child(tables, b"stsz").is_none(), size) {
        (false, 0) => (0..count).map(|_| b.u32()).collect(),
        (false, size) => Some(vec![size; count]),
        (true, 4) => {
            let nibbles = b.0.iter().flat_map(|byte| [byte >> 4, byte & 15]).map(u32::from);
            Some(nibbles.take(count).collect::<Vec<_>>()).filter(|v| v.len() == count)
        }
        (true, 8) => (0..count).map(|_| b.u8().map(u32::from)).collect(),
        (true, _) => (0..count).map(|_| b.u16().map(u32::from)).collect(),
    };
    all.ok_or_else(damaged)
}

/// Chunk offsets and the run-length table of samples per chunk (§8.7.4), as one offset per sample.
fn offsets(tables: &[u8], sizes: &[u32]) -> Result<Vec<u64>, Problem> {
    let damaged = || "its table of chunks is missing or damaged".to_string();
    let mut runs = Vec::new();
    let mut b = Bytes(child(tables, b"stsc").and_then(|p| p.get(8..)).ok_or_else(damaged)?);
    while let (Some(first), Some(samples), Some(_)) = (b.u32(), b.u32(), b.u32()) {
        runs.push((first, samples));
    }
    let wide = child(tables, b"co64");
    let payload = child(tables, b"stco").or(wide).and_then(|p| p.get(8..)).ok_or_else(damaged)?;
    let step = if child(tables, b"stco").is_some() { 4 } else { 8 };
    let mut out = Vec::with_capacity(sizes.len());
    let mut run = 0;
    for (chunk, entry) in payload.chunks_exact(step).enumerate() {
        while runs.get(run + 1).is_some_and(|&(first, _)| first as usize <= chunk + 1) {
            run += 1;
        }
        let &(_, count) = runs.get(run).ok_or_else(damaged)?;
        let mut offset = entry.iter().fold(0u64, |n, &b| n << 8 | u64::from(b));
        let end = out.len().saturating_add(count as usize).min(sizes.len());
        for size in &sizes[out.len()..end] {
            out.push(offset);
            offset = offset.checked_add(u64::from(*size)).ok_or_else(damaged)?;
        }
    }
    if out.len() == sizes.len() { Ok(out) } else { Err(damaged()) }
}

/// Composition time and duration of every sample, from `stts` and `ctts` (§8.6.1).
fn times(tables: &[u8], count: usize) -> Vec<(i64, u32)> {
    let durations = runs(child(tables, b"stts"), count);
    let shifts = runs(child(tables, b"ctts"), count);
    let mut decoded = 0i64;
    let mut out = Vec::with_capacity(count);
    for (duration, shift) in durations.into_iter().zip(shifts) {
        // Both versions of `ctts` are read as signed: writers put negative shifts into version 0 too.
        out.push((decoded + i64::from(shift as i32), duration));
        decoded += i64::from(duration);
    }
    out
}

/// A run-length table unrolled to `count` values; the last value goes on when the table is short.
fn runs(table: Option<&[u8]>, count: usize) -> Vec<u32> {
    let mut out = Vec::with_capacity(count);
    let mut b = Bytes(table.and_then(|p| p.get(8..)).unwrap_or_default());
    while let (Some(n), Some(value)) = (b.u32(), b.u32()) {
        let end = out.len().saturating_add(n as usize).min(count);
        out.resize(end, value);
    }
    let last = out.last().copied().unwrap_or(0);
    out.resize(count, last);
    out
}
