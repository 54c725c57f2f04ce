//! Motion JPEG: every packet is one JPEG.

use std::io::Cursor;

use image::{ImageDecoder, ImageReader, Limits};

use super::decoder::{Failure, MAX_PIXELS, Picture, VideoDecoder, guarded};
use crate::video::clip::Pixels;

/// The embedded Motion JPEG decoder.
#[derive(Debug, Clone, Copy, Default)]
pub struct Mjpeg;

impl VideoDecoder for Mjpeg {
    fn decode(&mut self, packet: &[u8]) -> Result<Option<Picture>, Failure> {
        guarded(|| {
            let damaged = |error: image::ImageError| Failure::Damaged(error.to_string());
            let mut decoder = image::codecs::jpeg::JpegDecoder::new(Cursor::new(packet)).map_err(damaged)?;
            let (width, height) = decoder.dimensions();
            if width as usize * height as usize > MAX_PIXELS {
                return Err(Failure::Damaged(format!("it claims {width} × {height} pixels")));
            }
            decoder.set_limits(Limits::default()).map_err(damaged)?;
            let image = image::DynamicImage::from_decoder(decoder).map_err(damaged)?;
            let (width, height) = (width as usize, height as usize);
            Ok(Some(Picture { width, height, pixels: Pixels::Rgb(image.into_rgb8().into_raw()) }))
        })
    }

    fn reset(&mut self) {}
}

/// A reader with the limits this crate uses for pictures in a clip.
pub(super) fn limited<R: std::io::BufRead + std::io::Seek>(mut reader: ImageReader<R>) -> ImageReader<R> {
    let mut limits = Limits::default();
    limits.max_image_width = Some(1 << 15);
    limits.max_image_height = Some(1 << 15);
    reader.limits(limits);
    reader
}
