//! What a method is: the trait behind which it animates a scene, and what its entry says of it.

use std::path::PathBuf;
use std::sync::Arc;

use ndarray::Array3;

use super::record::{RunRecord, Timed};
use crate::base::error::Result;
use crate::base::observe::Observer;
use crate::base::options::{Declared, Table};
use crate::library::names::Names;
use crate::library::reader::Pack;
use crate::raster::image::Rgb8;
use crate::scene::scene::Scene;
use crate::video::clip::Sink;

/// What a method borrows from.
#[derive(Clone, Default)]
pub struct Sources {
    /// Open libraries, in the scene's order, with their names for people.
    pub packs: Vec<(PathBuf, Arc<Pack>)>,
}

impl Sources {
    /// Opens the libraries of a scene.
    ///
    /// # Errors
    /// Those of [`Pack::open`].
    pub fn open(scene: &Scene) -> Result<Self> {
        let open = |path: &PathBuf| Ok((path.clone(), Pack::open(path)?));
        Ok(Self { packs: scene.settings().library.iter().map(open).collect::<Result<_>>()? })
    }

    /// The clips' names for people, library by library.
    pub fn names(&self, observer: &dyn Observer) -> Vec<Names> {
        self.packs.iter().map(|(path, pack)| Names::read(path, pack.clips(), observer)).collect()
    }
}

/// What a run gives besides its frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Everything that is known of the run, for `summary.json`.
    pub record: RunRecord,
    /// Pictures that explain it, by name without extension ("assignment", "speed", "orientation", "asked-speed"…).
    pub pictures: Vec<(&'static str, Rgb8)>,
    /// Arrays (y, x, component) of the working size for other programs, see [`super::maps::arrays`].
    pub arrays: Vec<(&'static str, Array3<f32>)>,
}

/// A method that animates a scene.
pub trait Synthesizer: Sync {
    /// Makes all frames of the scene and pushes them to `sink`, in order.
    ///
    /// # Errors
    /// Sources that do not serve, a sink that fails, a cancel.
    fn synthesize(&self, scene: &Scene, sources: &Sources, sink: &mut dyn Sink, observer: &Timed) -> Result<Outcome>;
}

/// One method.
pub struct MethodEntry {
    /// Name on command lines and in scene files.
    pub name: &'static str,
    /// What it does, in one line.
    pub summary: &'static str,
    /// Where it comes from.
    pub citation: &'static str,
    /// Whether it borrows from libraries.
    pub library: bool,
    /// How many exemplars it borrows from at most; 0: it takes none.
    pub exemplars: usize,
    /// Whether it takes a designed target ([`crate::scene::target`]) in place of a picture.
    pub designed: bool,
    /// Its options.
    pub options: fn() -> Vec<Declared>,
    /// All option values that a table stands for, defaults included.
    pub complete: fn(&Table) -> Result<Table>,
    /// Shrinks its options for a quick look; those that a person set stay.
    pub preview: fn(&mut Table),
    /// Makes it from an option table.
    pub build: fn(&Table) -> Result<Box<dyn Synthesizer>>,
}
