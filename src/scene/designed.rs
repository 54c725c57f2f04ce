//! A designed target's folders, checked: motion, opacity and height, frame by frame (LazyFluids, Jamriška et al. 2015, §3).

use std::path::Path;

use super::file::{Output, SceneFile, TargetFile};
use super::sequence::Sequence;
use crate::base::error::{Error, Kind, Result};
use crate::flow::field::Field;
use crate::flow::rendered::{self, Joins};
use crate::raster::exr_file;
use crate::raster::image::Plane;
use crate::raster::picture_io::{picture_size, read_opacity};

/// Extensions of pictures of opacity and height.
const PICTURES: [&str; 2] = ["png", "exr"];

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
        let flow = Sequence::list(&target.flow, &rendered::EXTENSIONS)?;
        let alpha = Sequence::list(&target.alpha, &PICTURES)?;
        let height = target.height.as_deref().map(|folder| Sequence::list(folder, &PICTURES)).transpose()?;
        if flow.len() < 2 {
            return Err(Error::file(Kind::Usage, &flow.folder, "has only one frame").allowed("2 or more"));
        }
        let size = rendered::size(&flow.files[0])?;
        one_size(&flow, size, rendered::size)?;
        for grey in [Some(&alpha), height.as_ref()].into_iter().flatten() {
            same_numbers(&flow, grey)?;
            one_size(grey, size, opacity_size)?;
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
        let path = &self.flow.files[t];
        let here = rendered::read(path)?;
        within_picture(&here.field, path)?;
        if here.joins == Joins::Previous || t == 0 {
            return Ok(here.field);
        }
        // Where what was there in the frame before went.
        let path = &self.flow.files[t - 1];
        let before = rendered::read(path)?;
        within_picture(&before.field, path)?;
        Ok(before.field)
    }

    /// Opacity of frame `t` in [0, 1], at the target's own size.
    ///
    /// # Errors
    /// An unreadable file.
    pub fn alpha(&self, t: usize) -> Result<Plane> {
        let path = &self.alpha.files[t];
        if is_exr(path) { exr_alpha(path) } else { read_opacity(path) }
    }

    /// Where the fluid is in any frame: the greatest opacity, at the target's own size.
    ///
    /// # Errors
    /// An unreadable file.
    pub fn reach(&self) -> Result<Plane> {
        let mut reach = Plane::zeros(self.size.0, self.size.1);
        for t in 0..self.frames() {
            reach.data.iter_mut().zip(&self.alpha(t)?.data).for_each(|(most, a)| *most = most.max(*a));
        }
        Ok(reach)
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

fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"))
}

fn opacity_size(path: &Path) -> Result<(usize, usize)> {
    if is_exr(path) { exr_file::size(path) } else { picture_size(path) }
}

/// Opacity of an OpenEXR picture: the channel A of its only or its combined layer, else the only channel Y.
fn exr_alpha(path: &Path) -> Result<Plane> {
    let channels = exr_file::read(path, |name| name.ends_with('A') || name == "Y")?;
    let mut found = channels.groups(["A"]);
    if found.len() > 1 {
        found.retain(|(layer, _)| layer.is_empty() || layer.ends_with("Combined."));
    }
    found.extend(if found.is_empty() { channels.groups(["Y"]) } else { Vec::new() });
    let &[(_, [plane])] = &found[..] else {
        return Err(Error::file(Kind::Data, path, "has no opacity, or several")
            .allowed("one channel A, one of a Combined layer, or Y alone")
            .remedy("render with a transparent film, RGBA"));
    };
    if let Some(at) = plane.data.iter().position(|a| !a.is_finite()) {
        let place = format!("({}, {})", at % plane.width, at / plane.width);
        return Err(Error::file(Kind::Data, path, format!("the opacity at pixel {place} is not a number")));
    }
    // A renderer's filter overshoots by a little.
    Ok(plane.map(|a| a.clamp(0.0, 1.0)))
}

/// Refuses motion that nobody can mean: from beyond the picture.
fn within_picture(field: &Field, path: &Path) -> Result<()> {
    let (width, height) = (field.width() as f32, field.height() as f32);
    let vectors = field.u.data.iter().zip(&field.v.data);
    let Some(at) = vectors.into_iter().position(|(u, v)| u.abs() > width || v.abs() > height) else {
        return Ok(());
    };
    let (u, v) = (field.u.data[at], field.v.data[at]);
    let place = format!("({}, {})", at % field.width(), at / field.width());
    let problem = format!("the motion at pixel {place} is ({u}, {v}) pixels per frame, farther than the picture");
    Err(Error::file(Kind::Data, path, problem)
        .allowed(format!("up to {width} across and {height} down"))
        .remedy("write pixels per frame, and 0 where nothing moves"))
}
