//! Clips made from scratch: pictures, and small hand-made containers around them.

use enliven::raster::image::Rgb8;
use enliven::video::clip::{Matrix, Range};
use enliven::video::yuv::from_rgb8;
use image::{ExtendedColorType, ImageEncoder};
use rusty_h264::{Encoder, EncoderConfig, YuvFrame};

/// Frame `t` of the test clip: a moving gradient on the right, and on the left a grey that tells the frame's number.
pub fn picture(t: usize, width: usize, height: usize) -> Rgb8 {
    let mut image = Rgb8::black(width, height);
    for (i, pixel) in image.data.chunks_exact_mut(3).enumerate() {
        let (x, y) = (i % width, i / width);
        let grey = 30 + 8 * t as u8;
        pixel.copy_from_slice(&if x < width / 2 {
            [grey; 3]
        } else {
            [(40 + (4 * x + 9 * t) % 160) as u8, 90, (60 + 2 * y % 120) as u8]
        });
    }
    image
}

/// The number of a decoded frame of the test clip.
pub fn number(image: &Rgb8) -> usize {
    let (x, y) = (image.width / 4, image.height / 2);
    ((f64::from(image.pixel(x, y)[1]) - 30.0) / 8.0).round() as usize
}

/// One coded picture: its NAL units with lengths, and whether it stands alone.
pub type Sample = (Vec<u8>, bool);

/// H.264 in MP4 form: parameter sets and samples; each stands alone when `intra`.
pub fn h264(frames: &[Rgb8], intra: bool) -> (Vec<u8>, Vec<u8>, Vec<Sample>) {
    let mut config = EncoderConfig::new(frames[0].width, frames[0].height);
    config.gop_size = if intra { 1 } else { 30 };
    config.bframes = 0;
    config.mbtree = false;
    config.scenecut = 0;
    config.qp = 8;
    let mut encoder = Encoder::new(config).unwrap();
    let (mut sps, mut pps, mut samples) = (Vec::new(), Vec::new(), Vec::new());
    for frame in frames {
        let [y, u, v] = from_rgb8(frame, Matrix::Bt601, Range::Limited);
        let stream = encoder.encode(&YuvFrame { width: frame.width, height: frame.height, y, u, v });
        let (mut sample, mut key) = (Vec::new(), false);
        for unit in units(&stream) {
            match unit[0] & 31 {
                7 => sps = unit.to_vec(),
                8 => pps = unit.to_vec(),
                kind => {
                    key |= kind == 5;
                    sample.extend((unit.len() as u32).to_be_bytes());
                    sample.extend(unit);
                }
            }
        }
        samples.push((sample, key));
    }
    (sps, pps, samples)
}

fn units(stream: &[u8]) -> Vec<&[u8]> {
    let starts: Vec<usize> = (0..stream.len().saturating_sub(2)).filter(|&i| stream[i..i + 3] == [0, 0, 1]).collect();
    let ends = starts.iter().skip(1).copied().chain([stream.len() + 1]);
    let trim = |unit: &'_ [u8]| unit.iter().rposition(|&b| b != 0).map_or(0, |last| last + 1);
    starts.iter().zip(ends).map(|(&s, e)| &stream[s + 3..(e).min(stream.len())]).map(|u| &u[..trim(u)]).collect()
}

pub fn boxed(name: &[u8; 4], payload: &[u8]) -> Vec<u8> {
    [&(payload.len() as u32 + 8).to_be_bytes(), name.as_slice(), payload].concat()
}

fn words(values: impl IntoIterator<Item = u32>) -> Vec<u8> {
    values.into_iter().flat_map(u32::to_be_bytes).collect()
}

/// What a hand-made MP4 differs in. Times are in units of 1/1000 s for movie and media alike.
pub struct Mp4 {
    pub codec: [u8; 4],
    pub size: (u16, u16),
    /// Duration of every sample.
    pub durations: Vec<u32>,
    /// Composition offset of every sample, if any.
    pub shifts: Option<Vec<i32>>,
    /// Duration and media time (−1 for empty) of edits.
    pub edits: Vec<(u32, i32)>,
    /// `a b c d` of the display matrix.
    pub matrix: [i32; 4],
    pub wide_offsets: bool,
}

