//! Files and folders of frames that appear under their final name whole, or not at all.
//!
//! Work goes to a hidden temporary neighbour (same folder, hence same file system), is flushed to the disk and then
//! renamed. What is dropped without a commit is removed.

use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::error::{Error, Kind, Result};

/// Longest file name, in bytes, that the temporary name is derived from; beyond it the name is cut.
const NAME_BYTES: usize = 200;

/// A file being written, which gets its final name on [`AtomicFile::commit`].
///
/// It can be read back and sought like a [`File`]. Dropped without a commit, it leaves nothing behind and the file
/// that had the final name before stays as it was.
#[derive(Debug)]
pub struct AtomicFile {
    file: File,
    temporary: PathBuf,
    target: PathBuf,
    committed: bool,
}

impl AtomicFile {
    /// Opens a temporary neighbour of `path`, to read and write.
    ///
    /// # Errors
    /// When the folder is missing or cannot be written to, or `path` is itself a folder.
    pub fn create(path: &Path) -> Result<Self> {
        if path.is_dir() {
            return Err(Error::file(Kind::Io, path, "cannot write: it is a folder").remedy("give the name of a file"));
        }
        let temporary = temporary_neighbour(path)?;
        let opened = File::options().read(true).write(true).create_new(true).open(&temporary);
        let file = opened.map_err(|e| unwritable(path, e))?;
        Ok(Self { file, temporary, target: path.to_path_buf(), committed: false })
    }

    /// The final name.
    pub fn path(&self) -> &Path {
        &self.target
    }

    /// The file that is written to until the commit.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Flushes the content to the disk; [`AtomicFile::commit`] does it too, this is for telling the time it takes.
    ///
    /// # Errors
    /// When the disk is full.
    pub fn sync(&self) -> Result<()> {
        self.file.sync_all().map_err(|e| Error::io(&self.target, "write", e))
    }

    /// Flushes the content to the disk, gives the file its final name (replacing an older file) and flushes the folder.
    ///
    /// # Errors
    /// When the disk is full or the system refuses; the older file is then still there.
    pub fn commit(mut self) -> Result<()> {
        self.sync()?;
        fs::rename(&self.temporary, &self.target).map_err(|e| Error::io(&self.target, "rename", e))?;
        self.committed = true;
        sync_folder(parent(&self.target))
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Read for AtomicFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.file.read(buffer)
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.file.seek(position)
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if !self.committed {
            // Nobody is left to tell; a temporary file that cannot be removed is hidden and named after its target.
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

/// Writes `bytes` to `path`, whole or not at all.
///
/// # Errors
/// Those of [`AtomicFile`].
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes).map_err(|e| Error::io(path, "write", e))?;
    file.commit()
}

/// A folder being filled, which gets its final name on [`AtomicFolder::commit`].
///
/// An existing folder is replaced only when it is empty or holds nothing but files for which `ours` is true (frames of
/// an earlier run); anything else is an error, before any work and again at the commit.
#[derive(Debug)]
pub struct AtomicFolder {
    temporary: PathBuf,
    target: PathBuf,
    ours: fn(&str) -> bool,
    kept: Vec<PathBuf>,
    committed: bool,
}

impl AtomicFolder {
    /// Makes a temporary neighbour of the folder `path`; `ours` tells by its name a file that may be replaced.
    ///
    /// # Errors
    /// When `path` is a file, or a folder with something else in it, or its parent is missing or cannot be written to.
    pub fn create(path: &Path, ours: fn(&str) -> bool) -> Result<Self> {
        // Without a trailing slash the parent and the name are what they seem.
        let target: PathBuf = path.components().collect();
        let temporary = temporary_neighbour(&target)?;
        check_replaceable(&target, ours)?;
        fs::create_dir(&temporary).map_err(|e| unwritable(&target, e))?;
        Ok(Self { temporary, target, ours, kept: Vec::new(), committed: false })
    }

    /// The final name.
    pub fn path(&self) -> &Path {
        &self.target
    }

    /// Where `name` lies until the commit, for who writes a file of his own into the folder.
    pub fn inside(&self, name: &str) -> PathBuf {
        self.temporary.join(name)
    }

