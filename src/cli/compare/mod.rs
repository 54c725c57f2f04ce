//! `enliven compare`: every method on every scene, in one folder with a page to look at.

mod arguments;
mod baselines;
mod blind;
mod figures;
mod kept;
mod lock;
mod pictures;
mod plan;
mod progress;
mod rows;

pub use arguments::Compare;

use std::path::Path;
use std::time::Instant;

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer, Once};
use crate::base::own_file::{self, Inputs};
use crate::cli::common::{counted, say};
use crate::report::comparison::blind::{KEY, PAGE};
use crate::report::comparison::{Comparison, Row};
use crate::scene::scene::{SCENE_FILE, file_of, for_each_path};
use kept::Fingerprints;
use lock::{LOCK, lock};
use plan::{Plan, PlannedScene};
use progress::Progress;

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
        self.refuse_others_files(&plan)?;
        plan.notes.iter().for_each(|note| observer.note(note));
        std::fs::create_dir_all(&self.output).map_err(|e| Error::io(&self.output, "make the folder", e))?;
        let _lock = lock(&self.output)?;
        plan.write_scenes(&self.output, &Inputs::new(self.scenes.iter().map(|path| file_of(path))))?;
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

    /// A folder that holds a page of something else, a scene, or a folder where a scene's rows would go, is not written
    /// into; nor is one that a scene would be read from and written to.
    fn refuse_others_files(&self, plan: &Plan) -> Result<()> {
        let at = |name: &str| self.output.join(name);
        for planned in &plan.scenes {
            let mut inputs = self.scenes.clone();
            for_each_path(&mut planned.file.clone(), |path| inputs.push(path.clone()));
            let folder = at(&planned.name);
            if let Some(input) = Inputs::new(inputs).within(&folder) {
                let problem = format!("lies in {}, where its videos would be written", folder.display());
                return Err(Error::file(Kind::Usage, input, problem).remedy("name another folder with -o"));
            }
        }
        if own_file::is_own(&at(LOCK)) || Comparison::read(&self.output).is_ok() {
            return Ok(());
        }
        let files = ["index.html", "results.csv", "results.json", "summary.csv", SCENE_FILE, KEY, PAGE];
        let file = files.into_iter().find(|file| at(file).exists());
        let filled = |name: &&str| std::fs::read_dir(at(name)).is_ok_and(|mut list| list.next().is_some());
        let folder = plan.scenes.iter().map(|scene| &*scene.name).find(filled);
        match file.or(folder) {
            Some(name) => Err(Error::file(Kind::Usage, &self.output, format!("its {name} is not of a comparison"))
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
