//! MP4 with H.264, for browsers and players: 4:2:0, BT.709 limited range told in the stream and in the file, a keyframe
//! at least every second, tables before the frames so that it starts to play while it loads.
//!
//! A group of pictures, from keyframe to keyframe, depends on no other: groups are encoded in the background, on all
//! threads, and written in order. Where they begin follows from size and rate alone, so the bytes do not depend on the
//! number of threads.
//!
//! H.264 with 4:2:0 has even sizes only: an odd width or height gets one more column or row, a copy of the last.

mod avc_headers;
mod boxes;

use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use rusty_h264::{ChromaFormat, Encoder, EncoderConfig, Preset, Profile, YuvFrame};

use self::avc_headers as avc;
use self::boxes::Track;
use super::options::{FrameRate, SinkOptions, check_frame};
use crate::base::atomic_file::AtomicFile;
use crate::base::error::{Error, Kind, Result};
use crate::base::par::Tasks;
use crate::raster::image::Rgb8;
use crate::video::clip::{Matrix, Range, Sink};
use crate::video::yuv;

/// Quantiser of predicted frames, of 51, one finer for keyframes (a larger difference would pulse once a second). It
/// keeps the grain of water and fire at 45 dB and more.
const QUANTISER: u8 = 18;
/// Frames that a predicted frame may refer to.
const REFERENCES: u32 = 1;
/// Macroblocks of a frame that the highest level the encoder knows (5.2) admits.
const MAX_MACROBLOCKS: usize = 36_864;
/// Macroblocks per second that levels 4.0, 4.2, 5.0, 5.1 and 5.2 admit (ITU-T H.264, table A-1).
const LEVELS: [(u8, u64); 5] = [(40, 245_760), (42, 522_240), (50, 589_824), (51, 983_040), (52, u64::MAX)];
/// Block that frames are moved by when the tables are put before them.
const MOVE_BYTES: u64 = 1 << 20;

/// Most bytes of the frames of a group: large frames get keyframes more often.
const GROUP_BYTES: usize = 64 << 20;
/// Most bytes of all frames that wait for the encoder or are in it.
const WAITING_BYTES: usize = 256 << 20;
/// Fewest frames of a group: the encoder gives all keyframes one number (`idr_pic_id`), so two of them must not follow each other.
const SHORTEST_GROUP: usize = 2;

/// Most parts that the last group is split into, so that the end does not wait for one thread, and fewest frames of each:
/// every part costs a keyframe.
const LAST_PARTS: usize = 2;
const LAST_FRAMES: usize = 6;

/// Encodes frames and writes an MP4 file.
pub struct Mp4Writer {
    file: AtomicFile,
    config: EncoderConfig,
    options: SinkOptions,
    coded: (usize, usize),
    /// Frames of the group that is being collected.
    group: Vec<YuvFrame>,
    encoding: Tasks<Encoded>,
    /// Sequence and picture parameter set, from the first frame.
    headers: Option<(Vec<u8>, Vec<u8>)>,
    sizes: Vec<u32>,
    keyframes: Vec<u32>,
}

impl Mp4Writer {
    /// Starts a file under a temporary name.
    ///
    /// # Errors
    /// When the place cannot be written to, or frames are larger than H.264 level 5.2 admits (about 9 megapixels).
    pub fn create(path: &Path, options: SinkOptions) -> Result<Self> {
        let coded = (options.width.next_multiple_of(2), options.height.next_multiple_of(2));
        let macroblocks = coded.0.div_ceil(16) * coded.1.div_ceil(16);
        if macroblocks > MAX_MACROBLOCKS {
            let problem = format!("{} × {} is too large for H.264 video", options.width, options.height);
            return Err(Error::file(Kind::Limit, path, problem)
                .allowed("up to 9.4 megapixels, for example 4096 × 2304")
                .remedy("ask for a smaller size, or write a folder of PNG frames"));
        }
        let config = configuration(coded, macroblocks as u64, options.rate);
        Encoder::new(config.clone())
            .map_err(|e| Error::file(Kind::Unsupported, path, format!("cannot encode: {e}")))?;
        let (file, encoding) = (AtomicFile::create(path)?, Tasks::new(WAITING_BYTES));
        let (sizes, keyframes, group, headers) = (Vec::new(), Vec::new(), Vec::new(), None);
        Ok(Self { file, config, options, coded, group, encoding, headers, sizes, keyframes })
    }

    fn path(&self) -> PathBuf {
        self.file.path().to_path_buf()
    }

