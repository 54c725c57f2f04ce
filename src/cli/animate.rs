//! `enliven animate`: a picture, a folder or a scene file to a looping video.

use std::path::{Path, PathBuf};

use crate::base::atomic_file;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::cli::common::say;
use crate::raster::image::Rgb8;
use crate::raster::picture_io::write_png;
use crate::report::contact_sheet::{contact_sheet, spread};
use crate::scene::file::{Motion, SceneFile, set};
use crate::scene::scene::{self, Scene};
use crate::synth;
use crate::synth::record::RunRecord;
use crate::video::clip::Sink;
use crate::video::sink::{self, FrameRate, SinkOptions};

/// Frames on a contact sheet.
const SHEET_FRAMES: usize = 12;
/// Widest contact sheet in pixels.
const SHEET_WIDTH: usize = 1920;

/// Animate a picture: its fluid moves, the rest stays as it is.
#[derive(Debug, Clone, clap::Args)]
pub struct Animate {
    /// A picture (PNG, JPEG, WebP), a scene file (.toml), or a folder with a scene.toml
    pub scene: PathBuf,
    /// Grey picture of the same size, white where the fluid is
    #[arg(long, value_name = "PNG")]
    pub matte: Option<PathBuf>,
    /// Library to borrow motion from, made with enliven-db build; may be given more than once
    #[arg(long, value_name = "PACK")]
    pub library: Vec<PathBuf>,
    /// Only clips with these tags (comma-separated)
    #[arg(long = "use", value_name = "TAG", value_delimiter = ',')]
    pub tags: Vec<String>,
    /// Clips of the library that must not be used, by the names that enliven-db inspect lists (comma-separated)
    #[arg(long, value_name = "CLIP", value_delimiter = ',')]
    pub without: Vec<String>,
    /// Main direction of the flow in degrees: 0 right, 90 down, -90 up
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = parse_number)]
    pub direction: Option<f32>,
    /// Strokes along the flow: JSON, or a PNG with coloured strokes on transparency, each from faint to strong
    #[arg(long, value_name = "JSON|PNG")]
    pub strokes: Option<PathBuf>,
    /// Directions painted as hues, a picture of the same size (--report writes one to start from)
    #[arg(long, value_name = "PNG")]
    pub orientation: Option<PathBuf>,
    /// Grey picture of the same size: black still, white as fast as --max-speed (--report writes one to start from)
    #[arg(long, value_name = "PNG")]
    pub speed: Option<PathBuf>,
    /// Speed at white of the speed map, pixels of the picture per frame
    #[arg(long, value_name = "PX", allow_negative_numbers = true, value_parser = parse_number)]
    pub max_speed: Option<f32>,
    /// What is behind the fluid, a picture of the same size: seen where the outline of fire or smoke moves away
    #[arg(long, value_name = "PICTURE")]
    pub background: Option<PathBuf>,
    /// Method (see enliven methods)
    #[arg(long)]
    pub method: Option<String>,
    /// Frames of the loop [default: 120]
    #[arg(long, allow_negative_numbers = true, value_parser = parse_count)]
    pub frames: Option<usize>,
    /// Frames per second [default: 25]
    #[arg(long, allow_negative_numbers = true, value_parser = parse_number)]
    pub fps: Option<f32>,
    /// Size of the video [default: the picture's, at most 1920 on the long side]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[usize; 2]>,
    /// Long side of the image the motion is made at [default: 640]
    #[arg(long, value_name = "PX", allow_negative_numbers = true, value_parser = parse_count)]
    pub working_size: Option<usize>,
    /// Seed of every random choice [default: 1]
    #[arg(long)]
    pub seed: Option<u64>,
    /// Write the fluid alone with its opacity, for another program to lay over something (not for .mp4 and .y4m)
    #[arg(long)]
    pub alpha: bool,
    /// An option of a method; may be given more than once
    #[arg(long = "set", value_name = "METHOD.KEY=VALUE")]
    pub set: Vec<String>,
    /// Video (.mp4, .webp, .apng, .gif, .y4m) or a name without extension for a folder of PNG frames; - is y4m on
    /// standard output
    #[arg(short, long)]
    pub output: PathBuf,
    /// Folder for a contact sheet, the picture of which clip went where, and the summary of the run
    #[arg(long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// Print the summary of the run as JSON
    #[arg(long)]
    pub json: bool,
}

