//! YUV4MPEG2 streams: reading. 8-bit 4:2:0, 4:2:2, 4:4:4, 4:1:1 and monochrome.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use super::decoder::MAX_PIXELS;
use super::h264::Colour;
use crate::base::error::{Error, Kind, Result};
use crate::video::clip::{ClipInfo, Pixels, RawFrame, Source, Turn};

/// Longest header line.
const MAX_LINE: u64 = 4096;

/// What a file holds.
pub enum Content {
    /// The embedded reader reads it.
    Clip(Box<Y4m>),
    /// It needs another decoder, for the reason named.
    Other(String),
}

/// A Y4M file being read.
pub struct Y4m {
    path: PathBuf,
    info: ClipInfo,
    input: BufReader<File>,
    subsampling: (u8, u8),
    mono: bool,
    colour: Colour,
    /// Frames per second as a ratio.
    rate: (u64, u64),
    frames: u64,
    over: bool,
}

/// Opens a file.
///
/// # Errors
/// When it cannot be read or its header is damaged.
pub fn open(path: &Path) -> Result<Content> {
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    let mut input = BufReader::with_capacity(1 << 20, file);
    let line = line(&mut input).map_err(|e| Error::io(path, "read", e))?;
    let damaged = |what: &str| Error::file(Kind::Data, path, format!("its Y4M header has no sound {what}"));
    let field = |tag: char| line.split(' ').skip(1).find_map(|f| f.strip_prefix(tag));
    let number = |tag| field(tag).and_then(|v: &str| v.parse::<usize>().ok()).filter(|&v| v > 0);
    let (width, height) = (number('W').ok_or_else(|| damaged("width"))?, number('H').ok_or_else(|| damaged("height"))?);
    if width.saturating_mul(height) > MAX_PIXELS {
        return Err(damaged("size").allowed(format!("up to {MAX_PIXELS} pixels")));
    }
    let rate = field('F').and_then(|f| f.split_once(':')).and_then(|(n, d)| Some((n.parse().ok()?, d.parse().ok()?)));
    let rate = rate.filter(|&(n, d)| n > 0 && d > 0).unwrap_or((25, 1));
    let space = field('C').unwrap_or("420");
    let (subsampling, mono) = match space {
        "420" | "420jpeg" | "420mpeg2" | "420paldv" => ((2, 2), false),
        "422" => ((2, 1), false),
        "444" => ((1, 1), false),
        "411" => ((4, 1), false),
        "mono" => ((1, 1), true),
        other => return Ok(Content::Other(format!("Y4M with colour space {other}"))),
    };
    let full = line.contains("XCOLORRANGE=FULL");
    let colour = Colour { matrix: None, full_range: Some(full) };
    let info = ClipInfo {
        width,
        height,
        turn: Turn::None,
        frames: None,
        duration_ns: None,
        codec: format!("Y4M {space}"),
        decoder: "embedded y4m",
    };
    let path = path.to_path_buf();
    Ok(Content::Clip(Box::new(Y4m { path, info, input, subsampling, mono, colour, rate, frames: 0, over: false })))
}

/// A line without its end; empty at the end of the file.
fn line(input: &mut impl BufRead) -> std::io::Result<String> {
    let mut bytes = Vec::new();
    input.take(MAX_LINE).read_until(b'\n', &mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).trim_end().to_string())
}

impl Y4m {
    fn planes(&mut self) -> std::io::Result<[Vec<u8>; 3]> {
        let (w, h) = (self.info.width, self.info.height);
        let chroma = w.div_ceil(self.subsampling.0.into()) * h.div_ceil(self.subsampling.1.into());
        let mut plane = |n: usize| {
            let mut data = vec![0; n];
            self.input.read_exact(&mut data).map(|()| data)
        };
        let luma = plane(w * h)?;
        Ok(if self.mono { [luma, vec![128; w * h], vec![128; w * h]] } else { [luma, plane(chroma)?, plane(chroma)?] })
    }

    fn damaged(&mut self, why: &str) -> Error {
        self.over = true;
        let problem = format!("frame {} is damaged: {why}", self.frames);
        Error::file(Kind::Data, &self.path, problem).remedy("write the stream again")
    }
}

impl Source for Y4m {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<RawFrame>> {
        if self.over {
            return Ok(None);
        }
        let head = line(&mut self.input).map_err(|e| Error::io(&self.path, "read", e))?;
        if head.is_empty() {
            self.over = true;
            return Ok(None);
        }
        if !head.starts_with("FRAME") {
            return Err(self.damaged("it does not begin with FRAME"));
        }
        let Ok(planes) = self.planes() else { return Err(self.damaged("the file ends inside it")) };
        let time = u128::from(self.frames) * 1_000_000_000 * u128::from(self.rate.1) / u128::from(self.rate.0);
        let time_ns = u64::try_from(time).unwrap_or(u64::MAX);
        self.frames += 1;
        let (width, height) = (self.info.width, self.info.height);
        let (matrix, range) = self.colour.resolve(width, height);
        let pixels = Pixels::Yuv { planes, subsampling: self.subsampling, matrix, range };
        Ok(Some(RawFrame { width, height, time_ns, pixels }))
    }
}
