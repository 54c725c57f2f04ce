//! Animated GIF, PNG and WebP. Frames arrive composed: disposal and blending are done by the decoders.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use image::codecs::{gif::GifDecoder, png::PngDecoder, webp::WebPDecoder};
use image::{AnimationDecoder, Frame, Frames, ImageDecoder, ImageError, ImageResult, Limits};

use super::decoder::{MAX_PIXELS, guarded};
use crate::base::error::{Error, Kind, Result};
use crate::video::clip::{ClipInfo, Pixels, RawFrame, Source, Turn};

/// Delays of up to 10 ms are shown for 100 ms, as browsers do.
fn delay_ns(frame: &Frame) -> u64 {
    let (numerator, denominator) = frame.delay().numer_denom_ms();
    let ns = u64::from(numerator) * 1_000_000 / u64::from(denominator.max(1));
    if ns <= 10_000_000 { 100_000_000 } else { ns }
}

/// An animation being read. The decoders' iterators cannot change threads, so one thread keeps each of them and hands
/// frames over one at a time.
pub struct Animation {
    path: PathBuf,
    info: ClipInfo,
    frames: Receiver<ImageResult<Frame>>,
    time_ns: u64,
    count: u64,
}

/// The error for a picture that does not move.
pub fn still(path: &Path) -> Error {
    Error::file(Kind::Unusable, path, "a still picture, not a clip")
        .remedy("give a video, an animation or a folder of numbered pictures")
}

/// Opens an animation.
///
/// # Errors
/// When it cannot be read, is damaged or does not move.
pub fn open(path: &Path) -> Result<Animation> {
    let mut magic = [0; 4];
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    std::io::Read::read_exact(&mut &file, &mut magic).map_err(|e| Error::io(path, "read", e))?;
    let damaged = |e: image::ImageError| {
        Error::file(Kind::Data, path, format!("cannot be decoded: {e}")).remedy("export the animation again")
    };
    let input = BufReader::new(File::open(path).map_err(|e| Error::io(path, "open", e))?);
    match &magic {
        b"GIF8" => {
            let mut decoder = GifDecoder::new(input).map_err(damaged)?;
            let size = check(path, decoder.dimensions())?;
            decoder.set_limits(Limits::default()).map_err(damaged)?;
            Ok(start(path, "GIF", "embedded gif", size, move || decoder.into_frames()))
        }
        b"RIFF" => {
            let decoder = WebPDecoder::new(input).map_err(damaged)?;
            let size = check(path, decoder.dimensions())?;
            if !decoder.has_animation() {
                return Err(still(path));
            }
            Ok(start(path, "animated WebP", "embedded webp", size, move || decoder.into_frames()))
        }
        _ => {
            let decoder = PngDecoder::with_limits(input, Limits::default()).map_err(damaged)?;
            let size = check(path, decoder.dimensions())?;
            if !decoder.is_apng().map_err(damaged)? {
                return Err(still(path));
            }
            let decoder = decoder.apng().map_err(damaged)?;
            Ok(start(path, "animated PNG", "embedded apng", size, move || decoder.into_frames()))
        }
    }
}

fn check(path: &Path, (width, height): (u32, u32)) -> Result<(usize, usize)> {
    let (width, height) = (width as usize, height as usize);
    if width == 0 || height == 0 || width.saturating_mul(height) > MAX_PIXELS {
        return Err(Error::file(Kind::Data, path, format!("{width} × {height} pixels"))
            .allowed(format!("1 to {MAX_PIXELS} pixels")));
    }
    Ok((width, height))
}

fn start(
    path: &Path,
    codec: &str,
    decoder: &'static str,
    (width, height): (usize, usize),
    frames: impl FnOnce() -> Frames<'static> + Send + 'static,
) -> Animation {
    let (sender, receiver) = sync_channel(1);
    std::thread::spawn(move || produce(frames(), &sender));
    let (turn, frames, duration_ns) = (Turn::None, None, None);
    let info = ClipInfo { width, height, turn, frames, duration_ns, codec: codec.into(), decoder };
    Animation { path: path.to_path_buf(), info, frames: receiver, time_ns: 0, count: 0 }
}

/// Sends frames until the end, the first error, or nobody listens.
fn produce(mut frames: Frames<'static>, sender: &SyncSender<ImageResult<Frame>>) {
    // A decoder that panics must not pass for the end of the clip.
    let gave_up = |_| Some(Err(ImageError::IoError(std::io::Error::other("the decoder gave up on it"))));
    while let Some(frame) = guarded(|| Ok(frames.next())).unwrap_or_else(gave_up) {
        let last = frame.is_err();
        if sender.send(frame).is_err() || last {
            break;
        }
    }
}

impl Source for Animation {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<RawFrame>> {
        let Ok(frame) = self.frames.recv() else { return Ok(None) };
        let frame = frame.map_err(|e| {
            let problem = format!("frame {} cannot be decoded: {e}", self.count);
            Error::file(Kind::Data, &self.path, problem).remedy("export the animation again")
        })?;
        let time_ns = self.time_ns;
        self.time_ns = self.time_ns.saturating_add(delay_ns(&frame));
        self.count += 1;
        let buffer = frame.into_buffer();
        let (width, height) = (buffer.width() as usize, buffer.height() as usize);
        Ok(Some(RawFrame { width, height, time_ns, pixels: Pixels::Rgba(buffer.into_raw()) }))
    }
}
