//! VP9: the embedded decoder behind our trait.

use super::decoder::{Failure, MAX_PIXELS, Picture, VideoDecoder, guarded};
use super::h264::Colour;
use crate::video::clip::Pixels;

/// The embedded VP9 decoder: 8 bits per sample, any chroma subsampling.
pub struct Vp9 {
    inner: rusty_vp9::Vp9Decoder,
    container: Colour,
    stream: Colour,
}

impl Vp9 {
    /// A decoder; `container` is the colour description of the container, for streams that have none.
    pub fn new(container: Colour) -> Self {
        Self { inner: rusty_vp9::Vp9Decoder::new(), container, stream: Colour::default() }
    }
}

/// Colour of a key frame's uncompressed header (VP9 bitstream specification §7.2.2), as H.273 values.
fn key_frame_colour(packet: &[u8]) -> Option<Colour> {
    let bit = |i: usize| packet.get(i / 8).map(|b| b >> (7 - i % 8) & 1);
    let profile = bit(2)? | bit(3)? << 1;
    let mut at = if profile == 3 { 5 } else { 4 };
    // show_existing_frame, then frame_type: 0 is a key frame.
    if bit(at)? == 1 || bit(at + 1)? == 1 {
        return None;
    }
    at += 4 + 24 + usize::from(profile >= 2);
    let space = bit(at)? << 2 | bit(at + 1)? << 1 | bit(at + 2)?;
    let matrix = match space {
        1 | 3 => Some(6),
        2 | 4 | 5 => Some(1),
        _ => None,
    };
    Some(Colour { matrix, full_range: Some(bit(at + 3)? == 1).filter(|_| space != 0 || bit(at + 3) == Some(1)) })
}

/// Refuses a header that promises more pixels than [`MAX_PIXELS`] before the decoder allocates them.
fn check_size(packet: &[u8]) -> Result<(), Failure> {
    let mut reader = rusty_vp9::BitReader::new(packet);
    match rusty_vp9::parse_uncompressed_header(&mut reader, &[(0, 0); 8]) {
        Ok(h) if u64::from(h.width) * u64::from(h.height) > MAX_PIXELS as u64 => {
            Err(Failure::Damaged(format!("it claims {} × {} pixels", h.width, h.height)))
        }
        Ok(h) if h.key_frame && h.bit_depth > 8 => {
            Err(Failure::Unsupported(format!("{} bits per sample", h.bit_depth)))
        }
        _ => Ok(()),
    }
}

impl VideoDecoder for Vp9 {
    fn decode(&mut self, packet: &[u8]) -> Result<Option<Picture>, Failure> {
        guarded(|| check_size(packet))?;
        self.stream = key_frame_colour(packet).unwrap_or(self.stream);
        let colour = self.stream.or(self.container);
        let inner = &mut self.inner;
        let frame = guarded(|| {
            let failure = |error: rusty_vp9::Error| match error {
                rusty_vp9::Error::Unsupported(what) => Failure::Unsupported(what),
                other => Failure::Damaged(other.to_string()),
            };
            inner.push(packet, None).map_err(failure)?;
            let mut shown = None;
            // A packet may hold hidden frames before the shown one; at most eight frames make a superframe.
            for _ in 0..9 {
                match inner.next_frame() {
                    Ok(frame) => shown = Some(frame),
                    Err(rusty_vp9::Error::Again) => {}
                    Err(error) => return Err(failure(error)),
                }
            }
            Ok(shown)
        })?;
        frame.map(|frame| picture(frame, colour)).transpose()
    }

    fn reset(&mut self) {
        self.inner = rusty_vp9::Vp9Decoder::new();
    }
}

fn picture(frame: rusty_vp9::DecodedFrame, colour: Colour) -> Result<Picture, Failure> {
    if frame.bit_depth != 8 {
        return Err(Failure::Unsupported(format!("{} bits per sample", frame.bit_depth)));
    }
    let (width, height) = (frame.width as usize, frame.height as usize);
    let subsampling = (1 << frame.subsampling_x.min(1), 1 << frame.subsampling_y.min(1));
    let size = |plane: usize| match plane {
        0 => (width, height),
        _ => (width.div_ceil(subsampling.0.into()), height.div_ceil(subsampling.1.into())),
    };
    let mut planes: [Vec<u8>; 3] = Default::default();
    for (i, ((plane, data), &stride)) in planes.iter_mut().zip(&frame.planes).zip(&frame.strides).enumerate() {
        let (w, h) = size(i);
        if stride < w || data.len() < stride * h.saturating_sub(1) + w || h == 0 {
            return Err(Failure::Damaged("its planes do not fit its size".into()));
        }
        *plane = data.chunks(stride).take(h).flat_map(|row| &row[..w]).copied().collect();
    }
    let (matrix, range) = colour.resolve(width, height);
    Ok(Picture { width, height, pixels: Pixels::Yuv { planes, subsampling, matrix, range } })
}
