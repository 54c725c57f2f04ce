//! Opening a clip by what it holds, whatever its name says.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::{animation, array, avi, ffmpeg, folder, mp4, webm, y4m};
use crate::base::error::{Error, Kind, Result};
use crate::video::clip::{ClipInfo, RawFrame, Source};

/// Which decoders may be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Decoder {
    /// The embedded ones, and ffmpeg (when on PATH) for what they cannot read.
    #[default]
    Auto,
    /// The embedded ones only.
    Embedded,
    /// ffmpeg only (folders of pictures are read by the embedded ones all the same).
    Ffmpeg,
}

/// Kinds of file told apart by their first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Mp4,
    Avi,
    Matroska,
    Gif,
    Png,
    WebP,
    Y4m,
    Jpeg,
    Npy,
    /// A container that only ffmpeg reads.
    Foreign(&'static str),
    Unknown,
}

impl Format {
    fn of(head: &[u8]) -> Self {
        let at = |offset: usize, magic: &[u8]| head.get(offset..).is_some_and(|rest| rest.starts_with(magic));
        let boxes: [&[u8]; 6] = [b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"];
        match () {
            () if boxes.iter().any(|name| at(4, name)) => Self::Mp4,
            () if at(0, b"RIFF") && at(8, b"AVI ") => Self::Avi,
            () if at(0, b"RIFF") && at(8, b"WEBP") => Self::WebP,
            () if at(0, &[0x1a, 0x45, 0xdf, 0xa3]) => Self::Matroska,
            () if at(0, b"GIF8") => Self::Gif,
            () if at(0, b"\x89PNG\r\n\x1a\n") => Self::Png,
            () if at(0, b"YUV4MPEG2") => Self::Y4m,
            () if at(0, &[0xff, 0xd8, 0xff]) => Self::Jpeg,
            () if at(0, b"\x93NUMPY") => Self::Npy,
            () if at(0, b"OggS") => Self::Foreign("Ogg"),
            () if at(0, b"FLV\x01") => Self::Foreign("Flash video"),
            () if at(0, &[0x30, 0x26, 0xb2, 0x75]) => Self::Foreign("Windows Media (ASF)"),
            () if at(0, &[0, 0, 1, 0xba]) || at(0, &[0, 0, 1, 0xb3]) => Self::Foreign("MPEG"),
            () if at(0, &[0x47]) && at(188, &[0x47]) => Self::Foreign("MPEG transport stream"),
            () if at(4, &[0x47]) && at(196, &[0x47]) => Self::Foreign("MPEG transport stream (AVCHD)"),
            () if at(0, &[0, 0, 0, 1]) || at(0, &[0, 0, 1]) => Self::Foreign("raw video stream"),
            () => Self::Unknown,
        }
    }
}

/// Opens a clip: a video file, an animation, an `.npy` file of frames, or a folder of pictures.
///
/// # Errors
/// When it cannot be read, is not a video, or needs ffmpeg and ffmpeg is absent.
pub fn open(path: &Path) -> Result<Box<dyn Source>> {
    open_with(path, Decoder::Auto)
}

/// [`open`] with a choice of decoders.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: &Path, decoder: Decoder) -> Result<Box<dyn Source>> {
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, "open", e))?;
    if metadata.is_dir() {
        return Ok(Box::new(folder::open(path)?));
    }
    if !metadata.is_file() {
        return Err(Error::file(Kind::Io, path, "neither a file nor a folder"));
    }
    let head = head(path)?;
    if head.is_empty() {
        return Err(Error::file(Kind::Data, path, "the file is empty"));
    }
    if decoder == Decoder::Ffmpeg {
        return Ok(Box::new(ffmpeg::open(path, "this file")?));
    }
    let through_ffmpeg = |what: &str| -> Result<Box<dyn Source>> {
        match decoder {
            Decoder::Embedded => Err(ffmpeg::missing(path, what)),
            _ => Ok(Box::new(ffmpeg::open(path, what)?)),
        }
    };
    match Format::of(&head) {
        Format::Mp4 => match mp4::open(path)? {
            mp4::Content::Clip(clip) => begun(clip, decoder, path),
            mp4::Content::Other(what) => through_ffmpeg(&what),
        },
        Format::Avi => match avi::open(path)? {
            avi::Content::Clip(clip) => Ok(clip),
            avi::Content::Other(what) => through_ffmpeg(&what),
        },
        Format::Matroska => match webm::open(path)? {
            webm::Content::Clip(clip) => begun(clip, decoder, path),
            webm::Content::Other(what) => through_ffmpeg(&what),
        },
        Format::Gif | Format::Png | Format::WebP => Ok(Box::new(animation::open(path)?)),
        Format::Y4m => match y4m::open(path)? {
            y4m::Content::Clip(clip) => Ok(clip),
            y4m::Content::Other(what) => through_ffmpeg(&what),
        },
        Format::Jpeg => Err(animation::still(path)),
        Format::Npy => Ok(Box::new(array::open(path)?)),
        Format::Foreign(container) => through_ffmpeg(container),
        Format::Unknown if decoder == Decoder::Auto && ffmpeg::available() => through_ffmpeg("this file"),
        Format::Unknown => Err(unknown(path)),
    }
}

