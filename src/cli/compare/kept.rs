//! What a row was made from, and whether it still holds.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::plan::Cell;
use crate::base::atomic_file;
use crate::base::error::{Error, Kind, Result};
use crate::report::comparison::Row;
use crate::scene::file;
use crate::scene::scene::for_each_path;

/// Files up to this many bytes are compared whole; of larger ones (libraries, which end with their checksum) the length
/// and this much of either end.
const PART: u64 = 1 << 24;
/// Letters of a hash that are written down.
const LETTERS: usize = 16;

/// Hashes of files and folders, each worked out once: most rows are made from the same.
#[derive(Default)]
pub struct Fingerprints(RefCell<BTreeMap<PathBuf, String>>);

impl Fingerprints {
    fn of(&self, path: &Path) -> Result<String> {
        if let Some(known) = self.0.borrow().get(path) {
            return Ok(known.clone());
        }
        let new = fingerprint(path)?;
        self.0.borrow_mut().insert(path.to_owned(), new.clone());
        Ok(new)
    }
}

/// The program: its version, and its hash, since versions are rarer than changes.
///
/// # Errors
/// A program that cannot read itself.
pub fn program(files: &Fingerprints) -> Result<String> {
    let path = std::env::current_exe().map_err(|e| Error::io(Path::new("the program"), "find", e))?;
    Ok(format!("Enliven {} ({})", env!("CARGO_PKG_VERSION"), files.of(&path)?))
}

/// What a row is made from, by name.
///
/// # Errors
/// A scene that is not sound; inputs that cannot be read.
pub fn ingredients(cell: &Cell, files: &Fingerprints) -> Result<BTreeMap<String, String>> {
    let mut all = BTreeMap::from([("the program".to_owned(), program(files)?)]);
    // Shuffled frames change with the row that they are from.
    let mut file = cell.shuffles.as_deref().unwrap_or(cell).settings()?;
    let mut read = Ok(());
    // A file counts by its content, wherever it lies.
    for_each_path(&mut file, |path| {
        if path.exists() {
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            match files.of(path) {
                Ok(hash) => *all.entry(name.clone()).or_default() += &hash,
                Err(error) => read = Err(error),
            }
            *path = name.into();
        }
    });
    read?;
    add_values(&file::format(&file)?, &mut all);
    Ok(all)
}

/// Adds the values of a TOML file as it is written here: a key a line, entries of lists of tables numbered from 1.
fn add_values(text: &str, all: &mut BTreeMap<String, String>) {
    let (mut table, mut entries) = (String::new(), BTreeMap::<&str, usize>::new());
    for line in text.lines() {
        match (line.split_once('='), line.strip_prefix("[[").and_then(|line| line.strip_suffix("]]"))) {
            (Some((key, value)), _) => drop(all.insert(format!("{table}{}", key.trim()), value.trim().to_owned())),
            (None, Some(list)) => {
                let number = entries.entry(list).or_default();
                *number += 1;
                table = format!("{list} {number}.");
            }
            (None, None) if line.starts_with('[') => table = format!("{}.", line.trim_matches(['[', ']'])),
            (None, None) => *all.entry(table.clone()).or_default() += line.trim(),
        }
    }
}

/// Names of what differs.
pub fn changes(before: &BTreeMap<String, String>, now: &BTreeMap<String, String>) -> Vec<String> {
    let names: BTreeSet<&String> = before.keys().chain(now.keys()).collect();
    names.into_iter().filter(|name| before.get(*name) != now.get(*name)).cloned().collect()
}

/// Where a row is written down.
fn path(folder: &Path, stem: &str) -> PathBuf {
    folder.join(format!("{stem}.result.json"))
}

/// A row that was made before; none where there is none, or none that this program can read.
pub fn load(folder: &Path, stem: &str) -> Option<Row> {
    let text = fs::read_to_string(path(folder, stem)).ok()?;
    serde_json::from_str(&text).ok()
}

