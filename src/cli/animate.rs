//! `enliven animate`: a picture, a folder or a scene file to a looping video.

use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::options::Value;
use crate::base::own_file::{self, Inputs};
use crate::base::text::counted;
use crate::cli::common::say;
use crate::cli::debug_pictures::DebugPictures;
use crate::cli::measure::record_of;
use crate::library::names::Names;
use crate::raster::image::Rgb8;
use crate::raster::picture_io::{picture_size, write_own_png};
use crate::report::arrays::Arrays;
use crate::report::contact_sheet::spread;
use crate::report::run::{FILES, SHEET_FRAMES, to_json, write as write_report};
use crate::scene::designed::Designed;
use crate::scene::exemplar_file::{ExemplarFile, with_opacities};
use crate::scene::file::{Motion, SceneFile, set};
use crate::scene::frame_map::{preview_size, preview_working};
use crate::scene::scene::{self, MIN_FRAMES, SCENE_FILE, Scene, for_each_path};
use crate::synth::methods::{DEFAULT_METHOD, REGISTRY};
use crate::synth::record::RunRecord;
use crate::synth::run;
use crate::video::clip::Sink;
use crate::video::write::both::Both;
use crate::video::write::options::{FrameRate, SinkOptions};
use crate::video::write::sink;

/// What the record of a run is called beside its video.
pub(super) const SUMMARY: &str = "summary.json";
/// Longest preview, seconds.
const PREVIEW_SECONDS: f32 = 2.0;
/// Candidates per node of a preview.
const PREVIEW_CANDIDATES: i64 = 25;

/// Animate a picture: its fluid moves, the rest stays as it is.
#[derive(Debug, Clone, clap::Args)]
pub struct Animate {
    /// A picture (PNG, JPEG, WebP), a scene file (.toml), a folder with a scene.toml, or one of `enliven simulate`
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
    /// Clips of the library that must not be used, by file name or hash as enliven-db inspect lists them (comma-separated)
    #[arg(long, value_name = "CLIP", value_delimiter = ',')]
    pub without: Vec<String>,
    /// Picture, clip or folder of frames of a fluid whose looks are borrowed, for the exemplar methods; may be given more
    /// than once [default: the picture's own fluid]
    #[arg(long, value_name = "PICTURE|CLIP")]
    pub exemplar: Vec<PathBuf>,
    /// Opacity of the exemplar: a grey picture or clip of its size, "luminance" for footage on black, or "darkness" for
    /// footage on white; once for all exemplars, or for each in their order [default: the file's own]
    #[arg(long, value_name = "luminance|darkness|FILE")]
    pub exemplar_alpha: Vec<PathBuf>,
    /// Main direction of the flow in degrees: 0 right, 90 down, -90 up
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = parse_direction)]
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
    /// Make only frames A to B of the loop, B left out; in a folder of PNG frames they join those that are there
    #[arg(long, value_name = "A..B", value_parser = parse_range)]
    pub frames_range: Option<[usize; 2]>,
    /// Frames per second [default: 25]
    #[arg(long, allow_negative_numbers = true, value_parser = parse_number)]
    pub fps: Option<f32>,
    /// Size of the video [default: the picture's, at most 1920 on the long side]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[usize; 2]>,
    /// Long side of the image the motion is made at [default: 640]
    #[arg(long, value_name = "PX", allow_negative_numbers = true, value_parser = parse_count)]
    pub working_size: Option<usize>,
    /// A quick look: a quarter of the size, two seconds, few candidates; the first frame is written as OUT.preview.png at
    /// once
    #[arg(long)]
    pub preview: bool,
    /// Most memory to use, such as 800M or 2G [default: 2G, or what one frame takes if that is more]
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    pub max_memory: Option<u64>,
    /// Seed of every random choice [default: 1]
    #[arg(long)]
    pub seed: Option<u64>,
    /// Write the fluid alone with its opacity, for another program to lay over something: into a folder of PNG frames,
    /// .webp, .apng or .gif, which carry opacity (.mp4 and .y4m do not)
    #[arg(long)]
    pub alpha: bool,
    /// An option of a method; may be given more than once
    #[arg(long = "set", value_name = "METHOD.KEY=VALUE")]
    pub set: Vec<String>,
    /// Video (.mp4, .webp, .apng, .gif, .y4m, or .npy for NumPy) or a name without extension for a folder of PNG frames; - is y4m on
    /// standard output
    #[arg(short, long)]
    pub output: PathBuf,
    /// Folder for a page (index.html) with a contact sheet, which clip went where, the motion, and where time went
    #[arg(long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// Folder for NumPy arrays (.npy): the frames, the motion that was used and asked for, and which piece went where
    #[arg(long, value_name = "DIR")]
    pub arrays: Option<PathBuf>,
    /// Folder for pictures of the patch field, the usage counts and the channels on every level of every frame, for the
    /// methods that match patches
    #[arg(long, value_name = "DIR")]
    pub debug: Option<PathBuf>,
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

