//! Opening a place to write frames to, by the name of the file.

use std::path::Path;

use super::apng::{Apng, ApngWriter};
use super::gif::GifWriter;
use super::mp4::Mp4Writer;
use super::png_folder::{PngFolder, is_frame_name};
use super::webp::{Webp, WebpWriter};
use super::y4m::Y4mWriter;
use crate::base::atomic_file::{self, AtomicFolder};
use crate::base::error::{Error, Kind, Result};
use crate::raster::image::Rgb8;
use crate::video::clip::Sink;

/// Longest side of a written frame, in pixels.
pub const MAX_SIDE: usize = 16_384;

/// Frames per second as a fraction in lowest terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRate {
    numerator: u32,
    denominator: u32,
}

impl FrameRate {
    /// The rate `fps`: whole numbers and the television rates (23.976, 29.97, 59.94… = 1000/1001 of a whole number)
    /// exactly, others to 1/1000.
    ///
    /// # Errors
    /// A rate outside 1 to 240.
    pub fn new(fps: f64) -> Result<Self> {
        if !(1.0..=240.0).contains(&fps) {
            return Err(Error::new(Kind::Usage, "frame rate", format!("{fps} frames per second")).allowed("1 to 240"));
        }
        let near = |n: f64, d: f64| (fps - n / d).abs() < 0.005;
        let (whole, television) = (fps.round(), (fps * 1.001).round() * 1000.0);
        let (numerator, denominator) = if (fps - whole).abs() < 0.0005 {
            (whole, 1.0)
        } else if near(television, 1001.0) {
            (television, 1001.0)
        } else {
            ((fps * 1000.0).round(), 1000.0)
        };
        let (numerator, denominator) = (numerator as u32, denominator as u32);
        let divisor = gcd(numerator, denominator);
        Ok(Self { numerator: numerator / divisor, denominator: denominator / divisor })
    }

    /// Numerator of the fraction.
    pub fn numerator(self) -> u32 {
        self.numerator
    }

    /// Denominator of the fraction.
    pub fn denominator(self) -> u32 {
        self.denominator
    }

    /// Frames per second.
    pub fn fps(self) -> f64 {
        f64::from(self.numerator) / f64::from(self.denominator)
    }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// What a sink has to know before the first frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SinkOptions {
    /// Width of every frame in pixels.
    pub width: usize,
    /// Height of every frame in pixels.
    pub height: usize,
    /// Frames per second.
    pub rate: FrameRate,
    /// Whether a player should start again at the end, where the format can say so (GIF, WebP, APNG).
    pub loops: bool,
    /// Whether every frame comes with its opacity; only PNG, WebP, APNG and (in one bit) GIF hold it.
    pub alpha: bool,
}

/// Where frames go, told by the name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Target {
    Stdout,
    Mp4,
    Gif,
    Webp,
    Apng,
    Y4m,
    Folder,
}

/// What names [`create`] accepts, for messages.
pub const SUPPORTED: &str =
    ".mp4, .gif, .webp, .apng (or .png), .y4m, a folder for PNG frames, or - for Y4M on standard output";
/// What holds opacity, for messages.
const WITH_ALPHA: &str =
    "a name without extension, for a folder of PNG frames; .webp; .apng; .gif, opaque or not and nothing between";

impl Target {
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
            Some(other) => Err(Error::file(Kind::Usage, path, format!("cannot write .{other}"))
                .allowed(SUPPORTED)
                .remedy("choose one of these, or end the name of a folder with a slash")),
        }
    }

    /// Whether the format holds opacity.
    fn holds_alpha(self) -> bool {
        matches!(self, Self::Folder | Self::Webp | Self::Apng | Self::Gif)
    }
}

