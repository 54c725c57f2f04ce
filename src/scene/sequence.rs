//! A folder of numbered files, one a frame.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::base::error::{Error, Kind, Result};

/// The files of a folder, frame by frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sequence {
    /// The folder.
    pub folder: PathBuf,
    /// Number of the first frame, as its file is named.
    pub first: u64,
    /// The frames' files; each has the number after that of the one before.
    pub files: Vec<PathBuf>,
}

impl Sequence {
    /// Lists the files with one of the `extensions` (lower case) of a folder. A file's number is the last run of digits
    /// in its name without extension; files of other kinds, and hidden ones, are left out.
    ///
    /// # Errors
    /// A folder that cannot be read or has no such file; files of several kinds; a name without a number; two files with
    /// one number; a number that is missing between others.
    pub fn list(folder: &Path, extensions: &[&str]) -> Result<Self> {
        let mut numbered = BTreeMap::new();
        let mut kind: Option<(String, PathBuf)> = None;
        for (path, extension) in files(folder, extensions)? {
            let (first, of) = kind.get_or_insert_with(|| (extension.clone(), path.clone()));
            if *first != extension {
                let problem = format!("holds both .{first} and .{extension}: {} and {}", name(of), name(&path));
                return Err(Error::file(Kind::Usage, folder, problem).remedy("keep one sort of file for all frames"));
            }
            let number = number(&path)?;
            if let Some(other) = numbered.insert(number, path.clone()) {
                let problem = format!("two files are frame {number}: {} and {}", name(&other), name(&path));
                return Err(Error::file(Kind::Usage, folder, problem).remedy("keep one of them"));
            }
        }
        let Some((&first, _)) = numbered.first_key_value() else {
            let kinds = extensions.iter().map(|e| format!(".{e}")).collect::<Vec<_>>().join(", ");
            return Err(Error::file(Kind::Usage, folder, "has no frames in it")
                .allowed(format!("a file a frame with its number in its name: {kinds}")));
        };
        if let Some((missing, _)) = (first..).zip(numbered.keys()).find(|(wanted, found)| wanted != *found) {
            let last = numbered.keys().next_back().unwrap_or(&first);
            return Err(Error::file(Kind::Usage, folder, format!("frame {missing} is missing"))
                .allowed(format!("every number from {first} to {last}")));
        }
        Ok(Self { folder: folder.to_owned(), first, files: numbered.into_values().collect() })
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.files.len()
    }
}

/// Refuses a frame that has not the `size` of `whole`.
///
/// # Errors
/// The first such frame, by name; what `of` fails with.
pub fn one_size(
    frames: &Sequence,
    size: (usize, usize),
    whole: &str,
    of: impl Fn(&Path) -> Result<(usize, usize)>,
) -> Result<()> {
    frames.files.iter().try_for_each(|path| has_size(path, of(path)?, (size, whole)))
}

/// Refuses a file with another size than that of `whole`.
///
/// # Errors
/// Another size.
pub fn has_size(path: &Path, found: (usize, usize), (size, whole): ((usize, usize), &str)) -> Result<()> {
    if found == size {
        return Ok(());
    }
    Err(Error::file(Kind::Usage, path, format!("is {} × {} pixels", found.0, found.1))
        .allowed(format!("{} × {}, the size of {whole}", size.0, size.1))
        .remedy("bring all frames to one size"))
}

/// Files with one of the extensions, sorted by name, so that an error is the same one every time.
fn files(folder: &Path, extensions: &[&str]) -> Result<Vec<(PathBuf, String)>> {
    let read = |e| Error::io(folder, "read the folder", e);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(read)? {
        let path = entry.map_err(read)?.path();
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        if extensions.contains(&&*extension) && !name(&path).starts_with('.') && path.is_file() {
            found.push((path, extension));
        }
    }
    found.sort();
    Ok(found)
}

/// The last run of digits in a file's name.
fn number(path: &Path) -> Result<u64> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let end = stem.rfind(|c: char| c.is_ascii_digit()).map_or(0, |at| at + 1);
    let start = stem[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| at + 1);
    // Beyond 15 digits it is no frame number; and every number has one after it.
    let digits = stem[..end].get(start..).filter(|digits| digits.len() <= 15);
    digits.and_then(|digits| digits.parse().ok()).ok_or_else(|| {
        Error::file(Kind::Usage, path, "has no frame number in its name").allowed("a name such as 00000 or fire_0017")
    })
}

/// A file's name for messages.
fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        names.iter().for_each(|name| std::fs::write(folder.path().join(name), "").unwrap());
        folder
    }

    #[test]
    fn frames_are_in_the_order_of_their_numbers_wherever_they_start() {
        let folder = folder(&["v2_f9.FLO", "v2_f10.flo", "v2_f8.flo", ".v2_f3.flo", "notes.txt", "v2.png"]);
        let frames = Sequence::list(folder.path(), &["flo", "exr"]).unwrap();
        assert_eq!((frames.first, frames.frames()), (8, 3));
        assert_eq!(frames.files.iter().map(|f| name(f)).collect::<Vec<_>>(), ["v2_f8.flo", "v2_f9.FLO", "v2_f10.flo"]);
    }

    #[test]
    fn what_is_no_sequence_is_named() {
        let refuse = |names: &[&str], words: &[&str]| {
            let folder = folder(names);
            let message = Sequence::list(folder.path(), &["flo", "exr"]).unwrap_err().to_string();
            words.iter().for_each(|word| assert!(message.contains(word), "{message} lacks {word}"));
        };
        refuse(&["a.txt"], &["no frames", ".flo, .exr"]);
        refuse(&["1.flo", "2.exr"], &["both .flo and .exr", "1.flo and 2.exr"]);
        refuse(&["1.flo", "2.flo", "5.flo"], &["frame 3 is missing", "from 1 to 5"]);
        refuse(&["1.flo", "a1.flo"], &["two files are frame 1", "1.flo and a1.flo"]);
        refuse(&["one.flo"], &["one.flo", "no frame number"]);
        refuse(&["12345678901234567890.flo"], &["no frame number"]);
        let gone = Sequence::list(Path::new("/nowhere/at/all"), &["flo"]).unwrap_err().to_string();
        assert!(gone.contains("/nowhere/at/all"), "{gone}");
    }
}
