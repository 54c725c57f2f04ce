//! Exemplars are checked before any pixel is read: that files are there, and that what belongs together is of one size
//! and as many frames.

use std::path::Path;

use super::exemplar_file::{DARKNESS, ExemplarFile, LUMINANCE, Opacity};
use super::flow_files::FlowFiles;
use super::parameters::{Parameters, is_array};
use crate::base::error::{Error, Kind, Result};
use crate::base::text::counted;
use crate::raster::picture_io::picture_size;
use crate::video::clip::{Source, Turn};
use crate::video::read::source;

/// What a picture or a clip says of itself before it is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Width and height as it is seen, pixels.
    pub size: (usize, usize),
    /// Number of frames, where it says so.
    pub frames: Option<usize>,
    /// Whether it is a picture.
    pub still: bool,
}

impl Shape {
    /// The shape of a picture, a clip or a folder of pictures.
    ///
    /// # Errors
    /// What cannot be opened.
    pub fn of(path: &Path) -> Result<Self> {
        let Some(clip) = open_moving(path)? else {
            return Ok(Self { size: picture_size(path)?, frames: Some(1), still: true });
        };
        let info = clip.info();
        let size = match info.turn {
            Turn::None | Turn::Half => (info.width, info.height),
            Turn::Right | Turn::Left => (info.height, info.width),
        };
        Ok(Self { size, frames: info.frames, still: false })
    }

    /// The shape of a file that moves; none of a picture, a folder or an `.npy` file, whose frames are files or parts.
    ///
    /// # Errors
    /// What cannot be opened.
    pub fn of_moving(path: &Path) -> Result<Option<Self>> {
        if is_array(path) || path.is_dir() {
            return Ok(None);
        }
        Ok(Some(Self::of(path)?).filter(|shape| !shape.still))
    }
}

/// Opens a clip or a folder of pictures; none where the path names a picture.
///
/// # Errors
/// What cannot be opened.
pub fn open_moving(path: &Path) -> Result<Option<Box<dyn Source>>> {
    match source::open(path) {
        Ok(clip) => Ok(Some(clip)),
        // What does not move is no clip.
        Err(error) if error.kind() == Kind::Unusable && !path.is_dir() => Ok(None),
        Err(error) => Err(error),
    }
}

/// Checks the exemplars of a scene.
///
/// # Errors
/// No frames, a missing file, an exemplar that is named twice; opacity, flow or parameters of another size or of another
/// number of frames, as far as the files say it.
pub(super) fn check(exemplars: &[ExemplarFile]) -> Result<()> {
    for (exemplar, n) in exemplars.iter().zip(1..) {
        check_names(exemplar, Some(n).filter(|_| exemplars.len() > 1))?;
        exemplar.clone().paths().try_for_each(|path| exists(path))?;
        if exemplars[..n - 1].iter().any(|other| other.frames == exemplar.frames) {
            return Err(Error::file(Kind::Usage, &exemplar.frames, "is named as an exemplar twice")
                .remedy("name every exemplar once"));
        }
        check_companions(exemplar)?;
    }
    Ok(())
}

/// Refuses an exemplar without frames, and a word that stands for nothing. `n` is its number in a list, none where it is the
/// only one and may be named without a list.
fn check_names(exemplar: &ExemplarFile, n: Option<usize>) -> Result<()> {
    if exemplar.frames.as_os_str().is_empty() {
        return Err(match (&exemplar.opacity, n) {
            (Some(alpha), None) if exemplar.flow.is_none() && exemplar.parameters.is_none() => {
                let problem = format!("{} is given without an exemplar to go with it", alpha.path().display());
                Error::new(Kind::Usage, "exemplar_alpha", problem)
                    .remedy("name an exemplar too; the opacity of the picture's own fluid is its matte")
            }
            (_, n) => Error::new(Kind::Usage, format!("exemplars {}.frames", n.unwrap_or(1)), "is missing")
                .allowed("a picture, a clip, a folder of pictures or an .npy file"),
        });
    }
    match &exemplar.opacity {
        Some(Opacity::File(word)) if word.extension().is_none() && !word.exists() => {
            let name = n.map_or("exemplar_alpha".to_owned(), |n| format!("exemplars {n}.opacity"));
            let problem = format!("{} is no file and no known word", word.display());
            Err(Error::new(Kind::Usage, name, problem)
                .allowed(format!("{LUMINANCE:?}, {DARKNESS:?}, or a grey picture or clip")))
        }
        _ => Ok(()),
    }
}

fn exists(path: &Path) -> Result<()> {
    std::fs::metadata(path).map(|_| ()).map_err(|e| Error::io(path, "open", e))
}

/// Checks what is given frame by frame beside the frames.
fn check_companions(exemplar: &ExemplarFile) -> Result<()> {
    let opacity = match &exemplar.opacity {
        Some(Opacity::File(path)) => Some((path.as_path(), Shape::of(path)?)).filter(|(_, shape)| !shape.still),
        _ => None,
    };
    let (flow, parameters) = (&exemplar.flow, &exemplar.parameters);
    if opacity.is_none() && flow.is_none() && parameters.is_none() {
        return Ok(());
    }
    let whole = Shape::of(&exemplar.frames)?;
    if let Some((path, shape)) = opacity {
        same_size(path, shape.size, whole.size)?;
        check_count(path, shape.frames, whole.frames, false)?;
    }
    if let Some(folder) = flow {
        let flow = FlowFiles::open(folder)?;
        same_size(&flow.files.files[0], flow.size, whole.size)?;
        check_count(folder, Some(flow.files.frames()), whole.frames, true)?;
    }
    parameters.as_deref().map_or(Ok(()), |path| check_parameters(path, whole))
}

fn check_parameters(path: &Path, whole: Shape) -> Result<()> {
    if let Some(clip) = Shape::of_moving(path)? {
        same_size(path, clip.size, whole.size)?;
        return check_count(path, clip.frames, whole.frames, false);
    }
    let parameters = Parameters::of(path)?;
    parameters.sizes()?.into_iter().try_for_each(|(file, size)| same_size(file, size, whole.size))?;
    match parameters.frames()? {
        // One serves all.
        1 => Ok(()),
        frames => check_count(path, Some(frames), whole.frames, false),
    }
}

/// Refuses what has another size than its exemplar.
///
/// # Errors
/// Sizes that differ.
pub fn same_size(path: &Path, found: (usize, usize), size: (usize, usize)) -> Result<()> {
    if found == size {
        return Ok(());
    }
    let problem = format!("is {} × {} pixels, the exemplar {} × {}", found.0, found.1, size.0, size.1);
    Err(Error::file(Kind::Unusable, path, problem).remedy("make it the exemplar's size"))
}

/// Refuses another number of frames than the exemplar has, where both are known; `steps` may be one less.
///
/// # Errors
/// Numbers that differ.
pub fn check_count(path: &Path, found: Option<usize>, frames: Option<usize>, steps: bool) -> Result<()> {
    let (Some(found), Some(frames)) = (found, frames) else { return Ok(()) };
    if found == frames || (steps && found + 1 == frames) {
        return Ok(());
    }
    let allowed = if steps && frames > 1 { format!("{} or {frames}", frames - 1) } else { frames.to_string() };
    let counted = |n: usize| counted(n as u64, "frame");
    let problem = format!("has {}, the exemplar has {}", counted(found), counted(frames));
    Err(Error::file(Kind::Unusable, path, problem).allowed(allowed).remedy("give one for every frame of the exemplar"))
}
