//! What is known of every pixel besides its colour (heat, depth, age): values in [0, 1] that a person or a program made.

use std::path::{Path, PathBuf};

use crate::base::error::{Error, Kind, Result};
use crate::raster::image::Plane;
use crate::raster::npy;
use crate::raster::picture_io::{picture_size, read_grey};
use crate::video::read::folder;

/// Files of parameters; they are read when they are needed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Parameters {
    /// A grey picture for all frames.
    Still(PathBuf),
    /// A grey picture for every frame.
    Pictures(Vec<PathBuf>),
    /// An `.npy` file of any number of components, frame by frame or for all frames.
    Array(PathBuf),
}

impl Parameters {
    /// An `.npy` file, a folder of pictures or a picture, by what lies there.
    ///
    /// # Errors
    /// A folder that cannot be read, or has no pictures.
    pub fn of(path: &Path) -> Result<Self> {
        if is_array(path) {
            return Ok(Self::Array(path.to_owned()));
        }
        if !path.is_dir() {
            return Ok(Self::Still(path.to_owned()));
        }
        match folder::pictures(path)? {
            none if none.is_empty() => Err(Error::file(Kind::Usage, path, "has no pictures in it")
                .allowed("a grey PNG or JPEG picture a frame, or an .npy file instead of the folder")),
            pictures => Ok(Self::Pictures(pictures)),
        }
    }

    /// Number of frames; 1 serves all.
    ///
    /// # Errors
    /// An unreadable `.npy` file.
    pub fn frames(&self) -> Result<usize> {
        Ok(match self {
            Self::Still(_) => 1,
            Self::Pictures(files) => files.len(),
            Self::Array(path) => npy::Frames::open(path)?.shape()[0],
        })
    }

    /// The files with their sizes.
    ///
    /// # Errors
    /// An unreadable file.
    pub fn sizes(&self) -> Result<Vec<(&Path, (usize, usize))>> {
        let files = match self {
            Self::Array(path) => {
                let [_, height, width, _] = npy::Frames::open(path)?.shape();
                return Ok(vec![(path, (width, height))]);
            }
            Self::Still(path) => std::slice::from_ref(path),
            Self::Pictures(files) => files,
        };
        files.iter().map(|path| Ok((path.as_path(), picture_size(path)?))).collect()
    }

    /// The components at frame `t`, each in [0, 1].
    ///
    /// # Errors
    /// An unreadable file; what is not a number or outside [0, 1].
    pub fn at(&self, t: usize) -> Result<Vec<Plane>> {
        match self {
            Self::Still(path) => Ok(vec![read_grey(path)?]),
            Self::Pictures(files) => Ok(vec![read_grey(&files[if files.len() == 1 { 0 } else { t }])?]),
            Self::Array(path) => {
                let frames = npy::Frames::open(path)?;
                Ok(npy::planes(&frames.frame(if frames.shape()[0] == 1 { 0 } else { t })?))
            }
        }
    }
}

/// Whether a path names an `.npy` file.
pub fn is_array(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npy"))
}
