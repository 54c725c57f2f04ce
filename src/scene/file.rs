//! The scene file: TOML with paths relative to its folder, and each method's options as unread tables.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::exemplar_file::{self, ExemplarFile};
use crate::base::error::{Error, Kind, Result};
use crate::base::options::{Table, Value, explain, refuse_unknown, unknown};

/// Keys of a scene file outside its tables.
pub const KEYS: [&str; 14] = [
    "picture",
    "matte",
    "background",
    "library",
    "use",
    "without",
    "exemplar",
    "exemplar_alpha",
    "exemplars",
    "method",
    "reference",
    "target",
    "motion",
    "output",
];
/// Keys of `[target]`.
pub const TARGET_KEYS: [&str; 5] = ["flow", "alpha", "height", "height_white", "parameters"];
/// Keys of `[motion]`.
pub const MOTION_KEYS: [&str; 5] = ["direction", "strokes", "orientation", "speed", "max_speed"];
/// Keys of `[output]`.
pub const OUTPUT_KEYS: [&str; 8] =
    ["frames", "frames_range", "fps", "size", "working_size", "seed", "alpha", "max_memory"];

/// Keys that only the file of a simulation has.
const SIMULATION_KEYS: [&str; 5] = ["mode", "steps", "emitter", "obstacle", "sides"];

/// Frames of a loop when no number is asked for.
pub const DEFAULT_FRAMES: usize = 120;

/// A scene as a person writes it; everything but the picture, or the target, is optional.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SceneFile {
    /// The picture to animate; empty where there is a target.
    #[serde(skip_serializing_if = "is_empty")]
    pub picture: PathBuf,
    /// Grey image of the picture's size, white = fluid; none: all of it moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub matte: Option<PathBuf>,
    /// What is behind the fluid, of the picture's size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<PathBuf>,
    /// Packs to borrow motion from.
    pub library: Vec<PathBuf>,
    /// Only clips with one of these tags; empty: all clips.
    #[serde(rename = "use", skip_serializing_if = "Vec::is_empty")]
    pub tags: Vec<String>,
    /// Clips of the libraries that must not be used, by the names that reports give them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub without: Vec<String>,
    /// Registry name of the method.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
    /// A real clip to measure against.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<PathBuf>,
    /// Fluids whose looks are borrowed; none: the picture's own.
    #[serde(flatten, with = "exemplar_file::keys")]
    pub exemplars: Vec<ExemplarFile>,
    /// A designed target, instead of a picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<TargetFile>,
    /// Asked motion.
    pub motion: Motion,
    /// What to write.
    pub output: Output,
    /// Option tables by method name, unread; the methods check them.
    #[serde(flatten)]
    pub options: BTreeMap<String, Table>,
}

/// A designed target: folders of numbered frames, all of one size and with the same numbers.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TargetFile {
    /// Motion, pixels per frame: one file a frame ([`super::target`]); none: opacity alone is designed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flow: Option<PathBuf>,
    /// Opacity: one grey picture a frame, white = opaque.
    pub alpha: PathBuf,
    /// Height of the surface, one grey picture a frame, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height: Option<PathBuf>,
    /// Height at white (in OpenEXR pictures: at 1) in pixels of the target; none: what the `summary.json` of a simulation
    /// beside the folder says, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_white: Option<f32>,
    /// What else is known of every pixel, in [0, 1]: one grey picture a frame, or an `.npy` file `(t, y, x, channel)`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameters: Option<PathBuf>,
}

/// Asked motion; [`super::asked::Asked::read`] says what holds where several keys speak.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Motion {
    /// Main direction of the flow in degrees: 0 = right, 90 = down.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direction: Option<f32>,
    /// Strokes along the flow, JSON or a painting ([`crate::flow::stroke_files::read`]).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strokes: Option<PathBuf>,
    /// Directions painted as hues ([`crate::flow::orientation`]), of the picture's size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orientation: Option<PathBuf>,
    /// Grey speed map of the picture's size, black = still, white = `max_speed`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub speed: Option<PathBuf>,
    /// Speed at white, pixels of the picture per output frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_speed: Option<f32>,
}

