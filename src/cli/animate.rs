//! `enliven animate`: a picture, a folder or a scene file to a looping video.

use std::path::PathBuf;

use crate::base::error::{Error, Kind, Result};
use crate::scene::file::{SceneFile, set};
use crate::scene::scene;

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
    /// Main direction of the flow in degrees: 0 right, 90 down, -90 up
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub direction: Option<f32>,
    /// What is behind the fluid, a picture of the same size
    #[arg(long, value_name = "PICTURE")]
    pub background: Option<PathBuf>,
    /// Method (see enliven methods)
    #[arg(long)]
    pub method: Option<String>,
    /// Frames of the loop [default: 120]
    #[arg(long)]
    pub frames: Option<usize>,
    /// Frames per second [default: 25]
    #[arg(long)]
    pub fps: Option<f32>,
    /// Size of the video [default: the picture's, at most 1920 on the long side]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[usize; 2]>,
    /// Long side of the image the motion is made at [default: 640]
    #[arg(long, value_name = "PX")]
    pub working_size: Option<usize>,
    /// Seed of every random choice [default: 1]
    #[arg(long)]
    pub seed: Option<u64>,
    /// An option of a method; may be given more than once
    #[arg(long = "set", value_name = "METHOD.KEY=VALUE")]
    pub set: Vec<String>,
    /// Video (.mp4, .gif, .y4m) or a name without extension for a folder of PNG frames; - is y4m on standard output
    #[arg(short, long)]
    pub output: PathBuf,
    /// Print the summary of the run as JSON
    #[arg(long)]
    pub json: bool,
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
        if !self.scene.exists() {
            return Err(Error::file(Kind::Usage, &self.scene, "no such file or folder")
                .allowed("a picture, a scene file, or a folder with a scene.toml"));
        }
        let mut file = scene::open(&self.scene)?;
        let over = self.clone();
        file.matte = over.matte.or(file.matte);
        file.background = over.background.or(file.background);
        file.method = over.method.or(file.method);
        file.motion.direction = over.direction.or(file.motion.direction);
        file.output.size = over.size.or(file.output.size);
        if !over.library.is_empty() {
            file.library = over.library;
        }
        if !over.tags.is_empty() {
            file.tags = over.tags;
        }
        file.output.frames = over.frames.unwrap_or(file.output.frames);
        file.output.fps = over.fps.unwrap_or(file.output.fps);
        file.output.working_size = over.working_size.unwrap_or(file.output.working_size);
        file.output.seed = over.seed.unwrap_or(file.output.seed);
        self.set.iter().try_for_each(|text| set(&mut file, text))?;
        Ok(file)
    }
}