impl Mp4 {
    pub fn new(size: (u16, u16), durations: Vec<u32>) -> Self {
        let (shifts, edits, matrix) = (None, Vec::new(), [1, 0, 0, 1]);
        Self { codec: *b"avc1", size, durations, shifts, edits, matrix, wide_offsets: false }
    }

    /// The file: tables first, then the samples.
    pub fn file(&self, (sps, pps, samples): &(Vec<u8>, Vec<u8>, Vec<Sample>)) -> Vec<u8> {
        let ftyp = boxed(b"ftyp", b"isom\0\0\0\0");
        let length = self.moov(sps, pps, samples, 0).len();
        let moov = self.moov(sps, pps, samples, (ftyp.len() + length + 8) as u32);
        let data: Vec<u8> = samples.iter().flat_map(|(s, _)| s).copied().collect();
        [ftyp, moov, boxed(b"mdat", &data)].concat()
    }

    fn moov(&self, sps: &[u8], pps: &[u8], samples: &[Sample], offset: u32) -> Vec<u8> {
        let mvhd = boxed(b"mvhd", &[words([0, 0, 0, 1000, 0]), vec![0; 80]].concat());
        let [a, b, c, d] = self.matrix.map(|v| (v * 65536) as u32);
        let matrix = words([a, b, 0, c, d, 0, 0, 0, 1 << 30]);
        let tkhd = boxed(b"tkhd", &[words([0, 0, 0, 1, 0, 0, 0, 0, 0, 0]), matrix, words([0, 0])].concat());
        let edits = self.edits.iter().flat_map(|&(d, m)| [d, m as u32, 1 << 16]);
        let elst = boxed(b"elst", &words([0, self.edits.len() as u32].into_iter().chain(edits)));
        let mdhd = boxed(b"mdhd", &words([0, 0, 0, 1000, 0, 0]));
        let hdlr = boxed(b"hdlr", &[words([0, 0]), b"vide".to_vec(), vec![0; 13]].concat());
        let minf = boxed(b"minf", &boxed(b"stbl", &self.tables(sps, pps, samples, offset)));
        let mdia = boxed(b"mdia", &[mdhd, hdlr, minf].concat());
        let edts = if self.edits.is_empty() { Vec::new() } else { boxed(b"edts", &elst) };
        boxed(b"moov", &[mvhd, boxed(b"trak", &[tkhd, edts, mdia].concat())].concat())
    }

    fn tables(&self, sps: &[u8], pps: &[u8], samples: &[Sample], offset: u32) -> Vec<u8> {
        let set = |nal: &[u8]| [vec![1], (nal.len() as u16).to_be_bytes().to_vec(), nal.to_vec()].concat();
        let profile = sps.get(1..4).unwrap_or(&[66, 0, 30]);
        let avcc = [&[1], profile, &[0xff], &set(sps), &set(pps)].concat();
        let mut entry = vec![0; 78];
        entry[24..26].copy_from_slice(&self.size.0.to_be_bytes());
        entry[26..28].copy_from_slice(&self.size.1.to_be_bytes());
        entry.extend(boxed(b"avcC", &avcc));
        let stsd = boxed(b"stsd", &[words([0, 1]), boxed(&self.codec, &entry)].concat());
        let n = samples.len() as u32;
        let stts = boxed(b"stts", &words([0, n].into_iter().chain(self.durations.iter().flat_map(|&d| [1, d]))));
        let shifts = self.shifts.iter().flatten().flat_map(|&s| [1, s as u32]);
        let ctts = boxed(b"ctts", &words([1 << 24, n].into_iter().chain(shifts)));
        let keys: Vec<u32> = (1..).zip(samples).filter(|(_, s)| s.1).map(|(i, _)| i).collect();
        let stss = boxed(b"stss", &words([0, keys.len() as u32].into_iter().chain(keys)));
        let stsz = boxed(b"stsz", &words([0, 0, n].into_iter().chain(samples.iter().map(|s| s.0.len() as u32))));
        let stsc = boxed(b"stsc", &words([0, 1, 1, n, 1]));
        let offsets = match self.wide_offsets {
            true => boxed(b"co64", &words([0, 1, 0, offset])),
            false => boxed(b"stco", &words([0, 1, offset])),
        };
        let ctts = if self.shifts.is_some() { ctts } else { Vec::new() };
        [stsd, stts, ctts, stss, stsz, stsc, offsets].concat()
    }
}

