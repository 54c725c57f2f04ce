//! Files that the program writes without being asked for each by name, and knows again by a mark.
//!
//! What a person made, or changed, is never replaced. So the mark holds a hash of all that follows it: a file that was
//! edited is a person's from then on. The mark is the first line of TOML, the first key of JSON, a comment at the start of
//! a page, and the first text of a PNG.

use std::path::{Path, PathBuf};

use super::atomic_file;
use super::error::{Error, Kind, Result};

/// What stands before the hash.
const MARK: &str = "Written by enliven, ";
/// Hexadecimal digits of the hash.
const DIGITS: usize = 16;
/// Where the mark is looked for, bytes from the start.
const HEAD: usize = 512;
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Signature and header of a PNG, after which its text may stand.
const PNG_HEAD: usize = 33;
/// Bytes of a checksum in a PNG.
const CHECKSUM: usize = 4;

/// Writes a file of the program's own, marked as such.
///
/// # Errors
/// A file of that name that a person made or changed; those of [`atomic_file::write`].
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    check(path)?;
    atomic_file::write(path, &marked(bytes))
}

/// Checks that [`write`] would not replace what a person made.
///
/// # Errors
/// A file of that name without the program's mark, or changed since it got it.
pub fn check(path: &Path) -> Result<()> {
    if is_free(path) {
        return Ok(());
    }
    Err(Error::file(Kind::Usage, path, "was not written by enliven, or was changed since, and is not written over")
        .remedy("move it away, or write to another place"))
}

/// Whether [`write`] may write there: nothing is there, or a file of the program's own.
pub fn is_free(path: &Path) -> bool {
    path.symlink_metadata().is_err() || is_own(path)
}

/// Whether the program wrote a file and nobody has changed it since.
pub fn is_own(path: &Path) -> bool {
    path.is_file() && std::fs::read(path).is_ok_and(|bytes| is_marked(&bytes))
}

/// The bytes of a file with the program's mark in them.
pub fn marked(bytes: &[u8]) -> Vec<u8> {
    if bytes.starts_with(PNG) && bytes.len() >= PNG_HEAD {
        return marked_png(bytes);
    }
    let (before, after, rest): (&str, &str, &[u8]) = if let Some(rest) = bytes.strip_prefix(b"{") {
        ("{\n  \"mark\": \"", "\",\n", rest.strip_prefix(b"\n").unwrap_or(rest))
    } else if let Some(rest) = bytes.strip_prefix(b"<!DOCTYPE html>") {
        ("<!DOCTYPE html><!-- ", " -->", rest)
    } else {
        ("# ", ": a later run may replace this file as long as nobody changes it.\n", bytes)
    };
    let rest = [after.as_bytes(), rest].concat();
    [before.as_bytes(), MARK.as_bytes(), digits(&rest).as_bytes(), &rest].concat()
}

fn marked_png(bytes: &[u8]) -> Vec<u8> {
    let (head, rest) = bytes.split_at(PNG_HEAD);
    let text = format!("tEXtSoftware\0{MARK}{}", digits(rest));
    let length = (text.len() - 4) as u32;
    let checksum = crc32fast::hash(text.as_bytes());
    [head, &length.to_be_bytes(), text.as_bytes(), &checksum.to_be_bytes(), rest].concat()
}

fn is_marked(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(HEAD)];
    let Some(at) = head.windows(MARK.len()).position(|part| part == MARK.as_bytes()) else { return false };
    let Some((hash, rest)) = bytes[at + MARK.len()..].split_at_checked(DIGITS) else { return false };
    let skipped = if bytes.starts_with(PNG) { CHECKSUM } else { 0 };
    rest.get(skipped..).is_some_and(|rest| digits(rest).as_bytes() == hash)
}

fn digits(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex()[..DIGITS].to_owned()
}

/// The files and folders that a run reads, which nothing that it writes may replace. They are known by whatever name:
/// through links, `./a` for `a`, or another case where the disk does not tell cases apart.
#[derive(Debug, Clone, Default)]
pub struct Inputs(Vec<Input>);

#[derive(Debug, Clone)]
struct Input {
    named: PathBuf,
    real: PathBuf,
    number: Option<(u64, u64)>,
}

impl Inputs {
    /// Those of `paths` that exist.
    pub fn new(paths: impl IntoIterator<Item = PathBuf>) -> Self {
        let input = |named: PathBuf| {
            let real = named.canonicalize().ok()?;
            Some(Input { number: number(&real), named, real })
        };
        Self(paths.into_iter().filter_map(input).collect())
    }