fn parse_direction(text: &str) -> std::result::Result<f32, String> {
    text.parse().map_err(|_| "write degrees: 0 is right, 90 down, 180 left, -90 up".to_owned())
}

fn parse_range(text: &str) -> std::result::Result<[usize; 2], String> {
    let range = text.split_once("..").and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    range.ok_or_else(|| format!("{text:?} is not a range of frames; write it like 0..40, 40 being left out"))
}

fn parse_bytes(text: &str) -> std::result::Result<u64, String> {
    let (number, unit) = text.split_at(text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len()));
    let unit = match unit.trim().to_ascii_uppercase().as_str() {
        "M" | "MB" => 1e6,
        "G" | "GB" => 1e9,
        _ => 0.0,
    };
    let bytes = number.parse::<f64>().unwrap_or(0.0) * unit;
    if bytes >= 1.0 {
        Ok(bytes as u64)
    } else {
        Err(format!("{text:?} is not an amount of memory; write it like 800M or 2G"))
    }
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
        run::check_options(&file.options).map_err(|error| error.within(&scene::file_of(&self.scene)))?;
        let over = self.clone();
        file.matte = over.matte.or(file.matte);
        file.background = over.background.or(file.background);
        if !over.exemplar.is_empty() {
            // The scene's opacity belongs to the scene's exemplar.
            file.exemplars = over.exemplar.into_iter().map(ExemplarFile::new).collect();
        }
        file.exemplars = with_opacities(file.exemplars, over.exemplar_alpha)?;
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
        file.output.frames = over.frames.or(file.output.frames);
        file.output.fps = over.fps.unwrap_or(file.output.fps);
        file.output.working_size = over.working_size.unwrap_or(file.output.working_size);
        file.output.alpha |= over.alpha;
        file.output.seed = over.seed.unwrap_or(file.output.seed);
        file.output.frames_range = over.frames_range.or(file.output.frames_range);
        file.output.max_memory = over.max_memory.or(file.output.max_memory);
        self.set.iter().try_for_each(|text| set(&mut file, text))?;
        if self.preview {
            self.make_preview(&mut file)?;
        }
        Ok(file)
    }
}

