//! Animated PNG (PNG specification, third edition, §11.3.2): lossless, with opacity; one file that programs without
//! animation show the first frame of.

use std::ops::Range;

use image::ImageResult;
use image::error::{EncodingError, ImageError, ImageFormatHint};

use super::animation::{AnimationWriter, Format, SHORTEST, milliseconds};
use super::options::{FrameRate, SinkOptions};
use super::patch::Patch;
use crate::raster::picture_io::encode_rgba_png;

/// Writes frames as animated PNG.
pub(super) type ApngWriter = AnimationWriter<Apng>;

/// Bytes every PNG begins with.
const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";

/// How hard pixels are compressed.
const COMPRESSION: png::Compression = png::Compression::Balanced;

/// The format: numbers the animation's chunks.
#[derive(Debug, Default)]
pub(super) struct Apng {
    sequence: u32,
}

impl Apng {
    fn number(&mut self) -> [u8; 4] {
        self.sequence += 1;
        (self.sequence - 1).to_be_bytes()
    }
}

impl Format for Apng {
    const ALIGN: usize = 1;
    const MAX_BYTES: u64 = u64::MAX;

    fn head(options: &SinkOptions, frames: usize, _bytes: u64) -> Vec<u8> {
        let size = [options.width, options.height].map(|v| (v as u32).to_be_bytes()).concat();
        let plays = u32::from(!options.loops);
        let animation = [frames as u32, plays].map(u32::to_be_bytes).concat();
        [
            SIGNATURE,
            &chunk(b"IHDR", &[&size, &[8, 6, 0, 0, 0]]), // 8 bits, colours with opacity
            &chunk(b"sRGB", &[&[0]]),
            &chunk(b"acTL", &[&animation]),
        ]
        .concat()
    }

    fn compress(patch: &Patch) -> ImageResult<Vec<u8>> {
        let failed = |e| ImageError::Encoding(EncodingError::new(ImageFormatHint::Exact(image::ImageFormat::Png), e));
        let file = encode_rgba_png((patch.width, patch.height), &patch.pixels, COMPRESSION).map_err(failed)?;
        Ok(image_data(&file))
    }

    fn frame(&mut self, patch: &Patch, pixels: &[u8], shown: Range<usize>, rate: FrameRate) -> Vec<u8> {
        let first = self.sequence == 0;
        let place = [patch.width, patch.height, patch.left, patch.top].map(|v| (v as u32).to_be_bytes()).concat();
        let (delay, per) = delay(shown, rate);
        let times = [delay, per].map(u16::to_be_bytes).concat();
        // Kept as it is when its time is over; laid over what was there, or put in its place.
        let control = chunk(b"fcTL", &[&self.number(), &place, &times, &[0, u8::from(patch.over)]]);
        let data = if first { chunk(b"IDAT", &[pixels]) } else { chunk(b"fdAT", &[&self.number(), pixels]) };
        [control, data].concat()
    }

    fn tail() -> &'static [u8] {
        b"\0\0\0\0IEND\xae\x42\x60\x82"
    }
}

/// How long the frames `shown` take, as a fraction of seconds: exactly where the format can say it, else in milliseconds.
fn delay(shown: Range<usize>, rate: FrameRate) -> (u16, u16) {
    let time = milliseconds(shown.end, rate) - milliseconds(shown.start, rate);
    let exact = u16::try_from(shown.len() as u64 * u64::from(rate.denominator())).ok();
    if let (Some(delay), Ok(per)) = (exact.filter(|_| time >= SHORTEST), u16::try_from(rate.numerator())) {
        return (delay, per);
    }
    (time.clamp(SHORTEST, u64::from(u16::MAX)) as u16, 1000)
}

fn chunk(kind: &[u8; 4], parts: &[&[u8]]) -> Vec<u8> {
    let body = [&[&kind[..]], parts].concat().concat();
    let length = (body.len() - 4) as u32;
    [&length.to_be_bytes()[..], &body, &crc32fast::hash(&body).to_be_bytes()].concat()
}

/// The contents of all `IDAT` chunks of a PNG file.
fn image_data(file: &[u8]) -> Vec<u8> {
    let mut data = Vec::with_capacity(file.len());
    let mut rest = &file[SIGNATURE.len()..];
    while let Some((head, body)) = rest.split_first_chunk::<8>() {
        let length = head[..4].iter().fold(0, |sum, &b| sum << 8 | usize::from(b));
        if &head[4..] == b"IDAT" {
            data.extend_from_slice(&body[..length]);
        }
        rest = &body[length + 4..];
    }
    data
}
