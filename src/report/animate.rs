//! A scene to a video file, with the page that explains it.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::arrays::Arrays;
use super::beside::{SUMMARY, beside, free_beside, record_of};
use super::contact_sheet::spread;
use super::run::{FILES, SHEET_FRAMES, to_json, write as write_report};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::own_file::{self, Inputs};
use crate::library::names::Names;
use crate::raster::image::Rgb8;
use crate::raster::picture_io::write_own_png;
use crate::scene::file::SceneFile;
use crate::scene::scene::{self, SCENE_FILE, Scene, for_each_path};
use crate::synth::record::RunRecord;
use crate::synth::run::PreparedScene;
use crate::video::clip::Sink;
use crate::video::write::both::Both;
use crate::video::write::options::{FrameRate, SinkOptions};
use crate::video::write::sink;

/// Animates a scene to `output`; beside it the scene it ran (`.scene.toml`) and its summary (`.summary.json`), or under
/// another name (`.run.scene.toml`) where a person's files have these. With `report`, a folder, also the contact sheet and the pictures that explain the run.
///
/// # Errors
/// Bad input, by name; a full disk; an interruption. Nothing half-written stays.
pub fn animate(file: SceneFile, output: &Path, report: Option<&Path>, observer: &dyn Observer) -> Result<RunRecord> {
    Places { scene: Vec::new(), output, report, arrays: None, preview: false }.animate(file, observer)
}

/// Where a run writes, and where its settings come from.
pub struct Places<'a> {
    /// The files that tell the settings.
    pub scene: Vec<PathBuf>,
    /// The video.
    pub output: &'a Path,
    /// Folder for the page that explains the run.
    pub report: Option<&'a Path>,
    /// Folder for the run as arrays.
    pub arrays: Option<&'a Path>,
    /// Whether the first frame is written beside the output as soon as it is made (`.preview.png`).
    pub preview: bool,
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

impl Places<'_> {
    /// Animates a scene, see [`animate`].
    ///
    /// # Errors
    /// Those of [`animate`].
    pub fn animate(&self, file: SceneFile, observer: &dyn Observer) -> Result<RunRecord> {
        let &Places { output, report, preview, .. } = self;
        let mut prepared = PreparedScene::new(Scene::new(file)?)?;
        let scene = prepared.scene();
        let inputs = self.inputs(scene.settings());
        self.refuse_input(&inputs)?;
        self.refuse_shared_arrays()?;
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
        let arrays = self.arrays.map(Arrays::create).transpose()?;
        if let Some(arrays) = &arrays {
            inner = Box::new(Both(inner, sink::create(&arrays.frames(), options)?));
        }
        if let Some(folder) = report {
            std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "make the folder", e))?;
        }
        let wanted = if report.is_some() { spread(frames.len(), SHEET_FRAMES) } else { Vec::new() };
        let preview = (preview && !to_stdout).then(|| free_beside(output, "preview.png", &inputs, observer));
        let mut collector = Box::new(Collector { inner, wanted, next: 0, kept: Vec::new(), preview });
        let outcome = prepared.run(&mut *collector, observer)?;
        let frames = std::mem::take(&mut collector.kept);
        collector.finish()?;
        arrays.map_or(Ok(()), |arrays| arrays.finish(&outcome))?;
        if !to_stdout {
            let folder = output.parent().unwrap_or(Path::new(""));
            let write =
                |what, text: String| own_file::write(&free_beside(output, what, &inputs, observer), text.as_bytes());
            write(SCENE_FILE, prepared.scene().to_toml(folder)?)?;
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

    /// What the video is made from: the files of the settings, and all that they name.
    fn inputs(&self, file: &SceneFile) -> Inputs {
        let mut paths = self.scene.clone();
        for_each_path(&mut file.clone(), |path| paths.push(path.clone()));
        paths.extend(file.library.iter().map(|pack| Names::beside(pack)));
        Inputs::new(paths)
    }

    /// Refuses to write over what the video is made from, by the video or the report; and over files in the folder of the
    /// report that are not an earlier report's.
    /// Refuses arrays in the place of the video or of the page.
    fn refuse_shared_arrays(&self) -> Result<()> {
        let whole = |path: &Path| std::path::absolute(path).map(|path| path.components().collect::<PathBuf>()).ok();
        let Some(arrays) = self.arrays else { return Ok(()) };
        let shared = [Some(self.output), self.report].into_iter().flatten().any(|path| whole(path) == whole(arrays));
        if !shared {
            return Ok(());
        }
        Err(Error::file(Kind::Usage, arrays, "is named with --arrays, and for something else too")
            .allowed("a folder for the arrays alone")
            .remedy("name another folder with --arrays"))
    }

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
