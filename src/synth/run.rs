//! From a scene to its frames, with the method that it names.

use std::collections::{BTreeMap, BTreeSet};

use super::method::{MethodEntry, Outcome, Sources};
use super::methods::{DEFAULT_METHOD, DESIGNED_METHOD, REGISTRY};
use super::record::Timed;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::options::{Table, unknown};
use crate::base::text::counted;
use crate::library::names::Names;
use crate::scene::file::{self, SceneFile};
use crate::scene::scene::Scene;
use crate::video::clip::Sink;

/// The entry of a scene's method, after checking every option table of the scene; the scene gets its method's name and
/// every option value, defaults included, so that what it writes repeats the run.
///
/// # Errors
/// Unknown methods and tables (naming the nearest), unknown or bad options; a designed target for a method that takes
/// none; more exemplars than it takes.
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