/// A plain MP4 of the test clip.
pub fn mp4(frames: &[Rgb8]) -> Vec<u8> {
    let size = (frames[0].width as u16, frames[0].height as u16);
    Mp4::new(size, vec![40; frames.len()]).file(&h264(frames, false))
}

fn chunk(name: &[u8; 4], payload: &[u8]) -> Vec<u8> {
    let padding = vec![0; payload.len() % 2];
    [name.as_slice(), &(payload.len() as u32).to_le_bytes(), payload, &padding].concat()
}

fn list(kind: &[u8; 4], payload: &[u8]) -> Vec<u8> {
    chunk(b"LIST", &[kind.as_slice(), payload].concat())
}

/// An AVI whose frames are `packets` of the codec `code`, 25 a second.
pub fn avi(code: &[u8; 4], (width, height): (u32, u32), packets: &[Vec<u8>]) -> Vec<u8> {
    let little = |values: &[u32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let strh = [b"vids".as_slice(), code, &little(&[0, 0, 0, 1, 25, 0, packets.len() as u32, 0, 0, 0, 0, 0])].concat();
    let strf = [little(&[40, width, height, 1 | 24 << 16]), code.to_vec(), little(&[0; 5])].concat();
    let strl = list(b"strl", &[chunk(b"strh", &strh), chunk(b"strf", &strf)].concat());
    let hdrl = list(b"hdrl", &[chunk(b"avih", &[0; 56]), strl].concat());
    let movi = list(b"movi", &packets.iter().flat_map(|p| chunk(b"00dc", p)).collect::<Vec<_>>());
    chunk(b"RIFF", &[b"AVI ".as_slice(), &hdrl, &movi].concat())
}

pub fn jpeg(frame: &Rgb8) -> Vec<u8> {
    let mut out = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut out, 95)
        .write_image(&frame.data, frame.width as u32, frame.height as u32, ExtendedColorType::Rgb8)
        .unwrap();
    out
}

pub fn gif(frames: &[Rgb8]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = gif::Encoder::new(&mut out, frames[0].width as u16, frames[0].height as u16, &[]).unwrap();
    for frame in frames {
        let mut frame = gif::Frame::from_rgb_speed(frame.width as u16, frame.height as u16, &frame.data, 10);
        frame.delay = 4;
        encoder.write_frame(&frame).unwrap();
    }
    drop(encoder);
    out
}

pub fn apng(frames: &[Rgb8]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, frames[0].width as u32, frames[0].height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_animated(frames.len() as u32, 0).unwrap();
    encoder.set_frame_delay(1, 25).unwrap();
    let mut writer = encoder.write_header().unwrap();
    frames.iter().for_each(|f| writer.write_image_data(&f.data).unwrap());
    writer.finish().unwrap();
    out
}

pub fn webp(frames: &[Rgb8]) -> Vec<u8> {
    let small = |v: usize| (v as u32).to_le_bytes()[..3].to_vec();
    let (width, height) = (frames[0].width, frames[0].height);
    let canvas = [small(width - 1), small(height - 1)].concat();
    let frame = |f: &Rgb8| {
        let mut still = Vec::new();
        image::codecs::webp::WebPEncoder::new_lossless(&mut still)
            .encode(&f.data, width as u32, height as u32, ExtendedColorType::Rgb8)
            .unwrap();
        chunk(b"ANMF", &[small(0), small(0), canvas.clone(), small(40), vec![2], still[12..].to_vec()].concat())
    };
    let vp8x = chunk(b"VP8X", &[vec![2, 0, 0, 0], canvas.clone()].concat());
    let anim = chunk(b"ANIM", &[0; 6]);
    let all = [b"WEBP".to_vec(), vp8x, anim, frames.iter().flat_map(frame).collect()].concat();
    chunk(b"RIFF", &all)
}

