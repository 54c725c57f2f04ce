//! H.264 (ITU-T H.264): parameter sets, and the embedded decoder behind our trait.

use super::decoder::{Failure, MAX_PIXELS, Picture, VideoDecoder, guarded};
use crate::video::clip::{Matrix, Pixels, Range};

/// Reads an RBSP bit by bit; past the end it gives `None`.
struct Bits<'a> {
    data: &'a [u8],
    position: usize,
}

impl Bits<'_> {
    fn bit(&mut self) -> Option<u32> {
        let byte = self.data.get(self.position / 8)?;
        let bit = byte >> (7 - self.position % 8) & 1;
        self.position += 1;
        Some(bit.into())
    }

    fn bits(&mut self, n: u32) -> Option<u32> {
        (0..n).try_fold(0u32, |value, _| Some(value << 1 | self.bit()?))
    }

    fn flag(&mut self) -> Option<bool> {
        Some(self.bit()? == 1)
    }

    /// Unsigned Exp-Golomb (§9.1).
    fn ue(&mut self) -> Option<u32> {
        let mut zeros = 0;
        while self.bit()? == 0 {
            zeros += 1;
            if zeros > 31 {
                return None;
            }
        }
        Some((1u32 << zeros) - 1 + self.bits(zeros)?)
    }

    /// Signed Exp-Golomb (§9.1.1).
    fn se(&mut self) -> Option<i32> {
        let k = self.ue()?;
        let half = k.div_ceil(2) as i32;
        Some(if k % 2 == 1 { half } else { -half })
    }
}

/// Colour description of a stream, where it gives one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Colour {
    /// `matrix_coefficients` (ITU-T H.273, table 4).
    pub matrix: Option<u8>,
    /// `video_full_range_flag`.
    pub full_range: Option<bool>,
}

impl Colour {
    /// This description, with gaps filled from `other`.
    pub fn or(self, other: Self) -> Self {
        Self { matrix: self.matrix.or(other.matrix), full_range: self.full_range.or(other.full_range) }
    }

    /// Matrix and range to convert with. An untagged stream is taken for BT.709 from 1280 × 577 pixels on and BT.601
    /// below, as players do, and for limited range.
    pub fn resolve(self, width: usize, height: usize) -> (Matrix, Range) {
        let matrix = match self.matrix {
            Some(1 | 7 | 9 | 10) => Matrix::Bt709,
            Some(4..=6) => Matrix::Bt601,
            _ if width >= 1280 || height > 576 => Matrix::Bt709,
            _ => Matrix::Bt601,
        };
        (matrix, if self.full_range == Some(true) { Range::Full } else { Range::Limited })
    }
}

/// The parts of a sequence parameter set (§7.3.2.1.1) that reading needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sps {
    /// `profile_idc`.
    pub profile: u8,
    /// `constraint_set` flags, the byte after the profile.
    pub constraints: u8,
    /// 1 for 4:2:0.
    pub chroma_format: u32,
    /// Bits per sample of luma and chroma.
    pub bit_depth: (u32, u32),
    /// Coded size in luma samples.
    pub coded: (usize, usize),
    /// Samples cropped at left, right, top, bottom.
    pub crop: [usize; 4],
    /// Whether every picture is a whole frame.
    pub frames_only: bool,
    /// Colour description.
    pub colour: Colour,
}

impl Sps {
    /// Parses a NAL unit of type 7, header byte included.
    pub fn parse(nal: &[u8]) -> Option<Self> {
        let rbsp = unescape(nal.get(1..nal.len().min(4096))?);
        let mut r = Bits { data: &rbsp, position: 0 };
        let profile = r.bits(8)? as u8;
        let constraints = r.bits(8)? as u8;
        r.bits(8)?;
        r.ue()?;
        let (mut chroma_format, mut bit_depth) = (1, (8, 8));
        if matches!(profile, 100 | 110 | 122 | 244 | 44 | 83 | 86 | 118 | 128 | 138 | 139 | 134 | 135) {
            chroma_format = r.ue()?;
            if chroma_format == 3 {
                r.flag()?;
            }
            bit_depth = (r.ue()?.checked_add(8)?, r.ue()?.checked_add(8)?);
            r.flag()?;
            if r.flag()? {
                skip_scaling_matrix(&mut r, if chroma_format == 3 { 12 } else { 8 })?;
            }
        }
        skip_order_count(&mut r)?;
        r.ue()?;
        r.flag()?;
        let width = (r.ue()? as usize).checked_add(1)?.checked_mul(16)?;
        let map_units = (r.ue()? as usize).checked_add(1)?;
        let frames_only = r.flag()?;
        let height = map_units.checked_mul(if frames_only { 16 } else { 32 })?;
        if !frames_only {
            r.flag()?;
        }
        r.flag()?;
        let crop = if r.flag()? { read_crop(&mut r, chroma_format, frames_only)? } else { [0; 4] };
        let fits = crop[0].checked_add(crop[1])? < width && crop[2].checked_add(crop[3])? < height;
        if !fits || width.checked_mul(height)? > MAX_PIXELS {
            return None;
        }
        let colour = if r.flag()? { read_colour(&mut r).unwrap_or_default() } else { Colour::default() };
        Some(Self { profile, constraints, chroma_format, bit_depth, coded: (width, height), crop, frames_only, colour })
    }

