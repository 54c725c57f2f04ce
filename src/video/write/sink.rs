//! Opening a place to write frames to, by the name of the file.

use std::path::Path;

use super::apng::{Apng, ApngWriter};
use super::gif::GifWriter;
use super::mp4::Mp4Writer;
use super::npy::NpyWriter;
use super::options::SinkOptions;
use super::png_folder::{PngFolder, is_frame_name};
use super::webp::{Webp, WebpWriter};
use super::y4m::Y4mWriter;
use crate::base::atomic_file::{self, AtomicFolder};
use crate::base::error::{Error, Kind, Result};
use crate::video::clip::Sink;

/// Longest side of a written frame, in pixels.
pub const MAX_SIDE: usize = 16_384;

/// Where frames go, told by the name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Stdout,
    Mp4,
    Gif,
    Webp,
    Apng,
    Y4m,
    Npy,
    Folder,
}

/// What names [`create`] accepts, for messages.
pub const SUPPORTED: &str =
    ".mp4, .gif, .webp, .apng (or .png), .y4m, .npy, a folder for PNG frames, or - for Y4M on standard output";
/// What holds opacity, for messages.
const WITH_ALPHA: &str =
    "a name without extension, for a folder of PNG frames; .webp; .apng; .gif, opaque or not and nothing between; .npy";

impl Format {
    fn of(path: &Path) -> Result<Self> {
        if path == Path::new("-") {
            return Ok(Self::Stdout);
        }
        let slash = path.as_os_str().as_encoded_bytes().last().is_some_and(|&b| std::path::is_separator(b.into()));
        if slash || path.is_dir() {
            return Ok(Self::Folder);
        }
        match path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).as_deref() {
            None => Ok(Self::Folder),
            Some("mp4") => Ok(Self::Mp4),
            Some("gif") => Ok(Self::Gif),
            Some("webp") => Ok(Self::Webp),
            // An animated PNG is a PNG, and some places take it by that name only.
            Some("apng" | "png") => Ok(Self::Apng),
            Some("y4m") => Ok(Self::Y4m),
            Some("npy") => Ok(Self::Npy),
            Some(other) => Err(Error::file(Kind::Usage, path, format!("cannot write .{other}"))
                .allowed(SUPPORTED)
                .remedy("choose one of these, or end the name of a folder with a slash")),
        }
    }

    /// Whether the format holds opacity.
    fn holds_alpha(self) -> bool {
        matches!(self, Self::Folder | Self::Webp | Self::Apng | Self::Npy | Self::Gif)
    }
}

/// Opens a sink for `path`, by its extension: `.mp4`, `.gif`, `.webp`, `.apng` or `.png`, `.y4m`, `.npy`; a name without
/// extension, with a trailing slash, or of an existing folder is a folder of `00000.png`, `00001.png`…; `-` is Y4M on
/// standard output.
///
/// The file appears under its name when [`Sink::finish`] is called; a sink dropped before leaves nothing.
///
/// # Errors
/// An unknown extension, a size that the format cannot hold, opacity asked of a format without, or a place that cannot
/// be written to.
pub fn create(path: &Path, options: SinkOptions) -> Result<Box<dyn Sink>> {
    create_part(path, None, options)
}

/// [`create`], where the frames may be a part of a video's, `part` the number of the first: in a folder of PNG frames
/// they get their numbers in the whole and join the frames that are there; any other format holds the part alone.
///
/// # Errors
/// Those of [`create`].
pub fn create_part(path: &Path, part: Option<usize>, options: SinkOptions) -> Result<Box<dyn Sink>> {
    check_size(path, options)?;
    let format = Format::of(path)?;
    if options.alpha && !format.holds_alpha() {
        return Err(Error::file(Kind::Usage, path, "this format carries no opacity")
            .allowed(WITH_ALPHA)
            .remedy("give such a name, or leave out --alpha (output.alpha)"));
    }
    Ok(match format {
        Format::Stdout => Box::new(Y4mWriter::to_stdout(options)?),
        Format::Y4m => Box::new(Y4mWriter::create(path, options)?),
        Format::Npy => Box::new(NpyWriter::create(path, options)?),
        Format::Mp4 => Box::new(Mp4Writer::create(path, options)?),
        Format::Gif => Box::new(GifWriter::create(path, options)?),
        Format::Webp => Box::new(WebpWriter::create(path, options, Webp)?),
        Format::Apng => Box::new(ApngWriter::create(path, options, Apng::default())?),
        Format::Folder => Box::new(PngFolder::create(path, part, options)?),
    })
}

/// Whether [`create`] would make `path` a folder of PNG frames.
pub fn is_folder(path: &Path) -> bool {
    Format::of(path).is_ok_and(|format| format == Format::Folder)
}

/// Checks, before long work, that [`create`] will know the format of `path` and be able to write there.
///
/// # Errors
/// Those of [`create`], apart from the size.
pub fn check_writable(path: &Path) -> Result<()> {
    match Format::of(path)? {
        Format::Stdout => Ok(()),
        Format::Folder => AtomicFolder::create(path, is_frame_name).map(drop),
        _ if path.is_dir() => Err(Error::file(Kind::Io, path, "is a folder").remedy("give the name of a file")),
        _ => atomic_file::check_writable(path),
    }
}

fn check_size(path: &Path, options: SinkOptions) -> Result<()> {
    let (width, height) = (options.width, options.height);
    if (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height) {
        return Ok(());
    }
    Err(Error::file(Kind::Limit, path, format!("frames of {width} × {height} pixels cannot be written"))
        .allowed(format!("1 to {MAX_SIDE} pixels a side")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_tells_the_format() {
        let folder = tempfile::tempdir().unwrap();
        let format = |name: &str| Format::of(Path::new(name));
        assert_eq!(format("-").unwrap(), Format::Stdout);
        assert_eq!(format("a.MP4").unwrap(), Format::Mp4);
        assert_eq!((format("a.y4m").unwrap(), format("a.npy").unwrap()), (Format::Y4m, Format::Npy));
        assert_eq!(format("a.webp").unwrap(), Format::Webp);
        assert_eq!((format("a.apng").unwrap(), format("a.png").unwrap()), (Format::Apng, Format::Apng));
        assert_eq!(format("frames").unwrap(), Format::Folder);
        assert_eq!(format("take.2/").unwrap(), Format::Folder);
        assert_eq!(Format::of(folder.path()).unwrap(), Format::Folder);
        let error = format("a.mkv").unwrap_err();
        assert_eq!(error.kind(), Kind::Usage);
        assert!(error.to_string().contains(".mp4"), "{error}");
    }
}