pub fn y4m(frames: &[Rgb8]) -> Vec<u8> {
    let mut out =
        format!("YUV4MPEG2 W{} H{} F25:1 Ip A1:1 C420mpeg2\n", frames[0].width, frames[0].height).into_bytes();
    for frame in frames {
        out.extend(b"FRAME\n");
        from_rgb8(frame, Matrix::Bt601, Range::Limited).iter().for_each(|p| out.extend(p));
    }
    out
}

fn element(id: &[u8], payload: &[u8]) -> Vec<u8> {
    let size = (payload.len() as u64 | 1 << 56).to_be_bytes();
    [id, &size, payload].concat()
}

/// A WebM file around `packets`, one every 40 ms.
pub fn webm_of(codec: &str, (width, height): (u16, u16), packets: &[Vec<u8>]) -> Vec<u8> {
    let versions = [element(&[0x42, 0x87], &[2]), element(&[0x42, 0x85], &[2])].concat();
    let head = element(&[0x1a, 0x45, 0xdf, 0xa3], &[element(&[0x42, 0x82], b"webm"), versions].concat());
    let apps = [element(&[0x4d, 0x80], b"test"), element(&[0x57, 0x41], b"test")].concat();
    let info = element(&[0x15, 0x49, 0xa9, 0x66], &[element(&[0x2a, 0xd7, 0xb1], &[0x0f, 0x42, 0x40]), apps].concat());
    let video = [element(&[0xb0], &width.to_be_bytes()), element(&[0xba], &height.to_be_bytes())].concat();
    let (number, uid, kind) = (element(&[0xd7], &[1]), element(&[0x73, 0xc5], &[1]), element(&[0x83], &[1]));
    let codec = element(&[0x86], codec.as_bytes());
    let entry = element(&[0xae], &[number, uid, kind, codec, element(&[0xe0], &video)].concat());
    let tracks = element(&[0x16, 0x54, 0xae, 0x6b], &entry);
    let block = |(i, p): (usize, &Vec<u8>)| {
        let time = (40 * i as u16).to_be_bytes();
        element(&[0xa3], &[&[0x81, time[0], time[1], 0x80], p.as_slice()].concat())
    };
    let blocks: Vec<u8> = packets.iter().enumerate().flat_map(block).collect();
    let cluster = element(&[0x1f, 0x43, 0xb6, 0x75], &[element(&[0xe7], &[0]), blocks].concat());
    [head, element(&[0x18, 0x53, 0x80, 0x67], &[info, tracks, cluster].concat())].concat()
}

pub fn webm(frames: &[Rgb8]) -> Vec<u8> {
    let (width, height) = (frames[0].width, frames[0].height);
    let mut encoder = rusty_vp9::Vp9Encoder::default();
    let config = rusty_vp9::Vp9EncoderConfig { crf: Some(12), lag: Some(0), speed: Some(6), ..Default::default() };
    encoder.configure(&config).unwrap();
    for frame in frames {
        let [y, u, v] = from_rgb8(frame, Matrix::Bt601, Range::Limited);
        let strides = [width, width.div_ceil(2), width.div_ceil(2)];
        encoder.push_frame([&y, &u, &v], strides, width as u32, height as u32).unwrap();
    }
    encoder.flush();
    let packets: Vec<Vec<u8>> = std::iter::from_fn(|| encoder.next_packet().ok().map(|p| p.data)).collect();
    webm_of("V_VP9", (width as u16, height as u16), &packets)
}