/// A clip whose first frame has been decoded already.
struct Begun {
    source: Box<dyn Source>,
    first: Option<Result<Option<RawFrame>>>,
}

impl Source for Begun {
    fn info(&self) -> &ClipInfo {
        self.source.info()
    }

    fn next_frame(&mut self) -> Result<Option<RawFrame>> {
        self.first.take().unwrap_or_else(|| self.source.next_frame())
    }
}

/// Some of what the embedded decoders lack (interlaced H.264, say) shows only in the first frame: that is decoded here,
/// so that ffmpeg can take over.
fn begun(mut source: Box<dyn Source>, decoder: Decoder, path: &Path) -> Result<Box<dyn Source>> {
    if decoder != Decoder::Auto || !ffmpeg::available() {
        return Ok(source);
    }
    let first = source.next_frame();
    if first.as_ref().is_err_and(|error| error.kind() == Kind::Unsupported) {
        return Ok(Box::new(ffmpeg::open(path, &source.info().codec)?));
    }
    Ok(Box::new(Begun { source, first: Some(first) }))
}

fn unknown(path: &Path) -> Error {
    Error::file(Kind::Data, path, "not a video file of any known kind")
        .allowed("MP4, MOV, AVI, WebM, GIF, APNG, WebP, Y4M, NPY, a folder of PNG or JPEG; more with ffmpeg on PATH")
        .remedy("check that it is a video that plays")
}

fn head(path: &Path) -> Result<Vec<u8>> {
    let mut head = Vec::new();
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    file.take(512).read_to_end(&mut head).map_err(|e| Error::io(path, "read", e))?;
    Ok(head)
}

/// Identity of a clip: BLAKE3 of the file's bytes; of a folder, the bytes of its pictures in order.
///
/// # Errors
/// When it cannot be read.
pub fn content_hash(path: &Path) -> Result<[u8; 32]> {
    let mut hasher = blake3::Hasher::new();
    let mut add = |file: &Path| -> Result<()> {
        let opened = File::open(file).map_err(|e| Error::io(file, "open", e))?;
        hasher.update_reader(opened).map(drop).map_err(|e| Error::io(file, "read", e))
    };
    if std::fs::metadata(path).map_err(|e| Error::io(path, "open", e))?.is_dir() {
        folder::pictures(path)?.iter().try_for_each(|picture| add(picture))?;
    } else {
        add(path)?;
    }
    Ok(*hasher.finalize().as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_known_by_their_first_bytes() {
        assert_eq!(Format::of(b"\0\0\0\x20ftypisom"), Format::Mp4);
        assert_eq!(Format::of(b"RIFF\0\0\0\0AVI LIST"), Format::Avi);
        assert_eq!(Format::of(b"RIFF\0\0\0\0WEBPVP8X"), Format::WebP);
        assert_eq!(Format::of(b"YUV4MPEG2 W2 H2"), Format::Y4m);
        assert_eq!(Format::of(b"Dear diary"), Format::Unknown);
        assert_eq!(Format::of(b""), Format::Unknown);
    }
}