    /// Size after cropping.
    pub fn size(&self) -> (usize, usize) {
        let [left, right, top, bottom] = self.crop;
        (self.coded.0 - left - right, self.coded.1 - top - bottom)
    }

    /// Why the embedded decoder cannot read such a stream, if it cannot.
    pub fn unsupported(&self) -> Option<String> {
        if self.chroma_format != 1 {
            return Some("chroma other than 4:2:0".into());
        }
        (self.bit_depth != (8, 8)).then(|| format!("{} bits per sample", self.bit_depth.0.max(self.bit_depth.1)))
    }

    /// The profile's name.
    pub fn profile_name(&self) -> &'static str {
        match self.profile {
            66 if self.constraints & 0x40 != 0 => "Constrained Baseline",
            66 => "Baseline",
            77 => "Main",
            88 => "Extended",
            100 => "High",
            110 => "High 10",
            122 => "High 4:2:2",
            244 => "High 4:4:4",
            _ => "other profile",
        }
    }
}

fn skip_scaling_matrix(r: &mut Bits, lists: usize) -> Option<()> {
    for list in 0..lists {
        if r.flag()? {
            let (mut last, mut next) = (8i32, 8i32);
            for _ in 0..if list < 6 { 16 } else { 64 } {
                if next != 0 {
                    next = (last + r.se()?) & 255;
                }
                last = if next == 0 { last } else { next };
            }
        }
    }
    Some(())
}

fn skip_order_count(r: &mut Bits) -> Option<()> {
    r.ue()?;
    match r.ue()? {
        0 => drop(r.ue()?),
        1 => {
            r.flag()?;
            r.se()?;
            r.se()?;
            let cycle = r.ue()?;
            (cycle <= 255).then_some(())?;
            (0..cycle).try_for_each(|_| r.se().map(drop))?;
        }
        _ => {}
    }
    Some(())
}

fn read_crop(r: &mut Bits, chroma_format: u32, frames_only: bool) -> Option<[usize; 4]> {
    let x = if matches!(chroma_format, 1 | 2) { 2 } else { 1 };
    let y = if chroma_format == 1 { 2 } else { 1 } * if frames_only { 1 } else { 2 };
    let mut crop = [0; 4];
    for (value, unit) in crop.iter_mut().zip([x, x, y, y]) {
        *value = (r.ue()? as usize).checked_mul(unit)?;
    }
    Some(crop)
}

/// The start of `vui_parameters` (§E.1.1).
fn read_colour(r: &mut Bits) -> Option<Colour> {
    if r.flag()? && r.bits(8)? == 255 {
        r.bits(32)?;
    }
    if r.flag()? {
        r.flag()?;
    }
    let mut colour = Colour::default();
    if r.flag()? {
        r.bits(3)?;
        colour.full_range = Some(r.flag()?);
        if r.flag()? {
            r.bits(16)?;
            colour.matrix = Some(r.bits(8)? as u8).filter(|&m| m != 2);
        }
    }
    Some(colour)
}

/// Removes emulation prevention bytes (§7.4.1).
pub(in crate::video) fn unescape(nal: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(nal.len());
    let mut zeros = 0;
    for &byte in nal {
        if zeros >= 2 && byte == 3 {
            zeros = 0;
            continue;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        out.push(byte);
    }
    out
}

/// The `avcC` record (ISO/IEC 14496-15 §5.3.3.1).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Configuration {
    /// Bytes of the length before each NAL unit: 1, 2 or 4.
    pub length_size: usize,
    /// Parameter sets, each a NAL unit.
    pub parameter_sets: Vec<Vec<u8>>,
}

