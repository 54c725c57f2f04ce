//! `enliven-db scenes`: from clips to scenes whose answer is known, each to be animated without its own clip.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;

use super::clip_strokes::along_motion;
use super::file::{Motion, SceneFile};
use super::left_out::LeftOut;
use super::scene::{SCENE_FILE, Scene};
use crate::base::atomic_file::{self, AtomicFolder};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::flow::strokes;
use crate::library::build::{Refused, build};
use crate::library::inputs;
use crate::library::options;
use crate::library::piece::ClipId;
use crate::library::reader::Pack;
use crate::library::scan::reason;
use crate::library::twins::{Changes, SAME};
use crate::raster::picture_io::{write_grey_png, write_png};
use crate::video::write::options::{FrameRate, SinkOptions};
use crate::video::write::sink;

/// Name of the stage; one step is a clip.
pub const SCENES: &str = "scenes";

/// A scene that was written.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Written {
    /// Its folder.
    pub scene: PathBuf,
    /// The clip it is of.
    pub clip: PathBuf,
    /// Start of the clip's identity.
    pub id: String,
    /// Width and height of the picture.
    pub size: (usize, usize),
    /// Frame of the clip that is the picture.
    pub frame: usize,
    /// First frame of the reference, and the one after its last.
    pub reference: (usize, usize),
    /// Share of the picture that is fluid, 0 to 1.
    pub fluid: f32,
    /// Clips of the libraries that the scene leaves out: itself and its twins.
    pub without: Vec<String>,
    /// The library's clip most like it of those that are used, and its distance (see [`crate::library::twins`]).
    pub nearest: Option<(String, f32)>,
}

/// What became of the clips.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Scenes, in the order of the clips.
    pub written: Vec<Written>,
    /// Clips without a scene, and why.
    pub refused: Vec<Refused>,
}

/// How scenes are made.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Options {
    /// Packs that the scenes borrow from.
    pub libraries: Vec<PathBuf>,
    /// Whether the scenes go without strokes.
    pub unasked: bool,
    /// Whether the strokes tell the clip's own speed.
    pub speeds: bool,
}

/// Writes into `folder` a scene for every clip of `clips` (files, or folders of them): `NAME/picture.png`, `matte.png`,
/// `reference/` (lossless frames), unless `options` says otherwise `strokes.json` along the clip's own motion, and
/// `scene.toml`, which animates with `libraries` less the clip and its twins. A clip that no library has is judged and
/// analysed as a build would.
///
/// # Errors
/// When no clip can serve, a scene of that name exists, a library is damaged, the disk fails, or after a cancel.
/// Scenes finished before stay; none is left unfinished.
pub fn scenes(clips: &[PathBuf], options: &Options, folder: &Path, observer: &dyn Observer) -> Result<Report> {
    let libraries = &options.libraries;
    let files = inputs::expand(clips)?;
    let names = names(&files);
    refuse_existing(folder, &names)?;
    let packs = libraries.iter().map(|path| Pack::open(path)).collect::<Result<Vec<_>>>()?;
    if packs.is_empty() {
        observer.note("no library given: the scenes name none, and nothing is left out; give them one with --library");
    }
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "make the folder", e))?;
    let mut found = find(&files, &packs, folder, observer)?;
    let changes = observe::stage(observer, "compare clips", 0, || Library::read(&packs, observer))?;
    let mut written = Vec::new();
    observe::stage(observer, SCENES, files.len() as u64, || {
        for ((path, name), place) in files.iter().zip(&names).zip(&found.places) {
            observe::check(observer)?;
            if let Some((pack, clip)) = place {
                let target = Target { path, folder: folder.join(name), options };
                match target.write(pack, *clip, &changes, observer) {
                    Err(error) if error.kind() == Kind::Unusable => {
                        found.refused.push(Refused { path: path.clone(), reason: reason(&error) });
                    }
                    scene => written.push(scene?),
                }
            }
            observer.advance(SCENES, 1);
        }
        Ok(())
    })?;
    if written.is_empty() {
        // Goes only when it is empty, and then it is ours.
        let _ = std::fs::remove_dir(folder);
        return Err(none(&found.refused));
    }
    Ok(Report { written, refused: found.refused })
}

fn none(refused: &[Refused]) -> Error {
    let why = |r: &Refused| format!("{}: {}", r.path.file_name().unwrap_or_default().to_string_lossy(), r.reason);
    let why = refused.iter().map(why).collect::<Vec<_>>().join("; ");
    Error::new(Kind::Unusable, "clips", format!("none of them can be made into a scene ({why})"))
        .remedy("film with a fixed camera, two seconds or more")
}