/// Opens a sink for `path`, by its extension: `.mp4`, `.gif`, `.webp`, `.apng` or `.png`, `.y4m`; a name without extension, with a trailing slash, or of an
/// existing folder is a folder of `00000.png`, `00001.png`…; `-` is Y4M on standard output.
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
    let target = Target::of(path)?;
    if options.alpha && !target.holds_alpha() {
        return Err(Error::file(Kind::Usage, path, "this format carries no opacity")
            .allowed(WITH_ALPHA)
            .remedy("give such a name, or leave out --alpha (output.alpha)"));
    }
    Ok(match target {
        Target::Stdout => Box::new(Y4mWriter::to_stdout(options)?),
        Target::Y4m => Box::new(Y4mWriter::create(path, options)?),
        Target::Mp4 => Box::new(Mp4Writer::create(path, options)?),
        Target::Gif => Box::new(GifWriter::create(path, options)?),
        Target::Webp => Box::new(WebpWriter::create(path, options, Webp)?),
        Target::Apng => Box::new(ApngWriter::create(path, options, Apng::default())?),
        Target::Folder => Box::new(PngFolder::create(path, part, options)?),
    })
}

/// Whether [`create`] would make `path` a folder of PNG frames.
pub fn is_folder(path: &Path) -> bool {
    Target::of(path).is_ok_and(|target| target == Target::Folder)
}

/// Checks, before long work, that [`create`] will know the format of `path` and be able to write there.
///
/// # Errors
/// Those of [`create`], apart from the size.
pub fn check_writable(path: &Path) -> Result<()> {
    match Target::of(path)? {
        Target::Stdout => Ok(()),
        Target::Folder => AtomicFolder::create(path, is_frame_name).map(drop),
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

/// Refuses a frame of another size than was promised.
pub(super) fn check_frame(path: &Path, frame: &Rgb8, options: SinkOptions) -> Result<()> {
    let (width, height) = (options.width, options.height);
    if (frame.width, frame.height) == (width, height) && frame.data.len() == width * height * 3 {
        return Ok(());
    }
    let problem = format!("a frame of {} × {} pixels came", frame.width, frame.height);
    Err(Error::file(Kind::Data, path, problem).allowed(format!("{width} × {height}")))
}

/// Refuses opacity that was not announced, or that is of another size than the frame.
pub(super) fn check_alpha(path: &Path, frame: &Rgb8, alpha: &[u8], options: SinkOptions) -> Result<()> {
    if options.alpha && alpha.len() == frame.width * frame.height {
        return Ok(());
    }
    let problem = format!("opacity of {} pixels came with a frame of {} × {}", alpha.len(), frame.width, frame.height);
    Err(Error::file(Kind::Data, path, problem).allowed(if options.alpha { "one byte a pixel" } else { "none" }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_exact_fractions() {
        for (fps, fraction) in [
            (25.0, (25, 1)),
            (24.0, (24, 1)),
            (23.976, (24000, 1001)),
            (24000.0 / 1001.0, (24000, 1001)),
            (29.97, (30000, 1001)),
            (59.94, (60000, 1001)),
            (60.0, (60, 1)),
            (12.5, (25, 2)),
            (14.985, (15000, 1001)),
            (7.3, (73, 10)),
        ] {
            let rate = FrameRate::new(fps).unwrap();
            assert_eq!((rate.numerator(), rate.denominator()), fraction, "{fps}");
        }
        for fps in [0.0, -1.0, f64::NAN, f64::INFINITY, 1000.0] {
            assert_eq!(FrameRate::new(fps).unwrap_err().kind(), Kind::Usage);
        }
    }

    #[test]
    fn the_name_tells_the_format() {
        let folder = tempfile::tempdir().unwrap();
        let target = |name: &str| Target::of(Path::new(name));
        assert_eq!(target("-").unwrap(), Target::Stdout);
        assert_eq!(target("a.MP4").unwrap(), Target::Mp4);
        assert_eq!(target("a.y4m").unwrap(), Target::Y4m);
        assert_eq!(target("a.webp").unwrap(), Target::Webp);
        assert_eq!((target("a.apng").unwrap(), target("a.png").unwrap()), (Target::Apng, Target::Apng));
        assert_eq!(target("frames").unwrap(), Target::Folder);
        assert_eq!(target("take.2/").unwrap(), Target::Folder);
        assert_eq!(Target::of(folder.path()).unwrap(), Target::Folder);
        let error = target("a.mkv").unwrap_err();
        assert_eq!(error.kind(), Kind::Usage);
        assert!(error.to_string().contains(".mp4"), "{error}");
    }
}