impl Animate {
    /// Makes a scene one that is seen quickly; what the command line says by itself stays.
    fn make_preview(&self, file: &mut SceneFile) -> Result<()> {
        let target = file.target.as_ref().map(|target| Designed::open(file, target)).transpose()?;
        let output = &mut file.output;
        let size = match &target {
            Some(target) => Some(target.size),
            None if file.picture.as_os_str().is_empty() => None,
            None => Some(picture_size(&file.picture)?),
        };
        if let Some(size) = size.filter(|_| self.size.is_none()) {
            output.size = Some(preview_size(size, output.size));
        }
        if let Some(size) = size.filter(|_| self.working_size.is_none()) {
            output.working_size = preview_working(size, output.working_size);
        }
        if self.frames.is_none() && output.frames_range.is_none() {
            let all = target.map_or(Ok(output.length()), |target| target.length(output))?;
            output.frames = Some(all.min((PREVIEW_SECONDS * output.fps) as usize).max(MIN_FRAMES));
        }
        let name = file.method.as_deref().unwrap_or(DEFAULT_METHOD);
        let method = REGISTRY.iter().find(|m| m.name == name);
        if method.is_some_and(|m| (m.options)().iter().any(|option| option.name == "candidates")) {
            let options = file.options.entry(name.to_owned()).or_default();
            options.entry("candidates".into()).or_insert(Value::Integer(PREVIEW_CANDIDATES));
        }
        Ok(())
    }

    /// Runs the command.
    ///
    /// # Errors
    /// Bad input, by name; a full disk; an interruption.
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        if self.json && self.output == Path::new("-") {
            return Err(Error::new(Kind::Usage, "--json", "standard output carries the video")
                .remedy("write the video to a file, or leave out --json"));
        }
        let places = Places {
            scene: scene::files_of(&self.scene),
            output: &self.output,
            report: self.report.as_deref(),
            arrays: self.arrays.as_deref(),
            preview: self.preview,
        };
        let record = match &self.debug {
            Some(folder) => {
                let pictures = DebugPictures::new(observer, folder.clone())?;
                let record = run(self.settings()?, &places, &pictures);
                pictures.finish(record)?
            }
            None => run(self.settings()?, &places, observer)?,
        };
        let method = record.scene.method.as_deref().unwrap_or_default();
        for option in self.set.iter().filter(|text| text.split('.').next() != Some(method)) {
            observer.note(&format!("--set {option}: not used, the method is {method}"));
        }
        if self.json {
            say!("{}", to_json(&record)?);
        } else {
            let (width, height) = record.output_size;
            let frames = record.scene.output.wanted().len();
            let name =
                if self.output == Path::new("-") { "standard output".into() } else { self.output.to_string_lossy() };
            let frames = counted(frames as u64, "frame");
            observer.note(&format!("{name}: {frames} of {width} × {height} in {:.1} s", record.seconds));
        }
        Ok(())
    }
}

/// Where a run writes, and where its settings come from.
struct Places<'a> {
    /// The files that tell the settings.
    scene: Vec<PathBuf>,
    output: &'a Path,
    report: Option<&'a Path>,
    arrays: Option<&'a Path>,
    /// Whether the first frame is written beside the output as soon as it is made (`.preview.png`).
    preview: bool,
}

/// Passes frames on and keeps some of them for the contact sheet.
struct Collector {
    inner: Box<dyn Sink>,
    wanted: Vec<usize>,
    next: usize,
    kept: Vec<Rgb8>,
    /// Where the first frame goes by itself.
    preview: Option<PathBuf>,
}

impl Collector {
    fn keep(&mut self, frame: &Rgb8, alpha: Option<&[u8]>) -> Result<()> {
        let seen = || alpha.map_or_else(|| frame.clone(), |alpha| on_squares(frame, alpha));
        if self.wanted.contains(&self.next) {
            self.kept.push(seen());
        }
        if let Some(path) = self.preview.take() {
            write_own_png(&path, &seen())?;
        }
        self.next += 1;
        Ok(())
    }
}

impl Sink for Collector {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        self.keep(frame, None)?;
        self.inner.push(frame)
    }

    fn push_with_alpha(&mut self, frame: &Rgb8, alpha: &[u8]) -> Result<()> {
        self.keep(frame, Some(alpha))?;
        self.inner.push_with_alpha(frame, alpha)
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.inner.finish()
    }
}