/// Names of the scenes: those of the files, numbered where they repeat.
fn names(files: &[PathBuf]) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let mut free = |path: &PathBuf| {
        let stem = if path.is_dir() { path.file_name() } else { path.file_stem() };
        let stem = stem.unwrap_or_default().to_string_lossy().into_owned();
        let numbered = (2..).map(|n| format!("{stem}-{n}"));
        let name = std::iter::once(stem.clone()).chain(numbered).find(|name| !taken.contains(name)).unwrap_or(stem);
        taken.insert(name.clone());
        name
    };
    files.iter().map(&mut free).collect()
}

fn refuse_existing(folder: &Path, names: &[String]) -> Result<()> {
    match names.iter().map(|name| folder.join(name)).find(|path| path.exists()) {
        Some(path) => Err(Error::file(Kind::Usage, &path, "exists already, and scenes are not written over")
            .remedy("remove it, or give another folder with -o")),
        None => Ok(()),
    }
}

/// Where the clips' frames are.
struct Found {
    /// Per file: the pack that has it, and its number there.
    places: Vec<Option<(Arc<Pack>, u32)>>,
    refused: Vec<Refused>,
}

/// Looks every clip up in the libraries, and analyses those that none has.
fn find(files: &[PathBuf], packs: &[Arc<Pack>], folder: &Path, observer: &dyn Observer) -> Result<Found> {
    let ids = files.iter().map(|path| inputs::identify(path)).collect::<Result<Vec<_>>>()?;
    let mut places: Vec<_> = ids.iter().map(|id| packs.iter().find_map(|pack| place(pack, id))).collect();
    let strangers = files.iter().zip(&places).filter(|(_, p)| p.is_none()).map(|(f, _)| f.clone());
    let strangers: Vec<PathBuf> = strangers.collect();
    if strangers.is_empty() {
        return Ok(Found { places, refused: Vec::new() });
    }
    let known = strangers.len() < files.len();
    let (own, refused) = match analyse(&strangers, packs, folder, observer) {
        // That none of these serves is no failure while others do.
        Err(error) if known && error.kind() == Kind::Unusable => {
            observer.note(&error.to_string());
            let refusal = |path: &PathBuf| Refused { path: path.clone(), reason: reason(&error) };
            return Ok(Found { places, refused: strangers.iter().map(refusal).collect() });
        }
        other => other?,
    };
    places.iter_mut().zip(&ids).filter(|(p, _)| p.is_none()).for_each(|(p, id)| *p = place(&own, id));
    Ok(Found { places, refused })
}

fn place(pack: &Arc<Pack>, id: &ClipId) -> Option<(Arc<Pack>, u32)> {
    pack.clips().iter().position(|c| c.id == *id).map(|clip| (pack.clone(), clip as u32))
}

/// A pack of the clips that no library has, made in `folder`; nothing of it is there any more once it is open.
fn analyse(
    clips: &[PathBuf],
    packs: &[Arc<Pack>],
    folder: &Path,
    observer: &dyn Observer,
) -> Result<(Arc<Pack>, Vec<Refused>)> {
    let temporary = Temporary::new(folder)?;
    let path = temporary.0.join("clips.pack");
    let working = packs.first().map_or(options::Options::default().working, |pack| pack.parameters().working);
    let options = options::Options { working, ..options::Options::default() };
    let report = build(clips, &path, &options, observer)?;
    Ok((Pack::open(&path)?, report.refused))
}

/// A hidden folder that goes when it is dropped, and the folder it is in if that is then empty.
struct Temporary(PathBuf);

impl Temporary {
    fn new(folder: &Path) -> Result<Self> {
        let path = folder.join(format!(".clips.{}", std::process::id()));
        std::fs::create_dir(&path).map_err(|e| Error::io(&path, "make the folder", e))?;
        Ok(Self(path))
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // Nobody is left to tell, and the folder is hidden and says whose it is.
        let _ = std::fs::remove_dir_all(&self.0);
        let _ = self.0.parent().map(std::fs::remove_dir);
    }
}

/// How all clips of the libraries move, to find twins by.
struct Library(Vec<(ClipId, Changes)>);

