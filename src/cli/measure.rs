//! `enliven measure`: numbers for what a video looks like and how it moves.

use std::path::{Path, PathBuf};

use serde_json::json;

use super::animate::beside;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer, stage};
use crate::cli::common::{columns, counted, say, wrapped};
use crate::measure::footage::LONG_SIDE;
use crate::measure::read::{self, Video};
use crate::measure::{ALL, Footage, Subject, Value};
use crate::raster::image::Plane;
use crate::raster::picture_io::read_grey;
use crate::raster::resample::resize_rgb8;
use crate::report::measured::Known;
use crate::scene::designed::Designed;
use crate::scene::file::SceneFile;
use crate::scene::scene::{self, Scene, Still};
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

/// Everything there is to measure with.
struct Inputs {
    footage: Footage,
    picture: Option<Footage>,
    reference: Option<(PathBuf, Footage)>,
    known: Known,
}

impl Measure {
    /// Runs the command.
    ///
    /// # Errors
    /// A video, scene, record or reference that cannot be read or does not fit; a cancel.
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        self.check()?;
        let record = record_of(&self.video)?;
        let scene = self.scene_of(record.as_ref())?;
        let still = scene.as_ref().map(|scene| scene.still(observer)).transpose()?;
        let video = self.video(still.as_ref(), observer)?;
        let of_scene = scene.as_ref().zip(still.as_ref());
        let inputs = self.inputs(&video, record.as_ref(), of_scene, observer)?;
        let values = stage(observer, "measure", ALL.len() as u64, || measure(&inputs, observer))?;
        self.print(&video, &inputs, &values)
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
        let written = beside(&self.video, "scene.toml");
        let path = self.scene.clone().or_else(|| written.exists().then_some(written));
        let file = match path {
            Some(path) => Some(scene::open(&path)?),
            None => record.map(|record| record.scene.clone()),
        };
        let bare = |file: SceneFile| {
            // Only fluid alone is seen before its background here.
            let background = file.background.clone().filter(|_| file.output.alpha);
            SceneFile { library: Vec::new(), background, ..file }
        };
        file.map(|file| Scene::new(bare(file))).transpose()
    }

    /// The video; fluid alone is laid over what the scene has behind it.
    fn video(&self, still: Option<&Still>, observer: &dyn Observer) -> Result<Video> {
        let behind = still.map(|still| still.background.as_ref().unwrap_or(&still.picture));
        let video = stage(observer, "read video", 0, || read::video(&self.video, LONG_SIDE, behind, observer))?;
        if video.see_through {
            let behind = match still {
                Some(still) if still.background.is_some() => "the scene's background",
                Some(_) => "the scene's picture",
                None => "grey",
            };
            observer.note(&format!("{}: has opacity; it is measured over {behind}", self.video.display()));
        }
        Ok(video)
    }

    /// Frames per second: as recorded, unless the file holds another number of frames (GIF, WebP and APNG leave some out
    /// at high rates) and times of its own.
    fn rate(&self, video: &Video, record: Option<&RunRecord>) -> f32 {
        let output = record.map(|record| record.scene.output);
        let as_recorded = output.filter(|output| self.video.is_dir() || output.wanted().len() == video.frames.len());
        as_recorded.map_or(video.fps, |output| output.fps)
    }

    fn inputs(
        &self,
        video: &Video,
        record: Option<&RunRecord>,
        of_scene: Option<(&Scene, &Still)>,
        observer: &dyn Observer,
    ) -> Result<Inputs> {
        let (scene, still) = of_scene.unzip();
        still.map_or(Ok(()), |still| self.check_size(video, still))?;
        let reach = scene.and_then(Scene::designed).map(Designed::reach).transpose()?;
        let matte = reach.as_ref().or(still.map(|still| &still.matte));
        // What is behind a designed target does not look like its fluid.
        let pictured = still.filter(|_| reach.is_none());
        if still.is_none() {
            observer.note("no scene is known: all of the video is measured; name one with --scene");
        }
        let fps = self.rate(video, record);
        let loops = self.loops || record.is_some_and(|record| record.scene.loops());
        let footage =
            Footage::new(video.frames.clone(), fps, loops, matte).map_err(|e| e.about(self.video.display()))?;
        let size = (footage.width(), footage.height());
        let picture = pictured.map(|still| Footage::still(resize_rgb8(&still.picture, size.0, size.1), matte));
        let given = || scene.and_then(|scene| scene.settings().reference.clone());
        let reference = self.reference.clone().or_else(given);
        let reference = reference.map(|path| self.reference(path, &footage, matte, observer)).transpose()?;
        let asked = of_scene.and_then(|(scene, still)| Some((still.asked.as_ref()?, scene.settings().output.fps)));
        let known = Known::new(record, asked, size, fps);
        let target = scene.and_then(|scene| Some((scene.designed()?, scene.settings().output.fps)));
        let known = target.map_or(Ok(known.clone()), |(target, rate)| known.with_target(target, rate / fps, size))?;
        Ok(Inputs { footage, picture: picture.transpose()?, reference, known })
    }

    /// MP4 holds even sizes only: its frames may be a pixel larger than the scene's.
    fn check_size(&self, video: &Video, still: &Still) -> Result<()> {
        let (found, asked) = (video.size, still.map.output);
        let fits = |found: usize, asked: usize| found == asked || found == asked.next_multiple_of(2);
        if fits(found.0, asked.0) && fits(found.1, asked.1) {
            return Ok(());
        }
        let problem = format!("its frames are {} × {} pixels, the scene's {} × {}", found.0, found.1, asked.0, asked.1);
        Err(Error::file(Kind::Unusable, &self.video, problem)
            .remedy("name the scene that this video was made from, with its output size"))
    }

    fn reference(
        &self,
        path: PathBuf,
        footage: &Footage,
        matte: Option<&Plane>,
        observer: &dyn Observer,
    ) -> Result<(PathBuf, Footage)> {
        let frames = stage(observer, "read reference", 0, || {
            read::reference(&path, footage.fps(), self.reference_size, observer)
        })?;
        let same = frames.first().is_some_and(|f| (f.width, f.height) == (footage.width(), footage.height()));
        let own = self.reference_matte.as_deref().map(read_grey).transpose()?;
        if own.is_none() && matte.is_some() {
            let where_from = if same { "the scene's matte" } else { "all of it counts" };
            observer.note(&format!("{}: no matte of its own: {where_from}", path.display()));
        }
        let matte = own.as_ref().or_else(|| matte.filter(|_| same));
        let footage = Footage::new(frames, footage.fps(), false, matte).map_err(|error| {
            let subject = self.reference_matte.as_deref().unwrap_or(&path);
            error.about(subject.display())
        })?;
        Ok((path, footage))
    }

    fn print(&self, video: &Video, inputs: &Inputs, values: &[Value]) -> Result<()> {
        let Inputs { footage, reference, .. } = inputs;
        if !self.json {
            say!(
                "{}: {} of {} × {} at {} per second, measured at {} × {}",
                self.video.display(),
                counted(video.frames.len() as u64, "frame"),
                video.size.0,
                video.size.1,
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
            "video": self.video, "frames": video.frames.len(), "size": video.size, "fps": footage.fps(),
            "loops": footage.loops(), "measured_size": [footage.width(), footage.height()],
            "reference": reference.as_ref().map(|r| &r.0), "measures": rows,
        });
        let text = serde_json::to_string_pretty(&report);
        say!("{}", text.map_err(|e| Error::new(Kind::Data, "report", e.to_string()))?);
        Ok(())
    }
}

