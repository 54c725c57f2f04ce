//! A video on disk with everything there is to measure it with: its scene, the record of its run, a real clip.

use std::path::Path;
use std::rc::Rc;

use super::measured::Known;
use super::yardstick::{Fitted, Yardstick};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer, stage};
use crate::measure::footage::LONG_SIDE;
use crate::measure::read::{self, Video};
use crate::measure::{ALL, Footage, Subject, Value};
use crate::synth::record::RunRecord;

/// What is measured, and what is known of it.
#[derive(Clone, Copy)]
pub struct Request<'a> {
    /// A video or a folder of frames.
    pub video: &'a Path,
    /// The record of its run.
    pub record: Option<&'a RunRecord>,
    /// Whether it loops although no record says so.
    pub loops: bool,
    /// Its frames per second, where more is known than the file says.
    pub fps: Option<f32>,
}

impl<'a> Request<'a> {
    /// A video of which nothing else is known.
    pub fn new(video: &'a Path) -> Self {
        Self { video, record: None, loops: false, fps: None }
    }
}

/// Everything that was read.
pub struct Measuring {
    /// Width and height of the frames in the file.
    pub size: (usize, usize),
    /// The frames as they are measured.
    pub footage: Footage,
    /// The picture it was made from, and the real clip.
    pub fitted: Rc<Fitted>,
    known: Known,
}

impl Measuring {
    /// Reads the video and all it is measured with.
    ///
    /// # Errors
    /// A video or reference that cannot be read or does not fit; a cancel.
    pub fn read(request: &Request, yardstick: &Yardstick, observer: &dyn Observer) -> Result<Self> {
        let video = request.video(yardstick, observer)?;
        request.check_size(&video, yardstick)?;
        if yardstick.still().is_none() {
            observer.note("no scene is known: all of the video is measured; name one with --scene");
        }
        let (size, fps) = (video.size, request.rate(&video));
        let loops = request.loops || request.record.is_some_and(|record| record.scene.loops());
        let footage =
            Footage::new(video.frames, fps, loops, yardstick.matte()).map_err(|e| e.about(request.video.display()))?;
        Self::of(footage, size, request.record, yardstick, observer)
    }

    /// Frames in memory; those of their file would have `size`.
    ///
    /// # Errors
    /// A reference that cannot be read or does not fit; a cancel.
    pub fn of(
        footage: Footage,
        size: (usize, usize),
        record: Option<&RunRecord>,
        yardstick: &Yardstick,
        observer: &dyn Observer,
    ) -> Result<Self> {
        let (measured, fps) = ((footage.width(), footage.height()), footage.fps());
        let fitted = yardstick.fitted(measured, fps, observer)?;
        let known = Known::new(record, yardstick.asked(), measured, fps);
        let known = match yardstick.target() {
            Some((target, rate)) => known.with_target(target, rate / fps, measured)?,
            None => known,
        };
        Ok(Self { size, footage, fitted, known })
    }

    /// What the measures take.
    pub fn subject(&self) -> Subject<'_> {
        let Self { footage, fitted, known, .. } = self;
        Subject {
            picture: fitted.picture.as_ref(),
            reference: fitted.reference.as_ref().map(|r| &r.1),
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
    fn video(&self, yardstick: &Yardstick, observer: &dyn Observer) -> Result<Video> {
        let still = yardstick.still();
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

    /// Frames per second: as told or recorded, unless the file holds another number of frames (GIF, WebP and APNG leave some out
    /// at high rates) and times of its own.
    fn rate(&self, video: &Video) -> f32 {
        let output = self.record.map(|record| record.scene.output);
        let as_recorded = output.filter(|output| self.video.is_dir() || output.wanted().len() == video.frames.len());
        self.fps.or(as_recorded.map(|output| output.fps)).unwrap_or(video.fps)
    }

    /// MP4 holds even sizes only: its frames may be a pixel larger than the scene's.
    fn check_size(&self, video: &Video, yardstick: &Yardstick) -> Result<()> {
        let Some(still) = yardstick.still() else { return Ok(()) };
        let (found, asked) = (video.size, still.map.output);
        let fits = |found: usize, asked: usize| found == asked || found == asked.next_multiple_of(2);
        if fits(found.0, asked.0) && fits(found.1, asked.1) {
            return Ok(());
        }
        let problem = format!("its frames are {} × {} pixels, the scene's {} × {}", found.0, found.1, asked.0, asked.1);
        Err(Error::file(Kind::Unusable, self.video, problem)
            .remedy("name the scene that this video was made from, with its output size"))
    }
}