impl Library {
    fn read(packs: &[Arc<Pack>], observer: &dyn Observer) -> Result<Self> {
        let of = |pack: &Arc<Pack>| (0..pack.clips().len()).map(|i| (pack.clone(), i)).collect::<Vec<_>>();
        let all: Vec<(Arc<Pack>, usize)> = packs.iter().flat_map(of).collect();
        let read = |i: usize| {
            let (pack, clip): &(Arc<Pack>, usize) = &all[i];
            Ok((pack.clips()[*clip].id, Changes::of(pack, *clip as u32, observer)?))
        };
        Ok(Self(par::try_map(all.len(), read)?))
    }

    /// The clip itself and its twins, and of all others the nearest.
    fn split(&self, id: ClipId, changes: &Changes) -> (Vec<String>, Option<(String, f32)>) {
        let distances = par::map(self.0.len(), |i| {
            let (other, theirs) = &self.0[i];
            let distance = if *other == id { 0.0 } else { changes.distance(theirs).min(theirs.distance(changes)) };
            (other.to_string(), distance)
        });
        let (twins, others): (Vec<_>, Vec<_>) = distances.into_iter().partition(|d| d.1 < SAME);
        let twins: BTreeSet<String> = twins.into_iter().map(|t| t.0).collect();
        (twins.into_iter().collect(), others.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)))
    }
}

/// A scene to be written.
struct Target<'a> {
    path: &'a Path,
    folder: PathBuf,
    options: &'a Options,
}

impl Target<'_> {
    fn write(&self, pack: &Pack, clip: u32, library: &Library, observer: &dyn Observer) -> Result<Written> {
        let scene = LeftOut::of(pack, clip, observer)?;
        let id = pack.clips()[clip as usize].id;
        let (without, nearest) = library.split(id, &Changes::of(pack, clip, observer)?);
        if !self.options.libraries.is_empty() && nearest.is_none() {
            return Err(Error::file(Kind::Unusable, self.path, "the library holds no other clip to animate it with"));
        }
        let scenes = self.folder.parent().unwrap_or(Path::new(""));
        std::fs::create_dir_all(scenes).map_err(|e| Error::io(scenes, "make the folder", e))?;
        // Under its name when all of it is there: a folder of that name that somebody made meanwhile is not touched.
        let made = AtomicFolder::create(&self.folder, |_| false)?;
        let (picture, matte, reference) =
            (made.inside("picture.png"), made.inside("matte.png"), made.inside("reference"));
        write_png(&picture, &scene.picture)?;
        write_grey_png(&matte, &scene.matte)?;
        write_reference(&reference, pack, clip, &scene, observer)?;
        let drawn = if self.options.unasked {
            Vec::new()
        } else {
            along_motion(pack, clip, &scene.matte, self.options.speeds)?
        };
        let strokes = (!drawn.is_empty()).then(|| made.inside("strokes.json"));
        strokes.as_ref().map_or(Ok(()), |path| atomic_file::write(path, strokes::to_json(&drawn).as_bytes()))?;
        let file = SceneFile {
            picture,
            matte: Some(matte),
            library: self.options.libraries.clone(),
            without: without.clone(),
            reference: Some(reference),
            motion: Motion { strokes, ..Motion::default() },
            ..SceneFile::default()
        };
        let written = made.inside(SCENE_FILE);
        let inside = written.parent().unwrap_or(&self.folder);
        atomic_file::write(&written, Scene::new(file)?.to_toml(inside)?.as_bytes())?;
        made.commit()?;
        Ok(Written {
            scene: self.folder.clone(),
            clip: self.path.to_path_buf(),
            id: id.to_string(),
            size: (scene.picture.width, scene.picture.height),
            frame: scene.frame,
            reference: (scene.reference.start, scene.reference.end),
            fluid: scene.matte.data.iter().sum::<f32>() / scene.matte.data.len() as f32,
            without,
            nearest,
        })
    }
}

fn write_reference(path: &Path, pack: &Pack, clip: u32, scene: &LeftOut, observer: &dyn Observer) -> Result<()> {
    let (width, height) = (scene.picture.width, scene.picture.height);
    let rate = FrameRate::new(f64::from(pack.parameters().rate))?;
    let mut sink = sink::create(path, SinkOptions { width, height, rate, loops: false, alpha: false })?;
    let mut frames = pack.frames(clip)?;
    for t in scene.reference.clone() {
        observe::check(observer)?;
        sink.push(&frames.at(t)?)?;
    }
    sink.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_named_after_their_clips() {
        let files = ["a/x.mp4", "b/x.mov", "x-2.mp4", "y.avi"].map(PathBuf::from);
        assert_eq!(names(&files), ["x", "x-2", "x-2-2", "y"]);
    }
}