/// A frame with opacity as picture programs show it, over grey squares.
fn on_squares(frame: &Rgb8, alpha: &[u8]) -> Rgb8 {
    const SIDE: usize = 16;
    let mut out = frame.clone();
    for (i, (pixel, &alpha)) in out.data.chunks_exact_mut(3).zip(alpha).enumerate() {
        let (x, y) = (i % frame.width, i / frame.width);
        let square = if (x / SIDE + y / SIDE).is_multiple_of(2) { 150 } else { 105 };
        let over = |byte: u8| (u32::from(byte) * u32::from(alpha) + square * (255 - u32::from(alpha)) + 127) / 255;
        pixel.iter_mut().for_each(|byte| *byte = over(*byte) as u8);
    }
    out
}

/// Animates a scene to `output`; beside it the scene it ran (`.scene.toml`) and its summary (`.summary.json`), or under
/// another name (`.run.scene.toml`) where a person's files have these. With `report`, a folder, also the contact sheet and the pictures that explain the run.
///
/// # Errors
/// Bad input, by name; a full disk; an interruption. Nothing half-written stays.
pub fn animate(file: SceneFile, output: &Path, report: Option<&Path>, observer: &dyn Observer) -> Result<RunRecord> {
    run(file, &Places { scene: Vec::new(), output, report, arrays: None, preview: false }, observer)
}

fn run(file: SceneFile, places: &Places, observer: &dyn Observer) -> Result<RunRecord> {
    let &Places { output, report, preview, .. } = places;
    let mut scene = Scene::new(file)?;
    run::resolve(&mut scene)?;
    let inputs = places.inputs(scene.settings());
    places.refuse_input(&inputs)?;
    sink::check_writable(output)?;
    let to_stdout = output == Path::new("-");
    let settings = scene.settings().output;
    let (width, height) = scene.frame_map().output;
    let rate = FrameRate::new(f64::from(settings.fps))?;
    let frames = scene.wanted_frames();
    let (loops, part) = (scene.settings().loops(), settings.frames_range.map(|_| frames.start));
    refuse_stranger(output, part.map(|_| frames.clone()))?;
    let options = SinkOptions { width, height, rate, loops, alpha: settings.alpha };
    let mut inner = sink::create_part(output, part, options)?;
    let arrays = places.arrays.map(Arrays::create).transpose()?;
    if let Some(arrays) = &arrays {
        inner = Box::new(Both(inner, sink::create(&arrays.frames(), options)?));
    }
    if let Some(folder) = report {
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "make the folder", e))?;
    }
    let wanted = if report.is_some() { spread(frames.len(), SHEET_FRAMES) } else { Vec::new() };
    let preview = (preview && !to_stdout).then(|| free_beside(output, "preview.png", &inputs, observer));
    let mut collector = Box::new(Collector { inner, wanted, next: 0, kept: Vec::new(), preview });
    let outcome = run::run(&scene, &mut *collector, observer)?;
    scene.leave_out(outcome.record.scene.without.clone());
    let frames = std::mem::take(&mut collector.kept);
    collector.finish()?;
    arrays.map_or(Ok(()), |arrays| arrays.finish(&outcome))?;
    if !to_stdout {
        let folder = output.parent().unwrap_or(Path::new(""));
        let write =
            |what, text: String| own_file::write(&free_beside(output, what, &inputs, observer), text.as_bytes());
        write(SCENE_FILE, scene.to_toml(folder)?)?;
        write(SUMMARY, to_json(&outcome.record)?)?;
    }
    if let Some(folder) = report {
        let video = (!to_stdout).then(|| scene::relative(output, folder));
        write_report(folder, &outcome, &frames, video.as_deref())?;
        if let Some(speed) = outcome.record.max_speed {
            let path = folder.join("speed.png");
            observer.note(&format!("{}: white is {speed} pixels of the picture per frame", path.display()));
        }
    }
    Ok(outcome.record)
}