fn parse_count(text: &str) -> std::result::Result<usize, String> {
    text.parse().map_err(|_| "write a whole number, such as 120".to_owned())
}

fn parse_number(text: &str) -> std::result::Result<f32, String> {
    text.parse().map_err(|_| "write a number, such as 90".to_owned())
}

fn parse_size(text: &str) -> std::result::Result<[usize; 2], String> {
    let parts = text.split_once(['x', 'X', '×']);
    let size = parts.and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
    size.ok_or_else(|| format!("{text:?} is not a size; write it like 1280x720"))
}

impl Animate {
    /// The scene file's settings with the command line's laid over them.
    ///
    /// # Errors
    /// Those of opening the scene, and malformed `--set`.
    pub fn settings(&self) -> Result<SceneFile> {
        let mut file = scene::open(&self.scene)?;
        let over = self.clone();
        file.matte = over.matte.or(file.matte);
        file.background = over.background.or(file.background);
        file.method = over.method.or(file.method);
        if over.direction.is_some() || over.strokes.is_some() || over.orientation.is_some() {
            // Whoever names a direction here does not want the scene's other ways of saying one.
            let Animate { direction, strokes, orientation, .. } = over;
            file.motion = Motion { direction, strokes, orientation, ..file.motion };
        }
        file.motion.speed = over.speed.or(file.motion.speed);
        file.motion.max_speed = over.max_speed.or(file.motion.max_speed);
        file.output.size = over.size.or(file.output.size);
        if !over.library.is_empty() {
            file.library = over.library;
        }
        if !over.tags.is_empty() {
            file.tags = over.tags;
        }
        if !over.without.is_empty() {
            file.without = over.without;
        }
        file.output.frames = over.frames.unwrap_or(file.output.frames);
        file.output.fps = over.fps.unwrap_or(file.output.fps);
        file.output.working_size = over.working_size.unwrap_or(file.output.working_size);
        file.output.alpha |= over.alpha;
        file.output.seed = over.seed.unwrap_or(file.output.seed);
        self.set.iter().try_for_each(|text| set(&mut file, text))?;
        Ok(file)
    }
}

impl Animate {
    /// Runs the command.
    ///
    /// # Errors
    /// Bad input, by name; a full disk; an interruption.
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        if self.json && self.output == Path::new("-") {
            return Err(Error::new(Kind::Usage, "--json", "standard output carries the video")
                .remedy("write the video to a file, or leave out --json"));
        }
        let record = animate(self.settings()?, &self.output, self.report.as_deref(), observer)?;
        if self.json {
            say!("{}", to_json(&record)?);
        } else {
            let (frames, (width, height)) = (record.scene.output.frames, record.output_size);
            let name =
                if self.output == Path::new("-") { "standard output".into() } else { self.output.to_string_lossy() };
            observer.note(&format!("{name}: {frames} frames of {width} × {height} in {:.1} s", record.seconds));
        }
        Ok(())
    }
}

/// Passes frames on and keeps some of them for the contact sheet.
struct Collector {
    inner: Box<dyn Sink>,
    wanted: Vec<usize>,
    next: usize,
    kept: Vec<Rgb8>,
}

impl Collector {
    fn keep(&mut self, frame: &Rgb8) {
        if self.wanted.contains(&self.next) {
            self.kept.push(frame.clone());
        }
        self.next += 1;
    }
}