/// The record written beside a video, when there is one.
fn record_of(video: &Path) -> Result<Option<RunRecord>> {
    let path = beside(video, "summary.json");
    if !path.exists() {
        return Ok(None);
    }
    let text = std::fs::read_to_string(&path).map_err(|e| Error::io(&path, "read", e))?;
    let record = serde_json::from_str(&text).map_err(|e| {
        Error::file(Kind::Data, &path, format!("cannot be read as the summary of a run: {e}"))
            .remedy("make the video again, or move this file away to measure without it")
    })?;
    Ok(Some(record))
}

fn measure(inputs: &Inputs, observer: &dyn Observer) -> Result<Vec<Value>> {
    let Inputs { footage, picture, reference, known } = inputs;
    let subject = Subject {
        picture: picture.as_ref(),
        reference: reference.as_ref().map(|r| &r.1),
        asked: known.asked.as_ref(),
        asked_speed: known.asked_speed.as_ref(),
        nodes: &known.nodes,
        usage: known.usage.as_ref(),
        ..Subject::new(footage)
    };
    let one = |measure: &'static crate::measure::Measure| -> Result<Value> {
        observe::check(observer)?;
        let value = (measure, (measure.compute)(&subject));
        observer.advance("measure", 1);
        Ok(value)
    };
    ALL.iter().map(one).collect()
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
