//! The folder `L.pack.build` of an unfinished build: one segment per analysed clip, locked.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use super::format::{MAGIC, MAJOR, MINOR, Parameters};
use super::piece::ClipId;
use super::segment::Segment;
use crate::base::atomic_file;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;

/// Name of the lock file.
const LOCK: &str = "lock";
/// Version of how clips become frames and are judged; raised whenever either comes out otherwise, so that segments left
/// by an older program are not taken for this one's.
const READING: u32 = 2;
/// Ending of segments.
const SEGMENT: &str = "segment";

/// An unfinished build, locked against a second one. The lock goes with the process, however it ends.
pub struct Workshop {
    folder: PathBuf,
    output: PathBuf,
    _lock: File,
}

impl Workshop {
    /// Opens or makes the folder beside `output` and removes what dead builds left half-written.
    ///
    /// # Errors
    /// When another build works on the same output, or the folder cannot be written to.
    pub fn open(output: &Path) -> Result<Self> {
        let Some(name) = output.file_name() else {
            return Err(Error::file(Kind::Usage, output, "is not the name of a file").remedy("give -o NAME.pack"));
        };
        if output.is_dir() {
            return Err(Error::file(Kind::Usage, output, "is a folder").remedy("give -o FOLDER/NAME.pack"));
        }
        refuse_stranger(output)?;
        atomic_file::check_writable(output)?;
        let folder = output.with_file_name(format!("{}.build", name.to_string_lossy()));
        // A build that ends removes its folder; whoever came between opening and locking the file starts again.
        for _ in 0..10 {
            make(&folder)?;
            let lock = lock(&folder)?;
            if is_same(&lock, &folder.join(LOCK)) {
                let workshop = Self { folder, output: output.to_path_buf(), _lock: lock };
                workshop.remove_stale()?;
                return Ok(workshop);
            }
        }
        Err(Error::file(Kind::Io, &folder, "another build keeps removing it").remedy("wait until it is done"))
    }

    /// Removes temporary files: with the lock held, nobody alive is writing them.
    fn remove_stale(&self) -> Result<()> {
        let name = self.output.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let beside = match self.output.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        for (folder, prefix) in [(beside, format!(".{name}.")), (&self.folder, ".".to_owned())] {
            for path in list(folder)? {
                let file = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
                if file.strip_prefix(&prefix).is_some_and(is_temporary) {
                    fs::remove_file(&path).map_err(|e| Error::io(&path, "remove", e))?;
                }
            }
        }
        Ok(())
    }

    /// Where the segment of a clip belongs: its name tells content, mask, options and version.
    pub fn segment_path(&self, clip: ClipId, mask: Option<[u8; 32]>, parameters: &Parameters) -> PathBuf {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&clip.0);
        hasher.update(&mask.unwrap_or_default());
        let versions = [u32::from(MAJOR), u32::from(MINOR), parameters.features, READING];
        for value in versions.into_iter().chain([parameters.rate, parameters.working]) {
            hasher.update(&value.to_le_bytes());
        }
        self.folder.join(format!("{}.{SEGMENT}", &hasher.finalize().to_hex()[..32]))
    }

    /// A finished segment of an earlier, interrupted build; a damaged one is removed, with a note.
    pub fn finished(&self, path: &Path, observer: &dyn Observer) -> Option<Segment> {
        if !path.exists() {
            return None;
        }
        // Opened twice, so that the pages read by the check do not stay in memory.
        match Segment::open(path).and_then(|s| s.check_all()).and_then(|()| Segment::open(path)) {
            Ok(segment) => Some(segment),
            Err(error) => {
                observer.note(&format!("{error}; it is made anew"));
                // If it cannot be removed, writing the new one will say why.
                let _ = fs::remove_file(path);
                None
            }
        }
    }

    /// True when `error` is about a file in this folder.
    pub fn concerns(&self, error: &Error) -> bool {
        error.subject().starts_with(&*self.folder.to_string_lossy())
    }

    /// Removes segments, lock and folder after a finished build. Files that are not ours stay, and so does the folder.
    ///
    /// # Errors
    /// When a segment cannot be removed.
    pub fn remove(self) -> Result<()> {
        self.segments()?.iter().try_for_each(|path| fs::remove_file(path).map_err(|e| Error::io(path, "remove", e)))
    }

    fn segments(&self) -> Result<Vec<PathBuf>> {
        Ok(list(&self.folder)?.into_iter().filter(|p| p.extension().is_some_and(|e| e == SEGMENT)).collect())
    }
}