impl Configuration {
    /// Parses the record.
    pub fn parse(record: &[u8]) -> Option<Self> {
        let length_size = usize::from(record.get(4)? & 3) + 1;
        let mut rest = record.get(5..)?;
        let mut parameter_sets = Vec::new();
        for mask in [31u8, 255] {
            let (&count, after) = rest.split_first()?;
            rest = after;
            for _ in 0..count & mask {
                let length = usize::from(u16::from_be_bytes([*rest.first()?, *rest.get(1)?]));
                parameter_sets.push(rest.get(2..2 + length)?.to_vec());
                rest = &rest[2 + length..];
            }
        }
        Some(Self { length_size, parameter_sets })
    }

    /// The first sequence parameter set.
    pub fn sps(&self) -> Option<Sps> {
        self.parameter_sets.iter().find(|nal| nal.first().is_some_and(|b| b & 31 == 7)).and_then(|nal| Sps::parse(nal))
    }
}

/// The embedded H.264 decoder: 8-bit 4:2:0, progressive frames, Baseline to High.
pub struct H264 {
    inner: rusty_h264::Decoder,
    configuration: Configuration,
    container: Colour,
    sps: Option<Sps>,
    annex_b: Vec<u8>,
    fresh: bool,
}

impl H264 {
    /// A decoder for samples with lengths before NAL units, as `configuration` says. `container` is the colour
    /// description of the container, which fills gaps of the stream's own.
    pub fn new(configuration: Configuration, container: Colour) -> Self {
        let sps = configuration.sps();
        let inner = rusty_h264::Decoder::new();
        Self { inner, configuration, container, sps, annex_b: Vec::new(), fresh: true }
    }

    /// Rewrites a sample with start codes instead of lengths.
    fn rewrite(&mut self, packet: &[u8]) -> Result<(), Failure> {
        self.annex_b.clear();
        if std::mem::take(&mut self.fresh) {
            for nal in &self.configuration.parameter_sets {
                self.annex_b.extend_from_slice(&[0, 0, 0, 1]);
                self.annex_b.extend_from_slice(nal);
            }
        }
        let mut rest = packet;
        while !rest.is_empty() {
            let damaged = || Failure::Damaged("a NAL unit is longer than its sample".into());
            let (prefix, after) = rest.split_at_checked(self.configuration.length_size).ok_or_else(damaged)?;
            let length = prefix.iter().fold(0usize, |n, &b| n << 8 | usize::from(b));
            let (nal, after) = after.split_at_checked(length).ok_or_else(damaged)?;
            if nal.first().is_some_and(|b| b & 31 == 7) {
                self.sps = Sps::parse(nal).or(self.sps);
            }
            self.annex_b.extend_from_slice(&[0, 0, 0, 1]);
            self.annex_b.extend_from_slice(nal);
            rest = after;
        }
        Ok(())
    }

    fn picture(&self, frame: rusty_h264::YuvFrame) -> Picture {
        let (mut width, mut height) = (frame.width, frame.height);
        let mut planes = [frame.y, frame.u, frame.v];
        // The decoder crops at the right and the bottom only.
        let (left, top) = self.sps.map_or((0, 0), |s| (s.crop[0], s.crop[2]));
        if (left, top) != (0, 0) && left < width && top < height {
            planes[0] = cut(&planes[0], width, left, top);
            planes[1] = cut(&planes[1], width / 2, left / 2, top / 2);
            planes[2] = cut(&planes[2], width / 2, left / 2, top / 2);
            (width, height) = (width - left, height - top);
        }
        let colour = self.sps.map(|s| s.colour).unwrap_or_default().or(self.container);
        let (matrix, range) = colour.resolve(width, height);
        Picture { width, height, pixels: Pixels::Yuv { planes, subsampling: (2, 2), matrix, range } }
    }
}

/// `plane` without its first columns and rows.
fn cut(plane: &[u8], width: usize, left: usize, top: usize) -> Vec<u8> {
    plane.chunks_exact(width).skip(top).flat_map(|row| &row[left..]).copied().collect()
}