    /// Hands a group to the encoder, after making room for it.
    fn encode_group(&mut self, group: Vec<YuvFrame>) -> Result<()> {
        let bytes = group.len() * frame_bytes(self.coded);
        while !self.encoding.has_room(bytes) {
            let encoded = self.encoding.wait();
            self.write_group(encoded)?;
        }
        let config = self.config.clone();
        self.encoding.start(bytes, move || encode(config, &group));
        Ok(())
    }

    fn write_group(&mut self, encoded: Option<Encoded>) -> Result<()> {
        let pictures = encoded.unwrap_or_else(|| Ok(Vec::new())).map_err(|e| self.inner_error(&e))?;
        pictures.iter().try_for_each(|stream| self.write_picture(stream))
    }

    /// Writes one picture with its NAL units as length and bytes; parameter sets go to the tables instead.
    fn write_picture(&mut self, stream: &[u8]) -> Result<()> {
        let units = avc::nal_units(stream);
        let of_kind = |kind: u8| units.iter().find(|u| avc::kind(u) == kind).map(|u| u.to_vec());
        if self.headers.is_none() {
            self.headers = of_kind(avc::SPS).zip(of_kind(avc::PPS));
        }
        if units.iter().any(|u| avc::kind(u) == avc::IDR_SLICE) {
            self.keyframes.push(self.sizes.len() as u32);
        }
        let mut sample = Vec::with_capacity(stream.len() + 16);
        for unit in units.iter().filter(|u| !matches!(avc::kind(u), avc::SPS | avc::PPS)) {
            sample.extend((unit.len() as u32).to_be_bytes());
            sample.extend_from_slice(unit);
        }
        self.file.write_all(&sample).map_err(|e| Error::io(self.file.path(), "write", e))?;
        self.sizes.push(sample.len() as u32);
        Ok(())
    }

    fn inner_error(&self, problem: &str) -> Error {
        Error::file(Kind::Unsupported, self.file.path(), format!("the H.264 encoder failed: {problem}"))
            .remedy("write a folder of PNG frames instead")
    }
}

impl Sink for Mp4Writer {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        check_frame(self.file.path(), frame, self.options)?;
        let (width, height) = self.coded;
        let [y, u, v] = yuv::from_rgb8(&padded(frame, self.coded), Matrix::Bt709, Range::Limited);
        self.group.push(YuvFrame { width, height, y, u, v });
        if self.group.len() == self.config.gop_size as usize {
            let group = std::mem::take(&mut self.group);
            self.encode_group(group)?;
        }
        while let Some(encoded) = self.encoding.ready() {
            self.write_group(Some(encoded))?;
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        let part = last_part(self.group.len());
        let mut last = std::mem::take(&mut self.group).into_iter().peekable();
        while last.peek().is_some() {
            self.encode_group(last.by_ref().take(part).collect())?;
        }
        while let Some(encoded) = self.encoding.wait() {
            self.write_group(Some(encoded))?;
        }
        let Some((sps, pps)) = self.headers.take() else {
            return Err(Error::file(Kind::Unusable, self.file.path(), "no frame was written"));
        };
        let rate = self.options.rate;
        let sps = avc::with_usability(&sps, (rate.numerator(), rate.denominator()), REFERENCES);
        let record = sps.and_then(|sps| avc::configuration(&sps, &pps));
        let record = record.ok_or_else(|| self.inner_error("its parameter sets are not as expected"))?;
        // Fine enough units for other programs to shift the track by fractions of a frame.
        let scale = (10_000u32.div_ceil(rate.numerator())).next_power_of_two();
        let track = Track {
            size: (self.coded.0 as u16, self.coded.1 as u16),
            timescale: rate.numerator() * scale,
            frame_duration: rate.denominator() * scale,
            configuration: &record,
            sizes: &self.sizes,
            keyframes: &self.keyframes,
            frames_per_chunk: self.config.gop_size as usize,
        };
        put_tables_first(&mut self.file, &track).map_err(|e| Error::io(&self.path(), "write", e))?;
        self.file.commit()
    }
}

/// The pictures of a group as byte streams, or what went wrong.
type Encoded = Result<Vec<Vec<u8>>, String>;

/// Encodes a group: its first frame as a keyframe, each other one from the one before.
fn encode(config: EncoderConfig, group: &[YuvFrame]) -> Encoded {
    let mut encoder = Encoder::new(config).map_err(|e| e.to_string())?;
    let mut pictures = Vec::with_capacity(group.len());
    for frame in group {
        let stream = encoder.try_encode(frame).map_err(|e| e.to_string())?;
        // One call may return several pictures; a file's sample is one.
        let starts: Vec<usize> = picture_starts(&stream);
        let ends = starts.iter().skip(1).copied().chain([stream.len()]);
        pictures.extend(starts.iter().zip(ends).map(|(&start, end)| stream[start..end].to_vec()));
    }
    if pictures.len() == group.len() { Ok(pictures) } else { Err("some pictures did not come out".into()) }
}