impl Places<'_> {
    /// What the video is made from: the files of the settings, and all that they name.
    fn inputs(&self, file: &SceneFile) -> Inputs {
        let mut paths = self.scene.clone();
        for_each_path(&mut file.clone(), |path| paths.push(path.clone()));
        paths.extend(file.library.iter().map(|pack| Names::beside(pack)));
        Inputs::new(paths)
    }

    /// Refuses to write over what the video is made from, by the video or the report; and over files in the folder of the
    /// report that are not an earlier report's.
    fn refuse_input(&self, inputs: &Inputs) -> Result<()> {
        let remedy = "give another name with -o, or another folder with --report";
        if self.output != Path::new("-") {
            inputs.refuse(self.output, "video", remedy)?;
        }
        let files = || self.report.into_iter().flat_map(|folder| FILES.map(|name| folder.join(name)));
        files().try_for_each(|path| inputs.refuse(&path, "video", remedy))?;
        files().try_for_each(|path| own_file::check(&path))
    }
}

/// Refuses to replace a video, or `part` of the frames in a folder, that nothing beside it tells to be of an earlier run.
fn refuse_stranger(output: &Path, part: Option<Range<usize>>) -> Result<()> {
    let there = if output.is_dir() {
        let frame = |path: PathBuf| path.file_stem().and_then(|stem| stem.to_str()?.parse().ok());
        let list = std::fs::read_dir(output).map_err(|e| Error::io(output, "list", e))?;
        let mut frames = list.flatten().filter_map(|entry| frame(entry.path()));
        frames.any(|number| part.as_ref().is_none_or(|part| part.contains(&number)))
    } else {
        output.metadata().is_ok_and(|found| found.len() > 0)
    };
    if !there || record_of(output).is_ok_and(|record| record.is_some()) {
        return Ok(());
    }
    let record = beside(output, SUMMARY);
    let problem = format!("is there already, and no {} tells that enliven made it", record.display());
    Err(Error::file(Kind::Usage, output, problem).remedy("move it away, or give another name with -o"))
}

/// Where a file of the program's own goes beside `output`: under its usual name, or where a person's file or one that this
/// run reads has that, under the next that is free, which is told.
fn free_beside(output: &Path, what: &str, inputs: &Inputs, observer: &dyn Observer) -> PathBuf {
    let usual = beside(output, what);
    let path = inputs.free(names_beside(output, what)).unwrap_or_else(|| usual.clone());
    if path != usual {
        observer.note(&format!("{}: stays as it is; this run writes {}", usual.display(), path.display()));
    }
    path
}

/// What was written beside a video by the latest run: of the files of the program's own the youngest, else one that a person
/// put there under the usual name.
pub(super) fn written_beside(video: &Path, what: &str) -> Option<PathBuf> {
    let usual = beside(video, what);
    let others = names_beside(video, what).skip(1).take_while(|path| path.exists());
    let own = std::iter::once(usual.clone()).chain(others).filter(|path| own_file::is_own(path));
    let age = |path: &PathBuf| path.metadata().and_then(|found| found.modified()).ok();
    own.max_by_key(age).or_else(|| usual.exists().then_some(usual))
}

/// `falls.scene.toml`, `falls.run.scene.toml`, `falls.run2.scene.toml`…
fn names_beside(output: &Path, what: &str) -> impl Iterator<Item = PathBuf> {
    let numbered = (2..1000).map(|n| format!("run{n}.")).map(Cow::Owned);
    let infixes = [Cow::Borrowed(""), "run.".into()].into_iter().chain(numbered);
    infixes.map(move |infix| beside(output, &format!("{infix}{what}")))
}

/// `falls.mp4` and `scene.toml` to `falls.scene.toml`; a folder keeps its whole name, whether it is there yet or not.
fn beside(output: &Path, what: &str) -> PathBuf {
    let name = if sink::is_folder(output) { output.file_name() } else { output.file_stem() };
    let mut name = name.unwrap_or_default().to_os_string();
    name.push(".");
    name.push(what);
    output.with_file_name(name)
}