impl VideoDecoder for H264 {
    fn decode(&mut self, packet: &[u8]) -> Result<Option<Picture>, Failure> {
        self.rewrite(packet)?;
        if let Some(reason) = self.sps.and_then(|sps| sps.unsupported()) {
            return Err(Failure::Unsupported(reason));
        }
        let decoded = guarded(|| {
            self.inner.decode(&self.annex_b).map_err(|error| match error {
                rusty_h264::DecodeError::Unsupported(what) => Failure::Unsupported(what.into()),
                other => Failure::Damaged(other.to_string()),
            })
        });
        if decoded.is_err() {
            self.reset();
        }
        Ok(decoded?.map(|frame| self.picture(frame)))
    }

    fn reset(&mut self) {
        self.inner = rusty_h264::Decoder::new();
        self.fresh = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes bits for parameter sets made by hand.
    #[derive(Default)]
    struct Writer(Vec<bool>);

    impl Writer {
        fn bits(&mut self, value: u32, n: u32) -> &mut Self {
            (0..n).rev().for_each(|i| self.0.push(value >> i & 1 == 1));
            self
        }

        fn ue(&mut self, value: u32) -> &mut Self {
            let length = 32 - (value + 1).leading_zeros();
            self.bits(0, length - 1).bits(value + 1, length)
        }

        fn nal(&self) -> Vec<u8> {
            let mut bits = self.0.clone();
            bits.push(true);
            bits.resize(bits.len().next_multiple_of(8), false);
            let byte = |c: &[bool]| c.iter().fold(0u8, |b, &bit| b << 1 | u8::from(bit));
            std::iter::once(0x67).chain(bits.chunks(8).map(byte)).collect()
        }
    }

    #[test]
    fn a_full_range_cropped_sps() {
        let mut w = Writer::default();
        w.bits(66, 8).bits(0x40, 8).bits(30, 8).ue(0).ue(0).ue(2).ue(1).bits(0, 1);
        w.ue(39).ue(22).bits(1, 1).bits(0, 1); // 640 × 368, frames only, no direct_8x8
        w.bits(1, 1).ue(1).ue(2).ue(3).ue(1); // crop 2 left, 4 right, 6 top, 2 bottom
        w.bits(1, 1).bits(0, 1).bits(0, 1); // VUI without aspect and overscan
        w.bits(1, 1).bits(5, 3).bits(1, 1).bits(1, 1).bits(1, 8).bits(1, 8).bits(6, 8);
        let sps = Sps::parse(&w.nal()).unwrap();
        assert_eq!((sps.coded, sps.size()), ((640, 368), (634, 360)));
        assert_eq!(sps.colour, Colour { matrix: Some(6), full_range: Some(true) });
        assert_eq!(sps.colour.resolve(1920, 1080), (Matrix::Bt601, Range::Full));
        assert_eq!(sps.profile_name(), "Constrained Baseline");
        assert_eq!(sps.unsupported(), None);
    }

    #[test]
    fn ten_bit_streams_are_named() {
        let mut w = Writer::default();
        w.bits(110, 8).bits(0, 8).bits(30, 8).ue(0).ue(1).ue(2).ue(2).bits(0, 1).bits(0, 1);
        w.ue(0).ue(2).ue(1).bits(0, 1).ue(9).ue(9).bits(1, 1).bits(0, 1).bits(0, 1).bits(0, 1);
        assert_eq!(Sps::parse(&w.nal()).unwrap().unsupported().as_deref(), Some("10 bits per sample"));
    }

    #[test]
    fn untagged_streams_follow_their_size() {
        assert_eq!(Colour::default().resolve(640, 360).0, Matrix::Bt601);
        assert_eq!(Colour::default().resolve(1280, 720).0, Matrix::Bt709);
    }

    #[test]
    fn damaged_parameter_sets_are_refused() {
        for length in 0..12 {
            assert!(Sps::parse(&vec![0; length]).is_none());
        }
        let mut giant = Writer::default();
        giant
            .bits(66, 8)
            .bits(0, 8)
            .bits(30, 8)
            .ue(0)
            .ue(0)
            .ue(2)
            .ue(1)
            .bits(0, 1)
            .ue(1 << 20)
            .ue(1 << 20)
            .bits(255, 8);
        assert!(Sps::parse(&giant.nal()).is_none());
        assert!(Configuration::parse(&[1, 66, 0, 30, 255, 225, 255, 255, 0]).is_none());
    }
}