    /// The input that `path` is, or lies in.
    pub fn holding(&self, path: &Path) -> Option<&Path> {
        let real = path.canonicalize().ok()?;
        let number = number(&real);
        let is = |input: &&Input| real.starts_with(&input.real) || (number.is_some() && number == input.number);
        self.0.iter().find(is).map(|input| &*input.named)
    }

    /// An input that lies in a folder, or is the folder.
    pub fn within(&self, folder: &Path) -> Option<&Path> {
        let real = folder.canonicalize().ok()?;
        self.0.iter().find(|input| input.real.starts_with(&real)).map(|input| &*input.named)
    }

    /// Refuses to write a file that is an input of `this`, such as "video"; or a folder that is, holds, or lies in one.
    ///
    /// # Errors
    /// When it is one of them; `remedy` says what to do.
    pub fn refuse(&self, written: &Path, this: &str, remedy: &str) -> Result<()> {
        match self.holding(written).or_else(|| self.within(written)) {
            Some(input) => {
                let problem = format!("is read for this {this} and would be written over");
                Err(Error::file(Kind::Usage, input, problem).remedy(remedy))
            }
            None => Ok(()),
        }
    }

    /// The first of `names` under which a file of the program's own may be written.
    pub fn free(&self, mut names: impl Iterator<Item = PathBuf>) -> Option<PathBuf> {
        names.find(|path| is_free(path) && self.holding(path).is_none())
    }
}

/// What the disk knows a file by, whatever its names.
#[cfg(unix)]
fn number(path: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    path.metadata().ok().map(|found| (found.dev(), found.ino()))
}

#[cfg(not(unix))]
fn number(_: &Path) -> Option<(u64, u64)> {
    None
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn png() -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut writer = png::Encoder::new(&mut bytes, 6, 3).write_header().unwrap();
        writer.write_image_data(&(0..18).collect::<Vec<u8>>()).unwrap();
        writer.finish().unwrap();
        bytes
    }

    #[test]
    fn own_files_are_known_until_they_are_changed() {
        let folder = tempfile::tempdir().unwrap();
        let png = png();
        let files: [(&str, &[u8]); 4] = [
            ("a.toml", b"picture = 'a.png'\n"),
            ("a.json", b"{\n  \"frames\": 3\n}"),
            ("a.html", b"<!DOCTYPE html><html></html>"),
            ("a.png", &png),
        ];
        for (name, bytes) in files {
            let path = folder.path().join(name);
            write(&path, bytes).unwrap();
            write(&path, bytes).unwrap();
            assert!(is_own(&path), "{name}");
            let mut changed = fs::read(&path).unwrap();
            let last = changed.len() - 1;
            changed[last] ^= 1;
            fs::write(&path, &changed).unwrap();
            let error = write(&path, bytes).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("was changed since"), "{error}");
            assert_eq!(fs::read(&path).unwrap(), changed);
            fs::write(&path, bytes).unwrap();
            assert!(write(&path, b"x").is_err() && !is_own(&path), "{name}");
        }
        let path = folder.path().join("b.png");
        write(&path, &png).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(fs::read(&path).unwrap())).read_info().unwrap();
        let mut pixels = [0; 18];
        reader.next_frame(&mut pixels).unwrap();
        assert!((0..18).eq(pixels) && reader.info().uncompressed_latin1_text[0].text.starts_with(MARK));
        let json: serde_json::Value = serde_json::from_slice(&marked(files[1].1)).unwrap();
        assert_eq!(json["frames"], 3);
        assert!(!is_own(&folder.path().join("none")) && is_free(&folder.path().join("none")));
    }

    #[cfg(unix)]
    #[test]
    fn inputs_are_known_by_any_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("frames")).unwrap();
        ["a.png", "frames/0.png", "b.png"].iter().for_each(|name| fs::write(at(name), name).unwrap());
        std::os::unix::fs::symlink(at("a.png"), at("link")).unwrap();
        std::os::unix::fs::symlink(folder.path(), at("round")).unwrap();
        fs::hard_link(at("a.png"), at("twin")).unwrap();
        let inputs = Inputs::new([at("a.png"), at("frames"), at("missing")]);
        for name in ["a.png", "frames/../a.png", "link", "twin", "round/a.png", "frames", "frames/0.png", "frames/"] {
            assert!(inputs.refuse(&at(name), "run", "no").is_err(), "{name}");
        }
        for name in ["b.png", "c", "missing", "frames/1.png"] {
            inputs.refuse(&at(name), "run", "no").unwrap();
        }
        assert!(inputs.within(&at("round")).is_some() && inputs.holding(folder.path()).is_none());
        let names = ["a.png", "b.png", "d.png"].map(at);
        assert_eq!(inputs.free(names.into_iter()), Some(at("d.png")));
    }
}