impl Drop for Workshop {
    /// A folder in which nothing waits for the next build goes, with its lock.
    fn drop(&mut self) {
        if self.segments().is_ok_and(|s| s.is_empty()) {
            // Both fail harmlessly; the folder stays when somebody keeps other files in it.
            let _ = fs::remove_file(self.folder.join(LOCK));
            let _ = fs::remove_dir(&self.folder);
        }
    }
}

/// Refuses to replace a file that is not a library, such as a clip named by mistake.
fn refuse_stranger(output: &Path) -> Result<()> {
    let mut head = Vec::new();
    let Ok(file) = File::open(output) else { return Ok(()) };
    file.take(MAGIC.len() as u64).read_to_end(&mut head).map_err(|e| Error::io(output, "read", e))?;
    if head.is_empty() || head == MAGIC {
        return Ok(());
    }
    Err(Error::file(Kind::Usage, output, "exists and is not a library, so it is not replaced")
        .remedy("give another name with -o"))
}

/// Makes the folder unless it is there; its parent must be.
fn make(folder: &Path) -> Result<()> {
    match fs::create_dir(folder) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            Err(Error::file(Kind::Io, folder, "cannot be made: the folder it belongs into does not exist")
                .remedy("make it first, or write elsewhere"))
        }
        Err(e) if e.kind() != std::io::ErrorKind::AlreadyExists => Err(Error::io(folder, "make the folder", e)),
        _ => Ok(()),
    }
}

fn list(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).and_then(|list| list.map(|e| e.map(|e| e.path())).collect());
    entries.map_err(|e| Error::io(folder, "list", e))
}

/// `PID-COUNT.part`, or the same after the name of a file.
fn is_temporary(rest: &str) -> bool {
    let Some(stem) = rest.strip_suffix(".part") else { return false };
    let numbers = stem.rsplit('.').next().unwrap_or(stem);
    let digits = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
    numbers.split_once('-').is_some_and(|(pid, count)| digits(pid) && digits(count))
}

fn lock(folder: &Path) -> Result<File> {
    let path = folder.join(LOCK);
    let options = File::options().write(true).create(true).truncate(false).open(&path);
    let file = options.map_err(|e| Error::io(&path, "make the lock", e))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(fs::TryLockError::WouldBlock) => {
            Err(Error::file(Kind::Io, folder, "another build is writing this library").remedy("wait until it is done"))
        }
        Err(fs::TryLockError::Error(e)) => Err(Error::io(&path, "lock", e)),
    }
}

/// True when the file of that name is still the one that was locked.
#[cfg(unix)]
fn is_same(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), fs::metadata(path)) {
        (Ok(a), Ok(b)) => (a.dev(), a.ino()) == (b.dev(), b.ino()),
        _ => false,
    }
}

/// True when the file of that name is still the one that was locked (elsewhere an open file cannot be removed).
#[cfg(not(unix))]
fn is_same(_: &File, path: &Path) -> bool {
    path.exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_build_is_told_and_leftovers_go() {
        let root = tempfile::tempdir().unwrap();
        let output = root.path().join("a.pack");
        let folder = root.path().join("a.pack.build");
        fs::create_dir(&folder).unwrap();
        let stale = [root.path().join(".a.pack.123-4.part"), folder.join(".77aa.segment.9-0.part")];
        let others =
            [root.path().join(".b.pack.123-4.part"), root.path().join(".a.pack.part"), folder.join("mine.txt")];
        stale.iter().chain(&others).for_each(|p| fs::write(p, "x").unwrap());
        let workshop = Workshop::open(&output).unwrap();
        let error = Workshop::open(&output).map(|_| ()).unwrap_err();
        assert!(error.to_string().contains("another build"), "{error}");
        assert!(stale.iter().all(|p| !p.exists()) && others.iter().all(|p| p.exists()));
        workshop.remove().unwrap();
        assert!(folder.exists() && !folder.join(LOCK).exists(), "a stranger's file keeps the folder");
        fs::remove_file(folder.join("mine.txt")).unwrap();
        Workshop::open(&output).unwrap().remove().unwrap();
        assert!(!folder.exists());
    }
}
