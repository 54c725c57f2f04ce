//! Motion in a folder of numbered files, of a target or of an exemplar.

use std::path::Path;

use super::sequence::{Sequence, one_size};
use crate::base::error::{Error, Kind, Result};
use crate::flow::field::Field;
use crate::flow::rendered::{self, Joins};

/// The files of a folder, all of one size; they are read when they are needed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FlowFiles {
    /// The files.
    pub files: Sequence,
    /// Width and height of every one, pixels.
    pub size: (usize, usize),
}

impl FlowFiles {
    /// Lists the folder and reads the size of every file.
    ///
    /// # Errors
    /// Those of [`Sequence::list`]; files of several sizes.
    pub fn open(folder: &Path) -> Result<Self> {
        let files = Sequence::list(folder, &rendered::EXTENSIONS)?;
        let size = rendered::size(&files.files[0])?;
        one_size(&files, size, "the first frame of the flow", rendered::size)?;
        Ok(Self { files, size })
    }

    /// Motion that led from frame `t − 1` of `frames` to frame `t`, pixels; frame 0 has what it begins with. There is a
    /// file for every frame, or one less: for every step.
    ///
    /// # Errors
    /// An unreadable file; a vector that is unknown, or longer than the picture.
    pub fn leading_to(&self, t: usize, frames: usize) -> Result<Field> {
        let before = t.saturating_sub(1);
        if self.files.frames() < frames {
            return Ok(read(&self.files.files[before])?.field);
        }
        let here = read(&self.files.files[t])?;
        if here.joins == Joins::Previous || t == 0 {
            return Ok(here.field);
        }
        // Where what was there in the frame before went.
        Ok(read(&self.files.files[before])?.field)
    }
}

fn read(path: &Path) -> Result<rendered::Rendered> {
    let read = rendered::read(path)?;
    within_picture(&read.field, path)?;
    Ok(read)
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