/// What to write.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Output {
    /// Number of frames; none: [`DEFAULT_FRAMES`] of a picture, all of a target. A checked scene has it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<usize>,
    /// First frame of the loop to make, and the one after the last; none: all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames_range: Option<[usize; 2]>,
    /// Frames per second.
    pub fps: f32,
    /// Width and height in pixels; none: the picture's, at most 1920 on the long side.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[usize; 2]>,
    /// Long side, in pixels, of the image the motion is made at.
    pub working_size: usize,
    /// Seed of every random choice.
    pub seed: u64,
    /// Whether to write the fluid alone, with its opacity, for another program to put over its background.
    pub alpha: bool,
    /// Most memory to use, bytes; none: two gigabytes, or what one frame takes if that is more. Frames do not depend on
    /// it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_memory: Option<u64>,
}

impl Default for Output {
    fn default() -> Self {
        Self {
            frames: None,
            frames_range: None,
            fps: 25.0,
            size: None,
            working_size: 640,
            seed: 1,
            alpha: false,
            max_memory: None,
        }
    }
}

impl SceneFile {
    /// Whether the frames that are to be made loop: those of a designed target, and a part of a loop, do not.
    pub fn loops(&self) -> bool {
        self.target.is_none() && self.output.frames_range.is_none()
    }

    /// What the scene is called: the picture's file name, or the folder that the target lies in.
    pub fn title(&self) -> Cow<'_, str> {
        let named = self.target.as_ref().map_or(Some(&*self.picture), |target| target.lead().parent());
        named.and_then(Path::file_name).unwrap_or("target".as_ref()).to_string_lossy()
    }
}

impl TargetFile {
    /// What the target is known by: its flow, or its opacity where that is all.
    pub fn lead(&self) -> &Path {
        self.flow.as_deref().unwrap_or(&self.alpha)
    }
}

impl Output {
    /// Number of frames of the whole loop, or of the whole target.
    pub fn length(&self) -> usize {
        self.frames.unwrap_or(DEFAULT_FRAMES)
    }

    /// The frames that are to be made.
    pub fn wanted(&self) -> Range<usize> {
        self.frames_range.map_or(0..self.length(), |[first, end]| first..end)
    }
}

fn is_empty(path: &Path) -> bool {
    path.as_os_str().is_empty()
}

/// Reads the text of a scene file; `path` is for the messages.
///
/// # Errors
/// Broken TOML, unknown keys (naming the nearest), wrong sorts of values.
pub fn parse(text: &str, path: &Path) -> Result<SceneFile> {
    let bad = |e: toml::de::Error| Error::file(Kind::Usage, path, explain(&e, text)).source(e);
    let table: toml::Table = text.parse().map_err(bad)?;
    if let Some(key) = SIMULATION_KEYS.iter().find(|key| table.contains_key(**key)) {
        return Err(Error::file(Kind::Usage, path, format!("is a simulation, not a scene: it has {key}"))
            .remedy("run enliven simulate with it, and animate the folder that it writes"));
    }
    for (key, value) in &table {
        let inner = || value.as_table().into_iter().flat_map(|t| t.keys().map(String::as_str));
        match key.as_str() {
            "target" => refuse_unknown("target", inner(), &TARGET_KEYS),
            "motion" => refuse_unknown("motion", inner(), &MOTION_KEYS),
            "output" => refuse_unknown("output", inner(), &OUTPUT_KEYS),
            known if KEYS.contains(&known) => Ok(()),
            _ if value.is_table() => Ok(()),
            _ => Err(unknown("", key, &KEYS)),
        }
        .map_err(|error| error.within(path))?;
    }
    exemplar_file::check_keys(&table).map_err(|error| error.within(path))?;
    table.try_into().map_err(bad)
}

/// Writes a scene as a file's text.
///
/// # Errors
/// A path that is not UTF-8.
pub fn format(scene: &SceneFile) -> Result<String> {
    toml::to_string_pretty(scene)
        .map_err(|e| Error::new(Kind::Unusable, "scene", format!("cannot be written: {e}")).source(e))
}

/// Sets one option as typed on a command line, `METHOD.KEY=VALUE`.
///
/// # Errors
/// Text without that shape.
pub fn set(scene: &mut SceneFile, text: &str) -> Result<()> {
    let parts = text.split_once('=').and_then(|(name, value)| Some((name.split_once('.')?, value)));
    let Some(((method, key), value)) = parts else {
        return Err(Error::new(Kind::Usage, "--set", format!("cannot read {text:?}"))
            .allowed("METHOD.KEY=VALUE")
            .remedy("for example --set database.shutter=4"));
    };
    let table = scene.options.entry(method.trim().to_owned()).or_default();
    table.insert(key.trim().to_owned(), Value::parse(value));
    Ok(())
}
