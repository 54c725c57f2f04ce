//! A video on disk with everything there is to measure it with: its scene, the record of its run, a real clip.

use std::path::{Path, PathBuf};

use super::measured::Known;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer, stage};
use crate::measure::footage::LONG_SIDE;
use crate::measure::read::{self, Video};
use crate::measure::{ALL, Footage, Subject, Value};
use crate::raster::image::Plane;
use crate::raster::picture_io::read_grey;
use crate::raster::resample::resize_rgb8;
use crate::scene::designed::Designed;
use crate::scene::scene::{Scene, Still};
use crate::synth::record::RunRecord;

/// What is measured, and what is known of it.
#[derive(Clone, Copy)]
pub struct Request<'a> {
    /// A video or a folder of frames.
    pub video: &'a Path,
    /// The scene it was made from.
    pub scene: Option<&'a Scene>,
    /// The record of its run.
    pub record: Option<&'a RunRecord>,
    /// Whether it loops although no record says so.
    pub loops: bool,
    /// A real clip that it should move like; none: the scene's.
    pub reference: Option<&'a Path>,
    /// Grey picture of the reference's shape, white where its fluid is.
    pub reference_matte: Option<&'a Path>,
    /// Long side in pixels that the reference is measured at.
    pub reference_size: usize,
}

impl<'a> Request<'a> {
    /// A video of which nothing else is known.
    pub fn new(video: &'a Path) -> Self {
        Self {
            video,
            scene: None,
            record: None,
            loops: false,
            reference: None,
            reference_matte: None,
            reference_size: LONG_SIDE,
        }
    }
}

/// Everything that was read.
pub struct Measuring {
    /// The video.
    pub video: Video,
    /// Its frames as they are measured.
    pub footage: Footage,
    /// The picture it was made from.
    pub picture: Option<Footage>,
    /// The real clip.
    pub reference: Option<(PathBuf, Footage)>,
    known: Known,
}

impl Measuring {
    /// Reads the video and all it is measured with.
    ///
    /// # Errors
    /// A video, scene or reference that cannot be read or does not fit; a cancel.
    pub fn read(request: &Request, observer: &dyn Observer) -> Result<Self> {
        let still = request.scene.map(|scene| scene.still(observer)).transpose()?;
        let video = request.video(still.as_ref(), observer)?;
        still.as_ref().map_or(Ok(()), |still| request.check_size(&video, still))?;
        let reach = request.scene.and_then(Scene::designed).map(Designed::reach).transpose()?;
        let matte = reach.as_ref().or(still.as_ref().map(|still| &still.matte));
        // What is behind a designed target does not look like its fluid.
        let pictured = still.as_ref().filter(|_| reach.is_none());
        if still.is_none() {
            observer.note("no scene is known: all of the video is measured; name one with --scene");
        }
        let fps = request.rate(&video);
        let loops = request.loops || request.record.is_some_and(|record| record.scene.loops());
        let footage =
            Footage::new(video.frames.clone(), fps, loops, matte).map_err(|e| e.about(request.video.display()))?;
        let size = (footage.width(), footage.height());
        let picture = pictured.map(|still| Footage::still(resize_rgb8(&still.picture, size.0, size.1), matte));
        let reference = request.reference(&footage, matte, observer)?;
        let asked = request
            .scene
            .zip(still.as_ref())
            .and_then(|(scene, still)| Some((still.asked.as_ref()?, scene.settings().output.fps)));
        let known = Known::new(request.record, asked, size, fps);
        let target = request.scene.and_then(|scene| Some((scene.designed()?, scene.settings().output.fps)));
        let known = target.map_or(Ok(known.clone()), |(target, rate)| known.with_target(target, rate / fps, size))?;
        Ok(Self { video, footage, picture: picture.transpose()?, reference, known })
    }

    /// What the measures take.
    pub fn subject(&self) -> Subject<'_> {
        let Self { footage, picture, reference, known, .. } = self;
        Subject {
            picture: picture.as_ref(),
            reference: reference.as_ref().map(|r| &r.1),
            asked: known.asked.as_ref(),
            asked_speed: known.asked_speed.as_ref(),
            nodes: &known.nodes,
            usage: known.usage.as_ref(),
            ..Subject::new(footage)
        }
    }

    /// Every measure.
    ///
    /// # Errors
    /// A cancel.
    pub fn values(&self, observer: &dyn Observer) -> Result<Vec<Value>> {
        let subject = self.subject();
        stage(observer, "measure", ALL.len() as u64, || {
            let one = |measure: &'static crate::measure::Measure| -> Result<Value> {
                observe::check(observer)?;
                let value = (measure, (measure.compute)(&subject));
                observer.advance("measure", 1);
                Ok(value)
            };
            ALL.iter().map(one).collect()
        })
    }
}

impl Request<'_> {
    /// The video; fluid alone is laid over what the scene has behind it.
    fn video(&self, still: Option<&Still>, observer: &dyn Observer) -> Result<Video> {
        let behind = still.map(|still| still.background.as_ref().unwrap_or(&still.picture));
        let video = stage(observer, "read video", 0, || read::video(self.video, LONG_SIDE, behind, observer))?;
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
    fn rate(&self, video: &Video) -> f32 {
        let output = self.record.map(|record| record.scene.output);
        let as_recorded = output.filter(|output| self.video.is_dir() || output.wanted().len() == video.frames.len());
        as_recorded.map_or(video.fps, |output| output.fps)
    }

    /// MP4 holds even sizes only: its frames may be a pixel larger than the scene's.
    fn check_size(&self, video: &Video, still: &Still) -> Result<()> {
        let (found, asked) = (video.size, still.map.output);
        let fits = |found: usize, asked: usize| found == asked || found == asked.next_multiple_of(2);
        if fits(found.0, asked.0) && fits(found.1, asked.1) {
            return Ok(());
        }
        let problem = format!("its frames are {} × {} pixels, the scene's {} × {}", found.0, found.1, asked.0, asked.1);
        Err(Error::file(Kind::Unusable, self.video, problem)
            .remedy("name the scene that this video was made from, with its output size"))
    }

    fn reference(
        &self,
        footage: &Footage,
        matte: Option<&Plane>,
        observer: &dyn Observer,
    ) -> Result<Option<(PathBuf, Footage)>> {
        let given = || self.scene.and_then(|scene| scene.settings().reference.clone());
        let Some(path) = self.reference.map(Path::to_owned).or_else(given) else { return Ok(None) };
        let frames = stage(observer, "read reference", 0, || {
            read::reference(&path, footage.fps(), self.reference_size, observer)
        })?;
        let same = frames.first().is_some_and(|f| (f.width, f.height) == (footage.width(), footage.height()));
        let own = self.reference_matte.map(read_grey).transpose()?;
        if own.is_none() && matte.is_some() {
            let where_from = if same { "the scene's matte" } else { "all of it counts" };
            observer.note(&format!("{}: no matte of its own: {where_from}", path.display()));
        }
        let matte = own.as_ref().or_else(|| matte.filter(|_| same));
        let footage = Footage::new(frames, footage.fps(), false, matte).map_err(|error| {
            let subject = self.reference_matte.unwrap_or(&path);
            error.about(subject.display())
        })?;
        Ok(Some((path, footage)))
    }
}
