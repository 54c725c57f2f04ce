//! `enliven compare`: every method on every scene, in one folder with a page to look at.

mod baselines;
mod kept;
mod plan;
mod rows;

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::cli::common::{counted, say};
use crate::report::comparison::Comparison;
use plan::Plan;

/// Compare methods on scenes: videos that play in step, measures and plots on one page.
#[derive(Debug, Clone, clap::Args)]
pub struct Compare {
    /// Scene files, folders with a scene.toml, folders of enliven simulate, or pictures
    #[arg(required = true, value_name = "SCENE")]
    pub scenes: Vec<PathBuf>,
    /// Methods to compare [default: all]
    #[arg(long, value_name = "METHOD,…", value_delimiter = ',')]
    pub methods: Vec<String>,
    /// Values of an option to try one by one; may be given more than once, and all are combined
    #[arg(long, value_name = "METHOD.KEY=V1,V2,…")]
    pub sweep: Vec<String>,
    /// Library for scenes that name none; may be given more than once
    #[arg(long, value_name = "PACK")]
    pub library: Vec<PathBuf>,
    /// Exemplar for scenes that name none
    #[arg(long, value_name = "PICTURE|CLIP")]
    pub exemplar: Option<PathBuf>,
    /// Its opacity: a grey picture of its size, or "luminance" for footage on black [default: the file's own]
    #[arg(long, value_name = "luminance|PNG", requires = "exemplar")]
    pub exemplar_alpha: Option<PathBuf>,
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
    /// Folder to write to; what is finished there already is kept
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
}

/// Locked while a comparison writes into its folder.
const LOCK: &str = ".lock";

impl Compare {
    /// Runs the command.
    ///
    /// # Errors
    /// Bad input, by name; another comparison at work in the folder; a full disk; an interruption. A method that fails
    /// on a scene is told on the page instead.
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        let plan = Plan::new(self)?;
        std::fs::create_dir_all(&self.output).map_err(|e| Error::io(&self.output, "make the folder", e))?;
        let _lock = lock(&self.output)?;
        plan.write_scenes(&self.output)?;
        let mut comparison = Comparison { program: kept::program()?, command: plan.command(), scenes: Vec::new() };
        let mut failed = 0;
        for scene in &plan.scenes {
            let at = comparison.scenes.len();
            comparison.scenes.push(scene.empty());
            for cell in &scene.cells {
                let row = rows::row(&self.output, scene, cell, observer)?;
                failed += u64::from(row.failed.is_some());
                let shown = &mut comparison.scenes[at];
                shown.rows.push(row);
                rows::add_pictures(shown, &self.output);
                comparison.write(&self.output)?;
            }
        }
        say!("{}: {}", self.output.join("index.html").display(), summary(&plan, failed));
        Ok(())
    }
}

fn summary(plan: &Plan, failed: u64) -> String {
    let videos: usize = plan.scenes.iter().map(|scene| scene.cells.len()).sum();
    let (scenes, videos) = (counted(plan.scenes.len() as u64, "scene"), counted(videos as u64 - failed, "video"));
    if failed == 0 {
        format!("{scenes}, {videos}")
    } else {
        format!("{scenes}, {videos}; {failed} not made, see there")
    }
}

/// The folder's lock, as long as the file lives.
fn lock(folder: &Path) -> Result<File> {
    let path = folder.join(LOCK);
    let file = File::create(&path).map_err(|e| Error::io(&path, "write", e))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(Error::file(Kind::Usage, folder, "another comparison is at work here")
            .remedy("wait until it has ended, or name another folder with -o")),
        Err(TryLockError::Error(e)) => Err(Error::io(&path, "lock", e)),
    }
}
