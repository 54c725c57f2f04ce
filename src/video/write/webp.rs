//! Animated WebP (RFC 9649, §2.7): lossless, with opacity, for browsers and messengers.
//!
//! Where a frame is laid over another, some readers (libwebp's own animation decoder among them) round opaque colours
//! down by up to 1/255.

use std::ops::Range;

use image::codecs::webp::WebPEncoder;
use image::{ExtendedColorType, ImageResult};

use super::animation::{AnimationWriter, Format, SHORTEST, milliseconds};
use super::options::{FrameRate, SinkOptions};
use super::patch::Patch;

/// Writes frames as animated WebP.
pub(super) type WebpWriter = AnimationWriter<Webp>;

/// Features of the file: animation, opacity.
const FLAGS: u8 = 0x02 | 0x10;
/// Bytes of the header that a still WebP file begins with.
const STILL_HEAD: usize = 12;
/// Longest time of a frame in milliseconds: 24 bits.
const LONGEST: u64 = (1 << 24) - 1;

/// The format.
#[derive(Debug)]
pub(super) struct Webp;

impl Format for Webp {
    const ALIGN: usize = 2;
    const MAX_BYTES: u64 = u32::MAX as u64;

    fn head(options: &SinkOptions, _frames: usize, bytes: u64) -> Vec<u8> {
        let size = (bytes.saturating_sub(8) as u32).to_le_bytes();
        let canvas = [three(options.width - 1), three(options.height - 1)].concat();
        let plays = u16::from(!options.loops).to_le_bytes();
        [
            &[&b"RIFF"[..], &size, b"WEBP"].concat()[..],
            &chunk(b"VP8X", &[&[FLAGS, 0, 0, 0], &canvas]),
            &chunk(b"ANIM", &[&[0; 4], &plays]), // transparent background
        ]
        .concat()
    }

    fn compress(patch: &Patch) -> ImageResult<Vec<u8>> {
        let (width, height) = (patch.width as u32, patch.height as u32);
        let mut file = Vec::new();
        let encoder = WebPEncoder::new_lossless(&mut file);
        if patch.opaque() {
            let colours: Vec<u8> = patch.pixels.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
            encoder.encode(&colours, width, height, ExtendedColorType::Rgb8)?;
        } else {
            encoder.encode(&patch.pixels, width, height, ExtendedColorType::Rgba8)?;
        }
        // The chunk of pixels, with its head, is what a frame holds too.
        Ok(file.split_off(STILL_HEAD))
    }

    fn frame(&mut self, patch: &Patch, pixels: &[u8], shown: Range<usize>, rate: FrameRate) -> Vec<u8> {
        let place = [patch.left / 2, patch.top / 2, patch.width - 1, patch.height - 1].map(three).concat();
        let time = milliseconds(shown.end, rate) - milliseconds(shown.start, rate);
        let time = three(time.clamp(SHORTEST, LONGEST) as usize);
        // Kept as it is when its time is over; laid over what was there, or put in its place.
        let replaces = u8::from(!patch.over) << 1;
        chunk(b"ANMF", &[&place, &time, &[replaces], pixels])
    }

    fn tail() -> &'static [u8] {
        &[]
    }
}

/// A number in three bytes.
fn three(value: usize) -> [u8; 3] {
    let [a, b, c, _] = (value as u32).to_le_bytes();
    [a, b, c]
}

fn chunk(kind: &[u8; 4], parts: &[&[u8]]) -> Vec<u8> {
    let length = parts.iter().map(|p| p.len()).sum::<usize>();
    let size = (length as u32).to_le_bytes();
    let padding = &[0][..length % 2];
    [&kind[..], &size, &parts.concat(), padding].concat()
}
