//! A designed target's folders, checked: motion, opacity and height, frame by frame (LazyFluids, Jamriška et al. 2015, §3).

use std::path::Path;

use super::file::{Output, SceneFile, TargetFile};
use super::flow_files::FlowFiles;
use super::parameters::{Parameters, is_array};
use super::sequence::{Sequence, has_size, one_size};
use crate::base::error::{Error, Kind, Result};
use crate::base::text::counted;
use crate::flow::field::Field;
use crate::raster::exr_file;
use crate::raster::image::Plane;
use crate::raster::picture_io::{picture_size, read_grey, read_opacity};

/// Extensions of pictures of opacity and height.
const PICTURES: [&str; 2] = ["png", "exr"];
/// Where a simulation says what white is in its pictures of height.
const SUMMARY: &str = "summary.json";

/// The folders of a designed target; their files are read when they are needed.
#[derive(Debug, Clone, PartialEq)]
pub struct Designed {
    flow: Option<FlowFiles>,
    alpha: Sequence,
    height: Option<Sequence>,
    /// Height at white, pixels.
    white: Option<f32>,
    parameters: Option<Parameters>,
    /// Width and height of every frame, pixels.
    pub size: (usize, usize),
}

/// Height of the surface in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Height {
    /// As the file has it: [0, 1] from black to white of a picture, any number of an OpenEXR one.
    pub plane: Plane,
    /// Pixels of the plane that are as long as a height of 1, where anybody said it.
    pub pixels: Option<f32>,
}

