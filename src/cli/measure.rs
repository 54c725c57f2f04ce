//! `enliven measure`: numbers for what a video looks like and how it moves.

use std::path::PathBuf;

use serde_json::json;

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::cli::common::{columns, counted, say, wrapped};
use crate::measure::Value;
use crate::measure::footage::LONG_SIDE;
use crate::report::beside::{record_of, written_beside};
use crate::report::measuring::{Measuring, Request};
use crate::report::yardstick::{Reference, Yardstick};
use crate::scene::file::SceneFile;
use crate::scene::scene::{self, SCENE_FILE, Scene};
use crate::synth::record::RunRecord;

/// Measure a video: how it moves, how sharp it stays, whether its seams and its loop show.
#[derive(Debug, Clone, clap::Args)]
pub struct Measure {
    /// A video or a folder of frames; what was written beside it when it was made is read too
    pub video: PathBuf,
    /// The scene it was made from [default: the one written beside it]
    #[arg(long)]
    pub scene: Option<PathBuf>,
    /// A real clip that it should move like [default: the scene's reference]
    #[arg(long, value_name = "CLIP")]
    pub reference: Option<PathBuf>,
    /// Grey picture of the reference's shape, white where its fluid is [default: the scene's matte when the clip has the
    /// video's size, else all of it]
    #[arg(long, value_name = "PNG")]
    pub reference_matte: Option<PathBuf>,
    /// Long side in pixels that the reference is measured at, so that its waves are as long as the video's
    #[arg(long, value_name = "PX", default_value_t = LONG_SIDE)]
    pub reference_size: usize,
    /// The video loops; one that enliven made is known to
    #[arg(long)]
    pub loops: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Columns that a definition below its measure stands in.
const INDENT: usize = 6;

impl Measure {
    /// Runs the command.
    ///
    /// # Errors
    /// A video, scene, record or reference that cannot be read or does not fit; a cancel.
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        self.check()?;
        let record = record_of(&self.video)?;
        let reference = Reference {
            clip: self.reference.clone(),
            matte: self.reference_matte.clone(),
            long_side: self.reference_size,
        };
        let yardstick = Yardstick::read(self.scene_of(record.as_ref())?, reference, observer)?;
        let request = Request { record: record.as_ref(), loops: self.loops, ..Request::new(&self.video) };
        let measuring = Measuring::read(&request, &yardstick, observer)?;
        self.print(&measuring, &measuring.values(observer)?)
    }

    fn check(&self) -> Result<()> {
        if (16..=4096).contains(&self.reference_size) {
            return Ok(());
        }
        let problem = format!("{} is out of range", self.reference_size);
        Err(Error::new(Kind::Usage, "--reference-size", problem).allowed("16 to 4096 pixels"))
    }

    /// The scene that the video was made from, without what measuring does not need: the one named, else the one
    /// beside the video, else the one in the record.
    fn scene_of(&self, record: Option<&RunRecord>) -> Result<Option<Scene>> {
        let path = self.scene.clone().or_else(|| written_beside(&self.video, SCENE_FILE));
        let file = match path {
            Some(path) => Some(scene::open(&path)?),
            None => record.map(|record| record.scene.clone()),
        };
        file.map(|file| Scene::new(bare(file))).transpose()
    }

    fn print(&self, measuring: &Measuring, values: &[Value]) -> Result<()> {
        let Measuring { size, footage, fitted, .. } = measuring;
        if !self.json {
            say!(
                "{}: {} of {} × {} at {} per second, measured at {} × {}",
                self.video.display(),
                counted(footage.frames().len() as u64, "frame"),
                size.0,
                size.1,
                footage.fps(),
                footage.width(),
                footage.height()
            );
            let columns = columns();
            values.iter().flat_map(|value| row(value, columns)).for_each(|line| say!("{line}"));
            return Ok(());
        }
        let rows: Vec<_> = values
            .iter()
            .map(|(m, value)| {
                json!({ "name": m.name, "value": value, "unit": m.unit, "better": m.better.words(),
                    "definition": m.definition, "needs": m.needs })
            })
            .collect();
        let report = json!({
            "video": self.video, "frames": footage.frames().len(), "size": size, "fps": footage.fps(),
            "loops": footage.loops(), "measured_size": [footage.width(), footage.height()],
            "reference": fitted.reference.as_ref().map(|r| &r.0), "measures": rows,
        });
        let text = serde_json::to_string_pretty(&report);
        say!("{}", text.map_err(|e| Error::new(Kind::Data, "report", e.to_string()))?);
        Ok(())
    }
}

/// A scene without what measuring does not need.
pub(super) fn bare(file: SceneFile) -> SceneFile {
    // Only fluid alone is seen before its background here.
    let background = file.background.clone().filter(|_| file.output.alpha);
    SceneFile { library: Vec::new(), background, ..file }
}

/// A measure on one line, or where that is longer than `columns`, its definition on lines of its own below.
fn row((measure, value): &Value, columns: Option<usize>) -> Vec<String> {
    let shown = value.map_or("n/a".to_owned(), |v| format!("{v:.4}"));
    let missing = if value.is_none() { format!(" [needs: {}]", measure.needs) } else { String::new() };
    let head = format!("  {:27}{shown:>10}  {:15}{:8}", measure.name, measure.unit, measure.better.words());
    let tail = format!("{}{missing}", measure.definition);
    match columns.filter(|&columns| head.chars().count() + tail.chars().count() > columns) {
        None => vec![head + &tail],
        Some(columns) => {
            let below = wrapped(&tail, columns.saturating_sub(INDENT)).into_iter();
            [head.trim_end().to_owned()].into_iter().chain(below.map(|line| " ".repeat(INDENT) + &line)).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::ALL;

    #[test]
    fn long_rows_are_broken_at_the_terminal_s_width() {
        for measure in ALL {
            let whole = row(&(measure, None), None);
            assert_eq!(whole.len(), 1);
            for columns in [72, 80, 120] {
                let lines = row(&(measure, None), Some(columns));
                assert!(lines.iter().all(|line| line.chars().count() <= columns), "{columns}: {lines:?}");
                let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
                assert_eq!(words(&lines.join(" ")), words(&whole[0]));
            }
            assert_eq!(row(&(measure, None), Some(1000)), whole);
        }
    }
}
