//! From a scene to its frames, with the method that it names.

use std::collections::{BTreeMap, BTreeSet};

use super::default_method::DefaultMethod;
use super::method::{MethodEntry, Outcome, Sources};
use super::methods::REGISTRY;
use super::record::Timed;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::options::{Table, nearest, unknown};
use crate::base::text::counted;
use crate::library::names::Names;
use crate::scene::file::{self, SceneFile};
use crate::scene::scene::Scene;
use crate::video::clip::Sink;

/// A scene of which the method is known and every option has its value, so that what it writes repeats the run.
pub struct PreparedScene {
    scene: Scene,
    method: &'static MethodEntry,
    /// Why this method, where the scene names none.
    chosen: Option<DefaultMethod>,
}

impl PreparedScene {
    /// Checks every option table of the scene, and gives it its method's name and every option value, defaults included.
    ///
    /// # Errors
    /// Unknown methods and tables (naming the nearest), unknown or bad options; a designed target for a method that takes
    /// none; more exemplars than it takes.
    pub fn new(mut scene: Scene) -> Result<Self> {
        check_options(&scene.settings().options)?;
        let (name, chosen) = method_of(scene.settings());
        let method = entry(&name).ok_or_else(|| unknown_method("method", &name))?;
        if scene.designed().is_some() && !method.designed {
            let takers: Vec<&str> = REGISTRY.iter().filter(|m| m.designed).map(|m| m.name).collect();
            let problem = format!("{name} animates a picture and takes no designed [target]");
            return Err(Error::new(Kind::Usage, "method", problem)
                .allowed(format!("a method that does: {}", takers.join(", "))));
        }
        let given = scene.settings().exemplars.len();
        if method.exemplars > 0 && given > method.exemplars {
            let takes = format!("{name} borrows from {}", counted(method.exemplars as u64, "exemplar"));
            return Err(Error::new(Kind::Usage, "exemplars", format!("{takes}, and {given} are named"))
                .remedy("name fewer, or another method"));
        }
        let table = (method.complete)(&scene.options(method.name))?;
        scene.set_options(method.name, table);
        Ok(Self { scene, method, chosen })
    }

    /// The scene as it is run.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The same, to be taken.
    pub fn into_scene(self) -> Scene {
        self.scene
    }

    /// Animates it with its method: opens its libraries, makes all frames and pushes them to `sink`, which the caller made
    /// with [`Scene::frame_map`]`().output` as its size, and finishes.
    ///
    /// # Errors
    /// Those of the method, the libraries and the sink; nothing is left half-written.
    pub fn run(&mut self, sink: &mut dyn Sink, observer: &dyn Observer) -> Result<Outcome> {
        let Self { scene, method, chosen } = self;
        let synthesizer = (method.build)(&scene.options(method.name))?;
        let sources = Sources::open(scene)?;
        let timed = Timed::new(observer);
        chosen.iter().for_each(|chosen| timed.note(&chosen.note()));
        note_unused(method, scene.settings(), &timed);
        let names = sources.names(&timed);
        scene.leave_out(by_hash(&scene.settings().without, &names));
        let mut outcome = synthesizer.synthesize(scene, &sources, sink, &timed)?;
        outcome.record.finish(scene, &timed);
        outcome.record.name_clips(&names);
        Ok(outcome)
    }
}

/// Animates a scene with the method that it names, see [`PreparedScene`].
///
/// # Errors
/// Those of [`PreparedScene::new`] and [`PreparedScene::run`].
pub fn run(scene: &Scene, sink: &mut dyn Sink, observer: &dyn Observer) -> Result<Outcome> {
    PreparedScene::new(scene.clone())?.run(sink, observer)
}

/// Name of a scene's method: the one that is asked for, or else the one that was chosen for it.
fn method_of(file: &SceneFile) -> (String, Option<DefaultMethod>) {
    let chosen = file.method.is_none().then(|| DefaultMethod::of(file));
    let name = file.method.as_deref().or(chosen.as_ref().map(|chosen| chosen.name));
    (name.unwrap_or_default().to_owned(), chosen)
}

fn entry(name: &str) -> Option<&'static MethodEntry> {
    REGISTRY.iter().find(|method| method.name == name)
}

/// Shrinks the options of a scene's method for a quick look; those that a person set stay.
pub fn shrink_options(file: &mut SceneFile) {
    let (name, _) = method_of(file);
    let Some(method) = entry(&name) else { return };
    let mut table = file.options.remove(&name).unwrap_or_default();
    (method.preview)(&mut table);
    if !table.is_empty() {
        file.options.insert(name, table);
    }
}

/// Checks the option tables of methods, by their names.
///
/// # Errors
/// Unknown tables (naming the nearest), unknown or bad options.
pub fn check_options(options: &BTreeMap<String, Table>) -> Result<()> {
    let tables: Vec<&str> = REGISTRY.iter().map(|m| m.name).chain(file::KEYS).collect();
    options.iter().try_for_each(|(name, table)| {
        let method = entry(name).ok_or_else(|| unknown("", name, &tables))?;
        (method.complete)(table).map(drop)
    })
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

/// Refuses names that no method has; `asker` is what they were given to.
///
/// # Errors
/// The first of them, with the nearest that there is.
pub fn check_names(asker: &str, names: &[String]) -> Result<()> {
    names.iter().find(|name| entry(name).is_none()).map_or(Ok(()), |name| Err(unknown_method(asker, name)))
}

fn unknown_method(asker: &str, name: &str) -> Error {
    let known: Vec<&str> = REGISTRY.iter().map(|method| method.name).collect();
    let error = Error::new(Kind::Usage, asker, format!("no method {name:?}")).allowed(known.join(", "));
    match nearest(name, &known) {
        Some(meant) => error.remedy(format!("did you mean {meant:?}?")),
        None => error,
    }
}