impl Designed {
    /// Lists the folders and reads the size of every frame.
    ///
    /// # Errors
    /// A picture, matte or motion beside the target; a folder that holds no sequence; folders with other numbers of
    /// frames; a frame of another size; parameters of another size or number of frames.
    pub fn open(scene: &SceneFile, target: &TargetFile) -> Result<Self> {
        stands_alone(scene, target)?;
        let flow = target.flow.as_deref().map(FlowFiles::open).transpose()?;
        let alpha = Sequence::list(&target.alpha, &PICTURES)?;
        let height = target.height.as_deref().map(|folder| Sequence::list(folder, &PICTURES)).transpose()?;
        let lead = flow.as_ref().map_or(&alpha, |flow| &flow.files);
        if lead.frames() < 2 {
            return Err(Error::file(Kind::Usage, &lead.folder, "has only one frame").allowed("2 or more"));
        }
        let size = flow.as_ref().map_or_else(|| opacity_size(&alpha.files[0]), |flow| Ok(flow.size))?;
        let what = if flow.is_some() { "the first frame of the flow" } else { "the first frame of alpha" };
        for grey in [Some(&alpha), height.as_ref()].into_iter().flatten() {
            same_numbers(lead, grey)?;
            one_size(grey, size, what, opacity_size)?;
        }
        let parameters = target.parameters.as_deref().map(|path| parameters(path, lead, size, what)).transpose()?;
        let white = target.height_white.or_else(|| white_of(target.height.as_deref()?));
        Ok(Self { flow, alpha, height, white, parameters, size })
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.alpha.frames()
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

    /// Whether it says how the fluid moves.
    pub fn has_flow(&self) -> bool {
        self.flow.is_some()
    }

    /// Motion from frame `t − 1` to frame `t`, in pixels of the target's own size.
    ///
    /// # Errors
    /// A target without flow; an unreadable file; a vector that is unknown, or longer than the picture.
    pub fn flow(&self, t: usize) -> Result<Field> {
        self.flow.as_ref().ok_or_else(|| self.no_flow())?.leading_to(t, self.frames())
    }

    /// Opacity of frame `t` in [0, 1], at the target's own size.
    ///
    /// # Errors
    /// An unreadable file.
    pub fn alpha(&self, t: usize) -> Result<Plane> {
        let path = &self.alpha.files[t];
        if is_exr(path) { exr_alpha(path) } else { read_opacity(path) }
    }

    /// Height of the surface in frame `t`, at the target's own size; none where there is none.
    ///
    /// # Errors
    /// An unreadable file; a height that is not a number.
    pub fn height(&self, t: usize) -> Result<Option<Height>> {
        let read = |path: &Path| if is_exr(path) { exr_height(path) } else { read_grey(path) };
        let plane = self.height.as_ref().map(|height| read(&height.files[t])).transpose()?;
        Ok(plane.map(|plane| Height { plane, pixels: self.white }))
    }

    /// What else is known of every pixel in frame `t`, components in [0, 1] at the target's own size; none where there
    /// is nothing.
    ///
    /// # Errors
    /// An unreadable file; what is not a number or outside [0, 1].
    pub fn parameters(&self, t: usize) -> Result<Option<Vec<Plane>>> {
        self.parameters.as_ref().map(|parameters| parameters.at(t)).transpose()
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

    /// The error of a target that does not say how its fluid moves.
    pub fn no_flow(&self) -> Error {
        Error::file(
            Kind::Usage,
            &self.alpha.folder,
            "the target has no flow: its opacity alone does not say how it moves",
        )
        .remedy("name a folder of motion as flow in [target], a file for every frame")
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
    if target.alpha.as_os_str().is_empty() {
        return Err(
            Error::new(Kind::Usage, "target.alpha", "is missing").allowed("a folder with a file for every frame")
        );
    }
    match target.height_white {
        Some(_) if target.height.is_none() => {
            refuse("target.height_white", "is given without a folder of heights", "name it as height, or leave it out")
        }
        Some(white) if !(white > 0.0 && white.is_finite()) => {
            Err(Error::new(Kind::Usage, "target.height_white", format!("{white} is out of range"))
                .allowed("above 0, pixels of the target"))
        }
        _ => Ok(()),
    }
}

/// The parameters of a target, one for every frame of `lead`.
fn parameters(path: &Path, lead: &Sequence, size: (usize, usize), what: &str) -> Result<Parameters> {
    let parameters = if is_array(path) {
        Parameters::of(path)?
    } else {
        let pictures = Sequence::list(path, &["png"])?;
        same_numbers(lead, &pictures)?;
        Parameters::Pictures(pictures.files)
    };
    let frames = parameters.frames()?;
    if frames != lead.frames() {
        let problem = format!("has {}, the target has {}", counted(frames as u64, "frame"), lead.frames());
        return Err(Error::file(Kind::Usage, path, problem)
            .allowed("an array (t, y, x, channel) with a frame for every one of the target"));
    }
    parameters.sizes()?.into_iter().try_for_each(|(file, found)| has_size(file, found, (size, what)))?;
    Ok(parameters)
}

/// Height at white in the pictures of a simulation, as its summary says; none of pictures from elsewhere.
fn white_of(height: &Path) -> Option<f32> {
    let text = std::fs::read(height.parent()?.join(SUMMARY)).ok()?;
    let summary: serde_json::Value = serde_json::from_slice(&text).ok()?;
    let white = summary.get("height_white")?.as_f64()? as f32;
    (white > 0.0 && white.is_finite()).then_some(white)
}

/// Refuses a sequence whose frames are numbered otherwise than those of the target.
fn same_numbers(lead: &Sequence, other: &Sequence) -> Result<()> {
    if (lead.first, lead.frames()) == (other.first, other.frames()) {
        return Ok(());
    }
    let range = |s: &Sequence| format!("{} to {}", s.first, s.first + s.frames() as u64 - 1);
    let problem = format!("has frames {}, but {} has {}", range(other), lead.folder.display(), range(lead));
    Err(Error::file(Kind::Usage, &other.folder, problem).remedy("give both folders the same frame numbers"))
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
    finite(plane, "opacity", path)?;
    // A renderer's filter overshoots by a little.
    Ok(plane.map(|a| a.clamp(0.0, 1.0)))
}

/// Height of an OpenEXR picture: its only channel Y, in any unit.
fn exr_height(path: &Path) -> Result<Plane> {
    let channels = exr_file::read(path, |name| name == "Y")?;
    let &[(_, [plane])] = &channels.groups(["Y"])[..] else {
        return Err(Error::file(Kind::Data, path, "has no height").allowed("one channel Y"));
    };
    finite(plane, "height", path)?;
    Ok(plane.clone())
}

fn finite(plane: &Plane, what: &str, path: &Path) -> Result<()> {
    let Some(at) = plane.data.iter().position(|v| !v.is_finite()) else { return Ok(()) };
    let place = format!("({}, {})", at % plane.width, at / plane.width);
    Err(Error::file(Kind::Data, path, format!("the {what} at pixel {place} is not a number")))
}
