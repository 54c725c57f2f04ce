//! Names of a library's clips for people: the sidecar `L.pack.names.toml` beside `L.pack`.
//!
//! A pack names its clips by hash alone, so that the same clips make the same bytes wherever they lay. The sidecar says
//! which file each was. Nothing needs it: without it, or with a damaged one, clips go by their hashes.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::metadata::ClipMeta;
use super::piece::ClipId;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::own_file;

/// Most bytes of a sidecar that is read.
const MAX_BYTES: u64 = 16 << 20;
/// What the file says of itself.
const HEAD: &str = "# File names of this library's clips, for people. Nothing needs this file.\n\n";

/// File names by clip.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Names(BTreeMap<ClipId, String>);

/// The sidecar as it is written: file names by all 64 hexadecimal digits of the clip's hash.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sidecar {
    clips: BTreeMap<String, String>,
}

impl Names {
    /// The names of the files that clips were read from; folders and control characters are left out of them.
    pub fn of_files<'a>(files: impl IntoIterator<Item = (ClipId, &'a Path)>) -> Self {
        let name = |path: &Path| plain(&path.file_name().unwrap_or_default().to_string_lossy());
        Self(files.into_iter().map(|(id, path)| (id, name(path))).filter(|(_, name)| !name.is_empty()).collect())
    }

    /// The sidecar's name: `L.pack` to `L.pack.names.toml`.
    pub fn beside(pack: &Path) -> PathBuf {
        let mut name = pack.file_name().unwrap_or_default().to_os_string();
        name.push(".names.toml");
        pack.with_file_name(name)
    }

    /// Reads the names of the clips of a pack; none where there is no sidecar. One that is damaged, or that names clips
    /// which the pack does not hold, is told of and serves as far as it fits.
    pub fn read(pack: &Path, clips: &[ClipMeta], observer: &dyn Observer) -> Self {
        let path = Self::beside(pack);
        let mut names = match read(&path) {
            Ok(names) => names,
            Err(error) => {
                observer.note(&format!("{error}; clips are named by their hashes"));
                return Self::default();
            }
        };
        let all = names.0.len();
        names.0.retain(|id, _| clips.iter().any(|clip| clip.id == *id));
        if names.0.len() < all {
            let strangers = all - names.0.len();
            observer.note(&format!(
                "{}: {strangers} of its {all} names are of clips that this library does not hold; they are not used",
                path.display()
            ));
        }
        names
    }

    /// Writes the sidecar of `pack`, whole or not at all.
    ///
    /// # Errors
    /// A sidecar that a person made or changed; a folder that cannot be written to, a full disk.
    pub fn write(&self, pack: &Path) -> Result<()> {
        let path = Self::beside(pack);
        let clips = self.0.iter().map(|(id, name)| (blake3::Hash::from(id.0).to_hex().to_string(), name.clone()));
        let text = toml::to_string(&Sidecar { clips: clips.collect() })
            .map_err(|e| Error::file(Kind::Data, &path, format!("cannot be written: {e}")).source(e))?;
        own_file::write(&path, (HEAD.to_owned() + &text).as_bytes())
    }

    /// The name of a clip's file.
    pub fn of(&self, clip: ClipId) -> Option<&str> {
        self.0.get(&clip).map(String::as_str)
    }

    /// The clips whose file has this name, with or without its ending.
    pub fn called<'a>(&'a self, name: &'a str) -> impl Iterator<Item = ClipId> + 'a {
        let fits = move |file: &str| file == name || file.rsplit_once('.').is_some_and(|(stem, _)| stem == name);
        self.0.iter().filter(move |(_, file)| fits(file)).map(|(id, _)| *id)
    }
}

/// A name as it can be printed on one line.
fn plain(name: &str) -> String {
    name.chars().filter(|c| !c.is_control()).collect()
}

