//! Which video is which: the one file that those who vote must not see.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::base::atomic_file::{self, AtomicFile};
use crate::base::error::{Error, Kind, Result};
use crate::report::comparison::{Comparison, Row, SceneRows, Sort};
use crate::video::read::source::content_hash;

/// Folder of the videos without names.
pub const FOLDER: &str = "blind";
/// The page that shows them.
pub const PAGE: &str = "blind.html";
/// The key's file. It lies beside the folder, not in it: page and folder can be given away as they are.
pub const KEY: &str = "blind-key.json";
/// What the key's file says it is.
const FORMAT: &str = "enliven blind key 1";
/// Letters of a video's name, and of a comparison's.
const LETTERS: usize = 16;

/// A video, found again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Named {
    /// Name of its scene.
    pub scene: String,
    /// Name of its row.
    pub row: String,
}

/// Every video that is or was in the blind test of a folder.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Key {
    format: String,
    /// Fingerprint of the videos together.
    pub comparison: String,
    /// Fingerprints from before rows were made anew.
    pub earlier: BTreeSet<String>,
    /// Those on the page, by the names they have there.
    pub videos: BTreeMap<String, Named>,
    /// Those that were made anew since.
    pub gone: BTreeMap<String, Named>,
}

impl Key {
    /// Names the rows of a comparison in `folder` for which `takes_part` is true.
    ///
    /// # Errors
    /// A video that cannot be read; fewer than two of every scene.
    pub fn make(comparison: &Comparison, folder: &Path, takes_part: impl Fn(Sort) -> bool) -> Result<Self> {
        let mut videos = names(comparison, folder)?;
        let taken = |named: &Named| row(comparison, named).is_some_and(|row| takes_part(row.sort));
        videos.retain(|_, named| taken(named));
        let of = |scene: &SceneRows| videos.values().filter(|named| named.scene == scene.name).count();
        if !comparison.scenes.iter().any(|scene| of(scene) > 1) {
            return Err(Error::new(Kind::Unusable, "--blind", "no scene has two videos to choose between")
                .remedy("look on the page why they were not made"));
        }
        let all: Vec<&str> = videos.keys().map(String::as_str).collect();
        let comparison = hash(&all);
        Ok(Self { format: FORMAT.into(), comparison, videos, ..Self::default() })
    }

    /// The key in `folder`; none where there was no blind test.
    ///
    /// # Errors
    /// One that this program cannot read.
    pub fn load(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(KEY);
        if !path.exists() {
            return Ok(None);
        }
        let bad =
            |problem: String| Error::file(Kind::Data, &path, problem).remedy("run the comparison with --blind again");
        let text = fs::read_to_string(&path).map_err(|e| Error::io(&path, "read", e))?;
        let key: Self =
            serde_json::from_str(&text).map_err(|e| bad(format!("cannot be read as the key of a blind test: {e}")))?;
        if key.format != FORMAT {
            return Err(bad(format!("is {:?}", key.format)).allowed(FORMAT));
        }
        Ok(Some(key))
    }

    /// Adds what `before` knew.
    pub fn after(mut self, before: Self) -> Self {
        self.earlier = before.earlier;
        self.earlier.insert(before.comparison);
        self.earlier.remove(&self.comparison);
        let gone = before.gone.into_iter().chain(before.videos);
        self.gone = gone.filter(|(id, _)| !self.videos.contains_key(id)).collect();
        self
    }

    /// Puts the videos under their new names, removes those that are gone, and writes the key.
    ///
    /// # Errors
    /// A folder that cannot be written to, a full disk.
    pub fn write(&self, comparison: &Comparison, folder: &Path) -> Result<()> {
        let videos = folder.join(FOLDER);
        fs::create_dir_all(&videos).map_err(|e| Error::io(&videos, "make the folder", e))?;
        for (id, named) in &self.videos {
            let Some(video) = row(comparison, named).and_then(|row| row.video.as_ref()) else { continue };
            let (from, to) = (folder.join(video), videos.join(file(id)));
            // Names follow from content: what is there already is the same.
            if !to.exists() && fs::hard_link(&from, &to).is_err() {
                copy(&from, &to)?;
            }
        }
        for id in self.gone.keys() {
            let old = videos.join(file(id));
            if old.exists() {
                fs::remove_file(&old).map_err(|e| Error::io(&old, "remove", e))?;
            }
        }
        let text = serde_json::to_string_pretty(self).map_err(|e| Error::new(Kind::Data, KEY, e.to_string()))?;
        atomic_file::write(&folder.join(KEY), text.as_bytes())
    }

    /// Whether a fingerprint is or was this comparison's.
    pub fn knows_comparison(&self, fingerprint: &str) -> bool {
        self.comparison == fingerprint || self.earlier.contains(fingerprint)
    }

    /// A video that is or was in the test.
    pub fn named(&self, id: &str) -> Option<&Named> {
        self.videos.get(id).or_else(|| self.gone.get(id))
    }
}

/// The videos that a comparison has now, by the names that blind tests know them by: a hash of scene, row and content, so
/// that one made anew has another unless it came out the same.
///
/// # Errors
/// A video that cannot be read.
pub fn names(comparison: &Comparison, folder: &Path) -> Result<BTreeMap<String, Named>> {
    let mut names = BTreeMap::new();
    for scene in &comparison.scenes {
        for row in &scene.rows {
            let Some(video) = &row.video else { continue };
            let content = blake3::Hash::from(content_hash(&folder.join(video))?).to_hex();
            let named = Named { scene: scene.name.clone(), row: row.name.clone() };
            names.insert(hash(&[&scene.name, &row.name, &content]), named);
        }
    }
    Ok(names)
}

/// File of a video.
pub(super) fn file(id: &str) -> String {
    format!("{id}.mp4")
}

/// Whether this could be a name that [`hash`] gave.
pub(super) fn is_name(id: &str) -> bool {
    id.len() == LETTERS && id.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
}

fn row<'a>(comparison: &'a Comparison, named: &Named) -> Option<&'a Row> {
    let scene = comparison.scenes.iter().find(|scene| scene.name == named.scene)?;
    scene.rows.iter().find(|row| row.name == named.row)
}

fn hash(parts: &[&str]) -> String {
    let mut hasher = blake3::Hasher::new_derive_key("enliven blind test 1");
    for part in parts {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part.as_bytes());
    }
    hasher.finalize().to_hex()[..LETTERS].to_owned()
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    let mut source = fs::File::open(from).map_err(|e| Error::io(from, "open", e))?;
    let mut target = AtomicFile::create(to)?;
    std::io::copy(&mut source, &mut target).map_err(|e| Error::io(to, "write", e))?;
    target.commit()
}