/// Takes back that a row was made, before its video is replaced.
///
/// # Errors
/// A folder that cannot be written to.
pub fn forget(folder: &Path, stem: &str) -> Result<()> {
    let path = path(folder, stem);
    match fs::remove_file(&path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io(&path, "replace", e)),
        _ => Ok(()),
    }
}

/// Writes a row down.
///
/// # Errors
/// A folder that cannot be written to.
pub fn save(row: &Row, folder: &Path, stem: &str) -> Result<()> {
    let text = serde_json::to_string_pretty(row).map_err(|e| Error::new(Kind::Data, "result", e.to_string()))?;
    atomic_file::write(&path(folder, stem), text.as_bytes())
}

/// A hash of a file's content, or of a folder's files and their names.
fn fingerprint(path: &Path) -> Result<String> {
    let mut hasher = blake3::Hasher::new();
    feed(path, &mut hasher)?;
    Ok(hasher.finalize().to_hex()[..LETTERS].to_owned())
}

fn feed(path: &Path, hasher: &mut blake3::Hasher) -> Result<()> {
    let failed = |e| Error::io(path, "read", e);
    if !path.is_dir() {
        return feed_file(path, hasher).map_err(failed);
    }
    let entries = fs::read_dir(path).map_err(failed)?;
    let mut entries =
        entries.map(|entry| entry.map(|entry| entry.path())).collect::<std::io::Result<Vec<_>>>().map_err(failed)?;
    entries.sort();
    for entry in entries {
        hasher.update(entry.file_name().unwrap_or_default().as_encoded_bytes());
        feed(&entry, hasher)?;
    }
    Ok(())
}

fn feed_file(path: &Path, hasher: &mut blake3::Hasher) -> std::io::Result<()> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    hasher.update(&length.to_le_bytes());
    hasher.update_reader((&mut file).take(PART))?;
    if length > 2 * PART {
        file.seek(SeekFrom::End(-(PART as i64)))?;
    }
    hasher.update_reader(file)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_change_of_content_shows() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a");
        fs::write(&file, "one").unwrap();
        let before = (fingerprint(&file).unwrap(), fingerprint(folder.path()).unwrap());
        fs::write(&file, "two").unwrap();
        assert_ne!(before.0, fingerprint(&file).unwrap());
        assert_ne!(before.1, fingerprint(folder.path()).unwrap());
        fs::write(&file, "one").unwrap();
        assert_eq!(before, (fingerprint(&file).unwrap(), fingerprint(folder.path()).unwrap()));
        let large = |last: u8| {
            let file = File::create(&file).unwrap();
            file.set_len(5 * PART).unwrap();
            drop(file);
            let mut file = fs::OpenOptions::new().write(true).open(folder.path().join("a")).unwrap();
            file.seek(SeekFrom::End(-1)).unwrap();
            std::io::Write::write_all(&mut file, &[last]).unwrap();
            fingerprint(&folder.path().join("a")).unwrap()
        };
        assert_ne!(large(1), large(2));
    }

    #[test]
    fn every_entry_of_a_list_counts() {
        let values = |first: &str| {
            let mut all = BTreeMap::new();
            let text =
                format!("a = 1\n[[exemplars]]\nopacity = '{first}'\n[[exemplars]]\nopacity = 'c'\n[output]\nb = 2");
            add_values(&text, &mut all);
            all
        };
        let all = values("b");
        let keys: Vec<&str> = all.keys().map(String::as_str).collect();
        assert_eq!(keys, ["a", "exemplars 1.opacity", "exemplars 2.opacity", "output.b"]);
        assert_eq!(changes(&all, &values("d")), ["exemplars 1.opacity"]);
    }

    #[test]
    fn what_changed_is_named() {
        let map = |pairs: &[(&str, &str)]| pairs.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        let (a, b) = (map(&[("x", "1"), ("y", "1")]), map(&[("x", "2"), ("z", "1")]));
        assert_eq!(changes(&a, &b), ["x", "y", "z"]);
        assert!(changes(&a, &a).is_empty());
    }
}