impl Sink for Collector {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        self.keep(frame);
        self.inner.push(frame)
    }

    fn push_with_alpha(&mut self, frame: &Rgb8, alpha: &[u8]) -> Result<()> {
        self.keep(frame);
        self.inner.push_with_alpha(frame, alpha)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.inner.finish()
    }
}

/// Animates a scene to `output`; beside it the scene it ran (`.scene.toml`) and its summary (`.summary.json`). With
/// `report`, a folder, also the contact sheet and the pictures that explain the run.
///
/// # Errors
/// Bad input, by name; a full disk; an interruption. Nothing half-written stays.
pub fn animate(file: SceneFile, output: &Path, report: Option<&Path>, observer: &dyn Observer) -> Result<RunRecord> {
    let mut scene = Scene::new(file)?;
    synth::resolve(&mut scene)?;
    refuse_input(output, scene.settings())?;
    sink::check_writable(output)?;
    if let Some(folder) = report {
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "make the folder", e))?;
    }
    let to_stdout = output == Path::new("-");
    let settings = scene.settings().output;
    let (width, height) = scene.frame_map().output;
    let rate = FrameRate::new(f64::from(settings.fps))?;
    let inner = sink::create(output, SinkOptions { width, height, rate, loops: true, alpha: settings.alpha })?;
    let wanted = if report.is_some() { spread(settings.frames, SHEET_FRAMES) } else { Vec::new() };
    let mut collector = Box::new(Collector { inner, wanted, next: 0, kept: Vec::new() });
    let outcome = synth::run(&scene, &mut *collector, observer)?;
    let frames = std::mem::take(&mut collector.kept);
    collector.finish()?;
    if !to_stdout {
        let folder = output.parent().unwrap_or(Path::new(""));
        atomic_file::write(&beside(output, "scene.toml"), scene.to_toml(folder)?.as_bytes())?;
        atomic_file::write(&beside(output, "summary.json"), to_json(&outcome.record)?.as_bytes())?;
    }
    if let Some(folder) = report {
        write_png(&folder.join("contact-sheet.png"), &contact_sheet(&frames, 4, SHEET_WIDTH))?;
        for (name, picture) in &outcome.pictures {
            write_png(&folder.join(name).with_extension("png"), picture)?;
        }
        atomic_file::write(&folder.join("summary.json"), to_json(&outcome.record)?.as_bytes())?;
        if let Some(speed) = outcome.record.max_speed {
            let path = folder.join("speed.png");
            observer.note(&format!("{}: white is {speed} pixels of the picture per frame", path.display()));
        }
    }
    Ok(outcome.record)
}

/// Refuses to write over what the scene is made from.
fn refuse_input(output: &Path, file: &SceneFile) -> Result<()> {
    let Ok(output) = output.canonicalize() else { return Ok(()) };
    let SceneFile { picture, matte, background, reference, library, motion, .. } = file;
    let Motion { strokes, orientation, speed, .. } = motion;
    let optional = [matte, background, reference, strokes, orientation, speed];
    let mut inputs = optional.into_iter().flatten().chain(library).chain([picture]);
    match inputs.find(|path| path.canonicalize().is_ok_and(|path| path == output)) {
        Some(path) => Err(Error::file(Kind::Usage, path, "is read for this video and would be written over")
            .remedy("give another name with -o")),
        None => Ok(()),
    }
}

/// `falls.mp4` and `scene.toml` to `falls.scene.toml`; a folder keeps its whole name.
pub(super) fn beside(output: &Path, what: &str) -> PathBuf {
    let name = if output.is_dir() { output.file_name() } else { output.file_stem() };
    let mut name = name.unwrap_or_default().to_os_string();
    name.push(".");
    name.push(what);
    output.with_file_name(name)
}

fn to_json(record: &RunRecord) -> Result<String> {
    serde_json::to_string_pretty(record).map_err(|e| Error::new(Kind::Data, "summary", e.to_string()))
}
