//! `enliven compare`: every method on every scene, in one folder with a page to look at.

mod baselines;
mod blind;
mod kept;
mod pictures;
mod plan;
mod progress;
mod rows;

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer, Once};
use crate::cli::common::{counted, say};
use crate::report::comparison::{Comparison, Row};
use crate::scene::scene::SCENE_FILE;
use blind::Plant;
use kept::Fingerprints;
use plan::{Plan, PlannedScene};
use progress::Progress;

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

/// Locked while a comparison writes into its folder.
const LOCK: &str = ".lock";

impl Compare {
    /// Runs the command.
    ///
    /// # Errors
    /// Bad input, by name; another comparison at work in the folder; a full disk; an interruption. A method that fails
    /// on a scene is told on the page instead.
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        let start = Instant::now();
        if !self.votes.is_empty() {
            return blind::read_votes(&self.votes, &self.output, observer);
        }
        let plan = Plan::new(self)?;
        self.refuse_others_files()?;
        plan.notes.iter().for_each(|note| observer.note(note));
        std::fs::create_dir_all(&self.output).map_err(|e| Error::io(&self.output, "make the folder", e))?;
        let _lock = lock(&self.output)?;
        plan.write_scenes(&self.output)?;
        let (files, scenes) = (Fingerprints::default(), plan.scenes.iter().map(PlannedScene::empty).collect());
        let program = kept::program(&files)?;
        let mut comparison = Comparison { program, command: plan.command(), scenes, blind: None };
        let outcome = self.make(&plan, &mut comparison, &files, observer);
        let outcome = outcome.and_then(|in_methods| {
            if self.blind {
                blind::make(&comparison, &self.output, &plan.planted, observer)?;
            }
            Ok(in_methods)
        });
        let votes = blind::show_votes(&mut comparison, &self.output);
        let (all, missing) = (plan.cells().count(), comparison.to_make());
        let in_methods = outcome.map_err(|error| match error.kind() {
            Kind::Interrupted => {
                observer.note(&format!("{} of {all} videos are finished", all - missing));
                error.remedy("run the same command again to go on")
            }
            _ => error,
        })?;
        votes?;
        say!("{}: {}", self.output.join("index.html").display(), summary(&comparison));
        if in_methods > 0.0 {
            let around = start.elapsed().as_secs_f64() - in_methods;
            observer
                .note(&format!("{in_methods:.1} s in methods, {around:.1} s to measure and for the rows beside them"));
        }
        any_made(&plan, &comparison, &self.output)
    }

    /// A folder that holds a page of something else, or a scene, is not written into.
    fn refuse_others_files(&self) -> Result<()> {
        let own = [LOCK, "results.json"].iter().any(|file| self.output.join(file).exists());
        let found = ["index.html", "results.csv", SCENE_FILE].into_iter().find(|file| self.output.join(file).exists());
        match found.filter(|_| !own) {
            Some(file) => Err(Error::file(Kind::Usage, &self.output, format!("its {file} is not of a comparison"))
                .remedy("name another folder with -o")),
            None => Ok(()),
        }
    }

    /// Takes up what is finished, makes the rest, and writes the page after every row. Gives the seconds that the methods
    /// took.
    fn make(
        &self,
        plan: &Plan,
        comparison: &mut Comparison,
        files: &Fingerprints,
        observer: &dyn Observer,
    ) -> Result<f64> {
        // What is true of a scene is said once, not with every row.
        let listeners: Vec<Once> = plan.scenes.iter().map(|_| Once::new(observer)).collect();
        let mut to_make = Vec::new();
        for (s, c) in plan.cells() {
            observe::check(observer)?;
            let (scene, cell) = (&plan.scenes[s], &plan.scenes[s].cells[c]);
            let mut found = rows::look(&self.output.join(&scene.name), cell, files);
            match found.kept.take() {
                Some(row) => {
                    observer.note(&format!("{}, {}: kept, nothing has changed", scene.name, cell.name));
                    comparison.scenes[s].rows[c] = row;
                }
                None => to_make.push((s, c, found)),
            }
        }
        for (scene, shown) in plan.scenes.iter().zip(&mut comparison.scenes) {
            observe::check(observer)?;
            shown.pictures = pictures::write(scene, &self.output, observer)?;
        }
        comparison.write(&self.output)?;
        let rest = to_make.iter().map(|&(s, c, _)| progress::Task::new(&plan.scenes[s], &plan.scenes[s].cells[c]));
        let mut progress = Progress::new(plan.cells().count(), rest.collect());
        let mut in_methods = 0.0;
        for (s, c, found) in to_make {
            observe::check(observer)?;
            let (scene, cell) = (&plan.scenes[s], &plan.scenes[s].cells[c]);
            let called = format!("{} {}, {}", progress.place(), scene.name, cell.name);
            let start = Instant::now();
            comparison.scenes[s].rows[c] = rows::row(&self.output, scene, (cell, found), &called, &listeners[s])?;
            progress.done(start.elapsed().as_secs_f64());
            in_methods += comparison.scenes[s].rows[c].seconds.unwrap_or(0.0);
            comparison.write(&self.output)?;
        }
        Ok(in_methods)
    }
}

/// That none of the methods asked for could be run is a failure.
fn any_made(plan: &Plan, comparison: &Comparison, folder: &Path) -> Result<()> {
    let asked = |row: &&Row| plan.methods.contains(&row.method);
    let mut rows = comparison.scenes.iter().flat_map(|scene| &scene.rows).filter(asked).peekable();
    if rows.peek().is_some() && rows.all(|row| row.failed.is_some()) {
        let page = folder.join("index.html");
        return Err(Error::file(Kind::Unusable, &page, "no method could be run on any scene")
            .remedy("it says why; most need a library, an exemplar or a direction"));
    }
    Ok(())
}

fn summary(comparison: &Comparison) -> String {
    let rows = || comparison.scenes.iter().flat_map(|scene| &scene.rows);
    let made = rows().filter(|row| row.is_made()).count();
    let failed = rows().count() - made;
    let (scenes, videos) = (counted(comparison.scenes.len() as u64, "scene"), counted(made as u64, "video"));
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
