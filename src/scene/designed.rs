//! A designed target's folders, checked: motion, opacity and height, frame by frame (LazyFluids, Jamriška et al. 2015, §3).

use std::path::Path;

use super::file::{Output, SceneFile, TargetFile};
use super::sequence::Sequence;
use crate::base::error::{Error, Kind, Result};
use crate::flow::field::Field;
use crate::flow::io;
use crate::raster::image::Plane;
use crate::raster::picture_io::{picture_size, read_grey};

/// The folders of a designed target; their files are read when they are needed.
#[derive(Debug, Clone, PartialEq)]
pub struct Designed {
    flow: Sequence,
    alpha: Sequence,
    /// Width and height of every frame, pixels.
    pub size: (usize, usize),
}

impl Designed {
    /// Lists the folders and reads the size of every frame.
    ///
    /// # Errors
    /// A picture, matte or motion beside the target; a folder that holds no sequence; folders with other numbers of
    /// frames; a frame of another size.
    pub fn open(scene: &SceneFile, target: &TargetFile) -> Result<Self> {
        stands_alone(scene, target)?;
        let flow = Sequence::list(&target.flow, &["flo"])?;
        let alpha = Sequence::list(&target.alpha, &["png"])?;
        let height = target.height.as_deref().map(|folder| Sequence::list(folder, &["png"])).transpose()?;
        let size = io::size(&flow.files[0])?;
        one_size(&flow, size, io::size)?;
        for grey in [Some(&alpha), height.as_ref()].into_iter().flatten() {
            same_numbers(&flow, grey)?;
            one_size(grey, size, picture_size)?;
        }
        Ok(Self { flow, alpha, size })
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.flow.len()
    }

    /// Number of frames that a scene's output has: all, or as many of the first as are asked for.
    ///
    /// # Errors
    /// More than there are.
    pub fn length(&self, output: &Output) -> Result<usize> {
        let there = self.frames();
        match output.frames {
            Some(asked) if asked > there => {
                let problem = format!("{asked} are more than the target has");
                Err(Error::new(Kind::Usage, "output.frames", problem)
                    .allowed(format!("2 to {there}"))
                    .remedy(format!("leave it out to make all {there}")))
            }
            asked => Ok(asked.unwrap_or(there)),
        }
    }

    /// Motion from frame `t − 1` to frame `t`, in pixels of the target's own size.
    ///
    /// # Errors
    /// An unreadable file; a vector that is unknown, or longer than the picture.
    pub fn flow(&self, t: usize) -> Result<Field> {
        // A file holds where what is there goes until the next frame; into the first frame nothing leads.
        let path = &self.flow.files[t.saturating_sub(1)];
        let field = io::read(path)?;
        within_picture(&field, path)?;
        Ok(field)
    }

    /// Opacity of frame `t` in [0, 1], at the target's own size.
    ///
    /// # Errors
    /// An unreadable file.
    pub fn alpha(&self, t: usize) -> Result<Plane> {
        read_grey(&self.alpha.files[t])
    }

    /// The error of a target that shows nothing.
    pub fn no_alpha(&self) -> Error {
        Error::file(Kind::Usage, &self.alpha.folder, "is all black in every frame: there is nothing to show")
            .remedy("paint white where the fluid is")
    }
}

/// Refuses what a target brings by itself.
fn stands_alone(scene: &SceneFile, target: &TargetFile) -> Result<()> {
    let refuse = |key: &str, problem: &str, remedy: &str| {
        Err(Error::new(Kind::Usage, key, problem).allowed("a picture or a [target], not both").remedy(remedy))
    };
    let motion = &scene.motion;
    let asked = motion.direction.is_some() || motion.strokes.is_some() || motion.orientation.is_some();
    if !scene.picture.as_os_str().is_empty() {
        let remedy =
            "name it as background if it is behind the fluid, or as exemplar if it is what the fluid looks like";
        return refuse("picture", "is named beside a [target]", remedy);
    }
    if scene.matte.is_some() {
        return refuse("matte", "is named beside a [target], whose alpha says where the fluid is", "leave it out");
    }
    if asked || motion.speed.is_some() {
        return refuse("motion", "is asked for beside a [target], whose flow is the motion", "leave it out");
    }
    for (key, folder) in [("target.flow", &target.flow), ("target.alpha", &target.alpha)] {
        if folder.as_os_str().is_empty() {
            return Err(Error::new(Kind::Usage, key, "is missing").allowed("a folder with a file for every frame"));
        }
    }
    Ok(())
}

/// Refuses a sequence whose frames are numbered otherwise than those of the flow.
fn same_numbers(flow: &Sequence, other: &Sequence) -> Result<()> {
    if (flow.first, flow.len()) == (other.first, other.len()) {
        return Ok(());
    }
    let range = |s: &Sequence| format!("{} to {}", s.first, s.first + s.len() as u64 - 1);
    let problem = format!("has frames {}, but {} has {}", range(other), flow.folder.display(), range(flow));
    Err(Error::file(Kind::Usage, &other.folder, problem).remedy("give both folders the same frame numbers"))
}

/// Refuses a frame that is not of the target's size.
fn one_size(frames: &Sequence, size: (usize, usize), of: impl Fn(&Path) -> Result<(usize, usize)>) -> Result<()> {
    for path in &frames.files {
        let (width, height) = of(path)?;
        if (width, height) != size {
            let problem = format!("is {width} × {height} pixels");
            return Err(Error::file(Kind::Usage, path, problem)
                .allowed(format!("{} × {}, the size of the first frame of the flow", size.0, size.1))
                .remedy("bring all frames to one size"));
        }
    }
    Ok(())
}

/// Refuses motion that nobody can mean: unknown, or from beyond the picture.
fn within_picture(field: &Field, path: &Path) -> Result<()> {
    let (width, height) = (field.width() as f32, field.height() as f32);
    let vectors = field.u.data.iter().zip(&field.v.data);
    let Some(at) = vectors.into_iter().position(|(u, v)| !(u.abs() <= width && v.abs() <= height)) else {
        return Ok(());
    };
    let (u, v) = (field.u.data[at], field.v.data[at]);
    let place = format!("({}, {})", at % field.width(), at / field.width());
    let problem = format!("the motion at pixel {place} is ({u}, {v}) pixels per frame, farther than the picture");
    Err(Error::file(Kind::Data, path, problem)
        .allowed(format!("up to {width} across and {height} down; every pixel known"))
        .remedy("write 0 where nothing moves, and pixels per frame, not shares of the picture or seconds"))
}