    /// Writes the file `name` into the folder and flushes it to the disk; makes the folder within it that `name` asks for.
    ///
    /// # Errors
    /// When the disk is full or the system refuses.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        let path = self.temporary.join(name);
        let write = || -> io::Result<()> {
            fs::create_dir_all(parent(&path))?;
            let mut file = File::options().write(true).create_new(true).open(&path)?;
            file.write_all(bytes)?;
            file.sync_data()
        };
        write().map_err(|e| Error::io(&self.target.join(name), "write", e))
    }

    /// Takes a file of the folder that is replaced over into the new one, the very same file: nothing may be written under
    /// its name.
    pub fn keep(&mut self, name: impl Into<PathBuf>) {
        self.kept.push(name.into());
    }

    /// Flushes the folder and moves its files into the folder of the final name, beside the files of ours that are there
    /// and over those of the same name; each of them appears whole. Several programs may do so at once.
    ///
    /// # Errors
    /// As [`AtomicFolder::commit`]; files moved before the error stay.
    pub fn commit_beside(self) -> Result<()> {
        sync_folder(&self.temporary)?;
        fs::create_dir_all(&self.target).map_err(|e| unwritable(&self.target, e))?;
        check_replaceable(&self.target, self.ours)?;
        let list =
            || fs::read_dir(&self.temporary)?.map(|entry| Ok(entry?.file_name())).collect::<io::Result<Vec<_>>>();
        for name in list().map_err(|e| Error::io(&self.target, "list the new frames of", e))? {
            let target = self.target.join(&name);
            fs::rename(self.temporary.join(&name), &target).map_err(|e| Error::io(&target, "rename", e))?;
        }
        sync_folder(&self.target)?;
        sync_folder(parent(&self.target))
    }

    /// Flushes the folder, gives it its final name (replacing frames of an earlier run) and flushes its parent.
    ///
    /// # Errors
    /// When something that is not ours came into the target folder meanwhile, or the system refuses; the older folder
    /// is then still there.
    pub fn commit(mut self) -> Result<()> {
        self.kept.iter().try_for_each(|name| self.take_over(name))?;
        sync_tree(&self.temporary)?;
        check_replaceable(&self.target, self.ours)?;
        let old = self.target.is_dir().then(|| temporary_neighbour(&self.target)).transpose()?;
        let rename = |from: &Path, to: &Path| fs::rename(from, to).map_err(|e| Error::io(&self.target, "rename", e));
        if let Some(old) = &old {
            rename(&self.target, old)?;
        }
        if let Err(error) = rename(&self.temporary, &self.target) {
            if let Some(old) = &old {
                rename(old, &self.target)?;
            }
            return Err(error);
        }
        self.committed = true;
        sync_folder(parent(&self.target))?;
        old.map_or(Ok(()), |old| {
            remove_ours(&old, "", self.ours).map_err(|e| Error::io(&old, "remove the old frames", e))
        })
    }
}

impl AtomicFolder {
    /// Gives a file of the old folder a place in the new one.
    fn take_over(&self, name: &Path) -> Result<()> {
        let (from, to) = (self.target.join(name), self.temporary.join(name));
        let link = || {
            fs::create_dir_all(parent(&to))?;
            // Some disks know no links.
            fs::hard_link(&from, &to).or_else(|_| fs::copy(&from, &to).map(drop))
        };
        link().map_err(|e| Error::io(&from, "keep", e))
    }
}

impl Drop for AtomicFolder {
    fn drop(&mut self) {
        if !self.committed {
            // Only files written here can be in it: it is new and its name is unique.
            let _ = fs::remove_dir_all(&self.temporary);
        }
    }
}

/// Checks that a file could be created beside `path`, by creating and removing one, so that long work does not end in
/// an error that could be told at once.
///
/// # Errors
/// When the folder is missing, is not a folder, or cannot be written to.
pub fn check_writable(path: &Path) -> Result<()> {
    let probe = temporary_neighbour(path)?;
    File::options().write(true).create_new(true).open(&probe).map_err(|e| unwritable(path, e))?;
    fs::remove_file(&probe).map_err(|e| Error::io(&probe, "remove", e))
}