/// The encoder's settings: constant quality, one picture out per picture in, so that nothing is held back.
fn configuration((width, height): (usize, usize), macroblocks: u64, rate: FrameRate) -> EncoderConfig {
    let per_second = macroblocks * u64::from(rate.numerator()) / u64::from(rate.denominator());
    let level = LEVELS.iter().find(|(_, most)| per_second <= *most).map_or(52, |&(level, _)| level);
    let mut config = EncoderConfig::new(width, height);
    config.profile = Profile::High;
    config.chroma = ChromaFormat::Yuv420;
    config.cabac = true;
    config.transform_8x8 = true;
    config.preset = Preset::Balanced;
    config.level_idc = level;
    config.qp = QUANTISER;
    config.gop_size = group_frames((width, height), rate) as u32;
    config.min_keyint = 1;
    config.scenecut = 0;
    config.bitrate = 0;
    config.framerate = rate.fps() as f32;
    config.num_ref_frames = REFERENCES;
    config.i_qp_offset = -1;
    config.bframes = 0;
    config.mbtree = false;
    config.weightp = false;
    // Trying every partition in full halves the speed and saves one byte in a hundred.
    config.tune_shape_rd = false;
    config
}

/// Frames from keyframe to keyframe: at most a second and [`GROUP_BYTES`], at least [`SHORTEST_GROUP`].
fn group_frames(size: (usize, usize), rate: FrameRate) -> usize {
    let second = (rate.numerator() / rate.denominator()) as usize;
    second.min(GROUP_BYTES / frame_bytes(size)).max(SHORTEST_GROUP)
}

/// Frames of each part of a last group of `frames`, the last part perhaps with fewer.
fn last_part(frames: usize) -> usize {
    frames.div_ceil((frames / LAST_FRAMES).clamp(1, LAST_PARTS))
}

/// Bytes of a frame in 4:2:0.
fn frame_bytes((width, height): (usize, usize)) -> usize {
    width * height * 3 / 2
}

/// `frame` with its last column and row repeated up to `width × height`.
fn padded(frame: &Rgb8, (width, height): (usize, usize)) -> std::borrow::Cow<'_, Rgb8> {
    if (frame.width, frame.height) == (width, height) {
        return std::borrow::Cow::Borrowed(frame);
    }
    let mut data = Vec::with_capacity(width * height * 3);
    for y in 0..height {
        let start = y.min(frame.height - 1) * frame.width * 3;
        let row = &frame.data[start..start + frame.width * 3];
        data.extend_from_slice(row);
        (frame.width..width).for_each(|_| data.extend_from_slice(&row[row.len() - 3..]));
    }
    std::borrow::Cow::Owned(Rgb8 { width, height, data })
}

/// Where the pictures of a byte stream begin, parameter sets counted to the picture that follows them.
fn picture_starts(stream: &[u8]) -> Vec<usize> {
    let mut starts = Vec::new();
    let mut pending = None;
    for unit in avc::nal_units(stream) {
        // The start code takes the three bytes before the unit.
        let at = unit.as_ptr() as usize - stream.as_ptr() as usize - 3;
        if avc::starts_picture(unit) {
            starts.push(pending.take().unwrap_or(at));
        } else if !matches!(avc::kind(unit), avc::SLICE | avc::IDR_SLICE) {
            pending.get_or_insert(at);
        }
    }
    starts
}

/// Moves the frames, which lie at the start of the file, back by the length of the tables, and writes the tables there.
fn put_tables_first(file: &mut AtomicFile, track: &Track) -> std::io::Result<()> {
    let length = track.sizes.iter().map(|&size| u64::from(size)).sum::<u64>();
    let head = [boxes::file_type(), boxes::movie(track, 0), boxes::media_head(length)].concat();
    let shift = head.len() as u64;
    let mut buffer = vec![0; MOVE_BYTES.min(length) as usize];
    let mut end = length;
    while end > 0 {
        let start = end.saturating_sub(MOVE_BYTES);
        let block = &mut buffer[..(end - start) as usize];
        file.seek(SeekFrom::Start(start))?;
        file.read_exact(block)?;
        file.seek(SeekFrom::Start(start + shift))?;
        file.write_all(block)?;
        end = start;
    }
    file.seek(SeekFrom::Start(0))?;
    file.write_all(&[boxes::file_type(), boxes::movie(track, shift), boxes::media_head(length)].concat())
}
