//! `enliven animate`: a picture, a folder or a scene file to a looping video.

use std::path::{Path, PathBuf};

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::text::counted;
use crate::cli::common::say;
use crate::cli::debug_pictures::DebugPictures;
use crate::raster::picture_io::picture_size;
use crate::report::animate::Places;
use crate::report::run::to_json;
use crate::scene::designed::Designed;
use crate::scene::exemplar_file::{ExemplarFile, with_opacities};
use crate::scene::file::{Motion, SceneFile, set};
use crate::scene::frame_map::{preview_size, preview_working};
use crate::scene::scene::{self, MIN_FRAMES};
use crate::synth::run;

/// Longest preview, seconds.
const PREVIEW_SECONDS: f32 = 2.0;

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
    /// than once [default: the picture's own fluid; okabe2009 needs one clip]
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
    /// Method (see enliven methods) [default: hybrid with a library (database with one of fire), lazyfluids with an exemplar, else advect]
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
    /// .webp, .apng, .gif or .npy, which carry opacity (.mp4 and .y4m do not)
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
        run::shrink_options(file);
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
                let record = places.animate(self.settings()?, &pictures);
                pictures.finish(record)?
            }
            None => places.animate(self.settings()?, observer)?,
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