fn read(path: &Path) -> Result<Names> {
    let length = match std::fs::metadata(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Names::default()),
        found => found.map_err(|e| Error::io(path, "read", e))?.len(),
    };
    if length > MAX_BYTES {
        return Err(Error::file(Kind::Limit, path, format!("{length} bytes are too many for names of clips")));
    }
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, "read", e))?;
    let bad = |problem: &str| Error::file(Kind::Data, path, format!("holds no names of clips: {problem}"));
    let sidecar: Sidecar = toml::from_str(&text).map_err(|e| bad(e.message()).source(e))?;
    let entry = |(id, name): (String, String)| {
        let hash = blake3::Hash::from_hex(&id).map_err(|_| bad(&format!("{id:?} is not the hash of a clip")))?;
        Ok((ClipId(*hash.as_bytes()), plain(&name)))
    };
    Ok(Names(sidecar.clips.into_iter().map(entry).collect::<Result<_>>()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::observe::testing::Notes;
    use crate::library::metadata::PieceCounts;
    use crate::library::variant::Variant;

    fn clip(byte: u8) -> ClipMeta {
        ClipMeta {
            id: ClipId([byte; 32]),
            tag: String::new(),
            width: 96,
            height: 80,
            frames: 50,
            first_piece: 0,
            counts: [PieceCounts::default(); Variant::COUNT],
        }
    }

    #[test]
    fn names_come_back_and_find_their_clips() {
        let folder = tempfile::tempdir().unwrap();
        let pack = folder.path().join("l.pack");
        let files = [(1, "a/river.mp4"), (2, "b/river.mov"), (3, "odd \" \u{7}= näme")];
        let names = Names::of_files(files.iter().map(|(id, path)| (ClipId([*id; 32]), Path::new(*path))));
        names.write(&pack).unwrap();
        assert!(folder.path().join("l.pack.names.toml").is_file());
        let notes = Notes::default();
        let read = Names::read(&pack, &[clip(1), clip(2), clip(3)], &notes);
        assert_eq!((&read, notes.0.into_inner().unwrap().len()), (&names, 0));
        assert_eq!((read.of(ClipId([1; 32])), read.of(ClipId([9; 32]))), (Some("river.mp4"), None));
        assert_eq!(read.of(ClipId([3; 32])), Some("odd \" = näme"));
        let called = |name: &str| read.called(name).map(|id| id.0[0]).collect::<Vec<_>>();
        assert_eq!((called("river"), called("river.mov"), called("rive")), (vec![1, 2], vec![2], vec![]));
    }

    #[test]
    fn a_bad_or_stale_sidecar_is_told_of_and_harmless() {
        let folder = tempfile::tempdir().unwrap();
        let pack = folder.path().join("l.pack");
        let read = |text: Option<&str>| {
            text.map_or(Ok(()), |text| std::fs::write(Names::beside(&pack), text)).unwrap();
            let notes = Notes::default();
            let names = Names::read(&pack, &[clip(1)], &notes);
            (names.0.len(), notes.0.into_inner().unwrap().join("; "))
        };
        assert_eq!(read(None), (0, String::new()));
        for text in ["no toml", "[clips]\nabc = 'x'\n", "[clips]\nabc = 3\n", "[other]\n", "clips = 3"] {
            let (count, said) = read(Some(text));
            assert!(count == 0 && said.contains("l.pack.names.toml: holds no names of clips"), "{text}: {said}");
        }
        let both: String = [1u8, 2].map(|b| format!("{} = 'x.mp4'\n", format!("{b:02x}").repeat(32))).concat();
        let (count, said) = read(Some(&format!("[clips]\n{both}")));
        assert!(count == 1 && said.contains("l.pack.names.toml: 1 of its 2 names"), "{said}");
        std::fs::remove_file(Names::beside(&pack)).unwrap();
        std::fs::create_dir(Names::beside(&pack)).unwrap();
        let (count, said) = read(None);
        assert!(count == 0 && said.contains("l.pack.names.toml"), "{said}");
    }
}