/// A hidden name beside `path`, unique in this process and among processes: `.name.PID-COUNT.part`.
fn temporary_neighbour(path: &Path) -> Result<PathBuf> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let Some(name) = path.file_name() else {
        return Err(Error::file(Kind::Usage, path, "is not the name of a file").remedy("give a file name"));
    };
    let folder = parent(path);
    if !folder.is_dir() {
        let (problem, remedy) = if folder.exists() {
            (format!("{} is a file, not a folder", folder.display()), "write elsewhere")
        } else {
            (format!("the folder {} does not exist", folder.display()), "make that folder first, or write elsewhere")
        };
        return Err(Error::file(Kind::Io, path, problem).remedy(remedy));
    }
    let name = name.to_string_lossy();
    let cut = (0..=name.len().min(NAME_BYTES)).rev().find(|&i| name.is_char_boundary(i)).unwrap_or(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    Ok(folder.join(format!(".{}.{}-{count}.part", &name[..cut], std::process::id())))
}

/// The folder `path` lies in; the working folder for a bare name.
fn parent(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn unwritable(path: &Path, error: io::Error) -> Error {
    let folder = parent(path).display().to_string();
    Error::io(path, &format!("write into the folder {folder}"), error)
}

/// Makes a rename durable. Windows has no folder handles to flush; its rename is durable by itself.
fn sync_folder(folder: &Path) -> Result<()> {
    if cfg!(windows) {
        return Ok(());
    }
    File::open(folder).and_then(|f| f.sync_all()).map_err(|e| Error::io(folder, "flush the folder", e))
}

/// [`sync_folder`] for a folder and the folders within it.
fn sync_tree(folder: &Path) -> Result<()> {
    let list = || -> io::Result<Vec<fs::DirEntry>> { fs::read_dir(folder)?.collect() };
    for entry in list().map_err(|e| Error::io(folder, "list", e))? {
        if entry.file_type().is_ok_and(|t| t.is_dir()) {
            sync_tree(&entry.path())?;
        }
    }
    sync_folder(folder)
}

/// An error unless `target` is free, or a folder with nothing in it but files that are `ours`.
fn check_replaceable(target: &Path, ours: fn(&str) -> bool) -> Result<()> {
    let metadata = match fs::symlink_metadata(target) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(()),
        other => other.map_err(|e| Error::io(target, "write", e))?,
    };
    if !metadata.is_dir() {
        return Err(Error::file(Kind::Io, target, "is not a folder").remedy("remove it, or write to another folder"));
    }
    match foreign(target, "", ours).map_err(|e| Error::io(target, "list", e))? {
        None => Ok(()),
        Some(name) => Err(Error::file(
            Kind::Io,
            target,
            format!("holds {name}, which is not what is written there, so it is not replaced"),
        )
        .allowed("a new or empty folder, or one with nothing but the files of an earlier run")
        .remedy("write to another folder")),
    }
}

/// The first thing below `folder` that is not `ours`; `prefix` is its name within the whole.
fn foreign(folder: &Path, prefix: &str, ours: fn(&str) -> bool) -> io::Result<Option<String>> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let sort = entry.file_type()?;
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if sort.is_dir() && ours(&format!("{name}/")) {
            if let Some(found) = foreign(&entry.path(), &format!("{name}/"), ours)? {
                return Ok(Some(found));
            }
        } else if !sort.is_file() || !ours(&name) {
            return Ok(Some(name));
        }
    }
    Ok(None)
}

