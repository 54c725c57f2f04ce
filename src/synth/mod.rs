//! Methods that animate a scene, each behind one trait and one line of [`REGISTRY`].

pub mod advect;
pub mod assignment_picture;
pub mod base_flow;
pub mod chain;
pub mod channels;
pub mod database;
pub mod detail;
pub mod exemplar;
pub mod exemplar_files;
pub mod exemplar_video;
pub mod footage;
pub mod frames;
pub mod gate;
pub mod hybrid;
pub mod kwatra;
pub mod lazyfluids;
pub mod legend;
pub mod maps;
pub mod memory;
pub mod opacity;
pub mod outcome;
pub mod outline;
pub mod own;
pub mod pace;
pub mod patch_method;
pub mod pick;
pub mod placing;
pub mod rates;
pub mod record;
pub mod rendering;
pub mod shots;
pub mod speeds;
pub mod whole_pixels;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::options::{Declared, Table, unknown};
use crate::base::text::counted;
use crate::library::names::Names;
use crate::library::reader::Pack;
use crate::raster::image::Rgb8;
use crate::scene::file::{self, SceneFile};
use crate::scene::scene::Scene;
use crate::video::clip::Sink;
use record::{RunRecord, Timed};

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
    fn names(&self, observer: &dyn Observer) -> Vec<Names> {
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
    /// Makes it from an option table.
    pub build: fn(&Table) -> Result<Box<dyn Synthesizer>>,
}

/// All methods.
pub const REGISTRY: &[MethodEntry] = &[database::ENTRY, advect::ENTRY, hybrid::ENTRY, lazyfluids::ENTRY, kwatra::ENTRY];

/// The method of a picture when none is named.
pub const DEFAULT_METHOD: &str = "database";
/// The method of a designed target when none is named.
pub const DESIGNED_METHOD: &str = "lazyfluids";

/// The entry of a scene's method, after checking every option table of the scene; the scene gets its method's name and
/// every option value, defaults included, so that what it writes repeats the run.
///
/// # Errors
/// Unknown methods and tables (naming the nearest), unknown or bad options; a designed target for a method that takes
/// none, or more exemplars than it takes.
pub fn resolve(scene: &mut Scene) -> Result<&'static MethodEntry> {
    check_options(&scene.settings().options)?;
    let names: Vec<&str> = REGISTRY.iter().map(|m| m.name).collect();
    let usual = if scene.designed().is_some() { DESIGNED_METHOD } else { DEFAULT_METHOD };
    let name = scene.settings().method.clone().unwrap_or_else(|| usual.to_owned());
    let method = REGISTRY
        .iter()
        .find(|m| m.name == name)
        .ok_or_else(|| Error::new(Kind::Usage, "method", format!("no method {name:?}")).allowed(names.join(", ")))?;
    if scene.designed().is_some() && !method.designed {
        let takers: Vec<&str> = REGISTRY.iter().filter(|m| m.designed).map(|m| m.name).collect();
        let problem = format!("{name} animates a picture and takes no designed [target]");
        return Err(
            Error::new(Kind::Usage, "method", problem).allowed(format!("a method that does: {}", takers.join(", ")))
        );
    }
    let given = scene.settings().exemplars.len();
    if method.exemplars > 0 && given > method.exemplars {
        let takes = format!("{name} borrows from {}", counted(method.exemplars as u64, "exemplar"));
        return Err(Error::new(Kind::Usage, "exemplars", format!("{takes}, and {given} are named"))
            .remedy("name fewer, or another method"));
    }
    let table = (method.complete)(&scene.options(method.name))?;
    scene.set_options(method.name, table);
    Ok(method)
}

/// Checks the option tables of methods, by their names.
///
/// # Errors
/// Unknown tables (naming the nearest), unknown or bad options.
pub fn check_options(options: &BTreeMap<String, Table>) -> Result<()> {
    let tables: Vec<&str> = REGISTRY.iter().map(|m| m.name).chain(file::KEYS).collect();
    options.iter().try_for_each(|(name, table)| {
        let method = REGISTRY.iter().find(|m| m.name == name).ok_or_else(|| unknown("", name, &tables))?;
        (method.complete)(table).map(drop)
    })
}

/// Animates a scene with its method: opens its libraries, makes all frames and pushes them to `sink`, which the caller
/// made with [`Scene::frame_map`]`().output` as its size, and finishes. Call [`resolve`] first.
///
/// # Errors
/// Those of the method, the libraries and the sink; nothing is left half-written.
pub fn run(scene: &Scene, sink: &mut dyn Sink, observer: &dyn Observer) -> Result<Outcome> {
    let mut checked = scene.clone();
    let method = resolve(&mut checked)?;
    let synthesizer = (method.build)(&checked.options(method.name))?;
    let sources = Sources::open(&checked)?;
    let timed = Timed::new(observer);
    note_unused(method, scene.settings(), &timed);
    let names = sources.names(&timed);
    checked.leave_out(by_hash(&scene.settings().without, &names));
    let mut outcome = synthesizer.synthesize(&checked, &sources, sink, &timed)?;
    outcome.record.finish(&checked, &timed);
    outcome.record.name_clips(&names);
    Ok(outcome)
}

/// Says what the method makes no use of.
fn note_unused(method: &MethodEntry, file: &SceneFile, observer: &dyn Observer) {
    if !method.library && !file.library.is_empty() {
        observer.note(&format!("{} borrows from no library: the one that is named is not used", method.name));
    }
    for exemplar in file.exemplars.iter().filter(|_| method.exemplars == 0) {
        observer.note(&format!("{} takes no exemplar: {} is not used", method.name, exemplar.frames.display()));
    }
}

/// Clips that a person named, by their hashes, so that what is written down repeats the run without any names.
fn by_hash(clips: &[String], names: &[Names]) -> Vec<String> {
    let hashes = |clip: &String| {
        let found: BTreeSet<_> = names.iter().flat_map(|names| names.called(clip)).collect();
        if found.is_empty() { vec![clip.clone()] } else { found.iter().map(ToString::to_string).collect() }
    };
    clips.iter().flat_map(hashes).collect()
}
