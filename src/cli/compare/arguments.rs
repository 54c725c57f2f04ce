//! What is asked of a comparison.

use std::path::PathBuf;

use super::blind::Plant;

/// Compare methods on scenes: videos that play in step, measures and plots on one page.
#[derive(Debug, Clone, clap::Args)]
pub struct Compare {
    /// Scene files, folders with a scene.toml, folders of enliven simulate, or pictures
    #[arg(required_unless_present = "votes", value_name = "SCENE")]
    pub scenes: Vec<PathBuf>,
    /// Methods to compare [default: all]
    #[arg(long, value_name = "METHOD,…", value_delimiter = ',', value_parser = trimmed)]
    pub methods: Vec<String>,
    /// Values of an option to try one by one; may be given more than once, and all are combined
    #[arg(long, value_name = "METHOD.KEY=V1,V2,…")]
    pub sweep: Vec<String>,
    /// Library for scenes that name none; may be given more than once
    #[arg(long, value_name = "PACK")]
    pub library: Vec<PathBuf>,
    /// Exemplar for scenes that name none; may be given more than once
    #[arg(long, value_name = "PICTURE|CLIP")]
    pub exemplar: Vec<PathBuf>,
    /// Its opacity: a grey picture or clip of its size, "luminance" for footage on black, or "darkness" for footage on
    /// white; once for all exemplars, or for each in their order [default: the file's own]
    #[arg(long, value_name = "luminance|darkness|FILE", requires = "exemplar")]
    pub exemplar_alpha: Vec<PathBuf>,
    /// Frames of each video [default: the scenes']
    #[arg(long, value_name = "N")]
    pub frames: Option<usize>,
    /// Long side of the image the motion is made at [default: the scenes']
    #[arg(long, value_name = "PX")]
    pub working_size: Option<usize>,
    /// Seed of every random choice [default: the scenes']
    #[arg(long)]
    pub seed: Option<u64>,
    /// An option of a method; may be given more than once
    #[arg(long = "set", value_name = "METHOD.KEY=VALUE")]
    pub set: Vec<String>,
    /// Also make a page on which people choose between two unnamed videos, for a blind test
    #[arg(long)]
    pub blind: bool,
    /// Bad videos in the blind test, to see whether votes mean anything [default: frozen]
    #[arg(long, value_name = "BAD,…", value_delimiter = ',', requires = "blind")]
    pub plant: Vec<Plant>,
    /// Files of votes that the blind test's page saved: what they say is added to the comparison in DIR
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with_all = MAKING)]
    pub votes: Vec<PathBuf>,
    /// Folder to write to; what is finished there already is kept
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
}

/// Options of making a comparison, which votes are read into without making it again.
const MAKING: [&str; 11] = [
    "scenes",
    "methods",
    "sweep",
    "library",
    "exemplar",
    "exemplar_alpha",
    "frames",
    "working_size",
    "seed",
    "set",
    "blind",
];

fn trimmed(text: &str) -> std::result::Result<String, std::convert::Infallible> {
    Ok(text.trim().to_owned())
}