/// Removes the files of ours and then the folder, which fails, losing nothing, when anything else is in it.
fn remove_ours(folder: &Path, prefix: &str, ours: fn(&str) -> bool) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let sort = entry.file_type()?;
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if sort.is_dir() && ours(&format!("{name}/")) {
            remove_ours(&entry.path(), &format!("{name}/"), ours)?;
        } else if sort.is_file() && ours(&name) {
            fs::remove_file(entry.path())?;
        }
    }
    fs::remove_dir(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn numbered(name: &str) -> bool {
        name.strip_suffix(".png").is_some_and(|n| n.len() == 5 && n.bytes().all(|b| b.is_ascii_digit()))
    }

    #[test]
    fn appears_on_commit_only() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pack");
        fs::write(&path, "old").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"old");
        file.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["a.pack"]);
    }

    #[test]
    fn dropped_without_commit_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = AtomicFile::create(&folder.path().join("a")).unwrap();
        file.write_all(b"half").unwrap();
        drop(file);
        let frames = AtomicFolder::create(&folder.path().join("b"), numbered).unwrap();
        frames.write("00000.png", b"x").unwrap();
        drop(frames);
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn a_missing_or_unwritable_folder_is_told_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("none/a.mp4");
        for error in [check_writable(&missing).unwrap_err(), AtomicFile::create(&missing).unwrap_err()] {
            assert!(error.to_string().contains("does not exist"), "{error}");
        }
        fs::write(folder.path().join("file"), "").unwrap();
        assert_eq!(check_writable(&folder.path().join("file/a.mp4")).unwrap_err().kind(), Kind::Io);
        check_writable(&folder.path().join("a.mp4")).unwrap();
        assert_eq!(names(folder.path()), ["file"]);
    }

    #[test]
    fn a_folder_replaces_only_earlier_frames() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("out/");
        for count in [3, 2] {
            let frames = AtomicFolder::create(&target, numbered).unwrap();
            (0..count).for_each(|i| frames.write(&format!("{i:05}.png"), &[count]).unwrap());
            frames.commit().unwrap();
        }
        assert_eq!(names(&target), ["00000.png", "00001.png"]);
        let late = AtomicFolder::create(&target, numbered).unwrap();
        fs::write(target.join("notes.txt"), "mine").unwrap();
        let error = AtomicFolder::create(&target, numbered).unwrap_err();
        assert!(error.to_string().contains("notes.txt"), "{error}");
        late.commit().unwrap_err();
        assert_eq!(names(&target), ["00000.png", "00001.png", "notes.txt"]);
        assert_eq!(names(folder.path()), ["out"]);
    }

    #[test]
    fn a_folder_can_be_filled_in_parts() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("out");
        for (first, content) in [(2, 1), (0, 2), (1, 3)] {
            let frames = AtomicFolder::create(&target, numbered).unwrap();
            (first..first + 2).for_each(|i| frames.write(&format!("{i:05}.png"), &[content]).unwrap());
            frames.commit_beside().unwrap();
        }
        assert_eq!(names(&target), ["00000.png", "00001.png", "00002.png", "00003.png"]);
        let content = [0, 1, 2, 3].map(|i| fs::read(target.join(format!("{i:05}.png"))).unwrap()[0]);
        assert_eq!(content, [2, 3, 3, 1]);
        assert_eq!(names(folder.path()), ["out"]);
    }

    #[test]
    fn a_folder_of_folders_is_replaced_like_one() {
        let ours = |name: &str| ["inner/", "inner/a", "b"].contains(&name);
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("out");
        for content in [b"1", b"2"] {
            let tree = AtomicFolder::create(&target, ours).unwrap();
            tree.write("inner/a", content).unwrap();
            fs::write(tree.inside("b"), content).unwrap();
            tree.commit().unwrap();
        }
        assert_eq!(fs::read(target.join("inner/a")).unwrap(), b"2");
        assert_eq!((names(folder.path()), names(&target)), (vec!["out".to_owned()], vec!["b".into(), "inner".into()]));
        let mut tree = AtomicFolder::create(&target, ours).unwrap();
        fs::write(target.join("inner/a"), "mine").unwrap();
        tree.keep("inner/a");
        tree.write("b", b"3").unwrap();
        tree.commit().unwrap();
        assert_eq!(
            ["inner/a", "b"].map(|name| fs::read(target.join(name)).unwrap()),
            [b"mine".to_vec(), b"3".to_vec()]
        );
        fs::write(target.join("inner/mine"), "").unwrap();
        let error = AtomicFolder::create(&target, ours).unwrap_err();
        assert!(error.to_string().contains("holds inner/mine"), "{error}");
    }

    #[test]
    fn very_long_names_work() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ä".repeat(120));
        write(&path, b"x").unwrap();
        assert_eq!(fs::read(path).unwrap(), b"x");
    }
}
