//! From what the user named to clips: folders expanded, contents identified.

use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use super::piece::ClipId;
use crate::base::error::{Error, Kind, Result};

/// Endings of files taken for clips when a folder is given; files named one by one may have any.
const VIDEO: [&str; 16] =
    ["mp4", "m4v", "mov", "avi", "webm", "mkv", "gif", "apng", "webp", "y4m", "mpg", "mpeg", "wmv", "flv", "ts", "ogv"];
/// Endings of frames.
const PICTURE: [&str; 3] = ["png", "jpg", "jpeg"];
/// What follows the name of a clip in the name of its mask.
const MASK: &str = ".mask.png";
/// Deepest nesting of folders.
const MAX_DEPTH: usize = 16;

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|e| endings.iter().any(|v| e.eq_ignore_ascii_case(v)))
}

fn is_mask(path: &Path) -> bool {
    path.file_name().is_some_and(|n| n.to_string_lossy().to_ascii_lowercase().ends_with(MASK))
}

/// The mask that excludes other moving objects of a clip, if there is one: `NAME.mask.png` beside `NAME.mp4` (white =
/// use).
pub fn mask_of(clip: &Path) -> Option<PathBuf> {
    let stem = if clip.is_dir() { clip.file_name()? } else { clip.file_stem()? };
    let mask = clip.with_file_name(format!("{}{MASK}", stem.to_string_lossy()));
    mask.is_file().then_some(mask)
}

/// Clips named by files and folders, in order. A folder with pictures and no videos is a clip itself; any other folder
/// stands for the clips in it and below, by name.
///
/// # Errors
/// When a path does not exist, a folder cannot be read, or there is no clip at all.
pub fn expand(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut clips = Vec::new();
    for path in paths {
        let metadata = fs::metadata(path).map_err(|e| Error::io(path, "open", e))?;
        if metadata.is_dir() {
            let before = clips.len();
            expand_folder(path, 0, &mut clips)?;
            if clips.len() == before {
                return Err(Error::file(Kind::Unusable, path, "there is no clip in this folder")
                    .allowed(format!("videos ({}) or folders of numbered PNG or JPEG frames", VIDEO.join(", "))));
            }
        } else {
            clips.push(path.clone());
        }
    }
    if clips.is_empty() {
        return Err(Error::new(Kind::Usage, "clips", "none given").remedy("name files or folders of clips"));
    }
    Ok(clips)
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let listed = fs::read_dir(folder).and_then(|list| list.map(|e| e.map(|e| e.path())).collect());
    let mut entries: Vec<PathBuf> = listed.map_err(|e| Error::io(folder, "list", e))?;
    let hidden = |p: &Path| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
    entries.retain(|p| !hidden(p));
    entries.sort();
    Ok(entries)
}

fn expand_folder(folder: &Path, depth: usize, clips: &mut Vec<PathBuf>) -> Result<()> {
    if depth > MAX_DEPTH {
        return Err(Error::file(Kind::Limit, folder, "folders are nested too deeply").allowed(MAX_DEPTH.to_string()));
    }
    let entries = entries(folder)?;
    let (folders, files): (Vec<&PathBuf>, Vec<&PathBuf>) = entries.iter().partition(|p| p.is_dir());
    let videos: Vec<&PathBuf> = files.iter().copied().filter(|p| has_ending(p, &VIDEO)).collect();
    let frames = files.iter().filter(|p| has_ending(p, &PICTURE) && !is_mask(p)).count();
    if videos.is_empty() && frames > 1 {
        clips.push(folder.to_path_buf());
        return Ok(());
    }
    clips.extend(videos.into_iter().cloned());
    folders.into_iter().try_for_each(|f| expand_folder(f, depth + 1, clips))
}

/// BLAKE3 of a file's bytes.
///
/// # Errors
/// When it cannot be read.
pub fn hash_file(path: &Path) -> Result<[u8; 32]> {
    let read = || -> std::io::Result<[u8; 32]> {
        let mut file = File::open(path)?;
        let mut hasher = blake3::Hasher::new();
        let mut buffer = vec![0; 1 << 20];
        loop {
            match file.read(&mut buffer)? {
                0 => return Ok(*hasher.finalize().as_bytes()),
                n => hasher.update(&buffer[..n]),
            };
        }
    };
    read().map_err(|e| Error::io(path, "read", e))
}

/// Identity of a clip: hash of the file's bytes; of a folder, hash of its frames' hashes, by name.
///
/// # Errors
/// When it cannot be read.
pub fn identify(clip: &Path) -> Result<ClipId> {
    if !clip.is_dir() {
        return hash_file(clip).map(ClipId);
    }
    let mut hasher = blake3::Hasher::new();
    for frame in entries(clip)?.iter().filter(|p| has_ending(p, &PICTURE) && !is_mask(p)) {
        hasher.update(&hash_file(frame)?);
    }
    Ok(ClipId(*hasher.finalize().as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_stand_for_their_clips_or_their_frames() {
        let root = tempfile::tempdir().unwrap();
        let put = |name: &str| {
            let path = root.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, name).unwrap();
        };
        let files = ["b.MP4", "a.gif", "b.mask.png", "notes.txt", "cover.png", "deep/er/c.y4m", "frames/1.png"];
        files.iter().chain(&["frames/2.png", ".hidden/x.mp4"]).for_each(|n| put(n));
        let names: Vec<String> = expand(&[root.path().to_path_buf()])
            .unwrap()
            .iter()
            .map(|p| p.strip_prefix(root.path()).unwrap().to_string_lossy().replace('\\', "/"))
            .collect();
        assert_eq!(names, ["a.gif", "b.MP4", "deep/er/c.y4m", "frames"]);
        assert_eq!(mask_of(&root.path().join("b.MP4")), Some(root.path().join("b.mask.png")));
        assert_eq!(mask_of(&root.path().join("a.gif")), None);
        fs::create_dir(root.path().join("empty")).unwrap();
        assert!(expand(&[root.path().join("empty")]).unwrap_err().to_string().contains("no clip"));
        assert_eq!(expand(&[root.path().join("none.mp4")]).unwrap_err().kind(), Kind::Io);
    }

    #[test]
    fn identity_is_content() {
        let root = tempfile::tempdir().unwrap();
        for folder in ["a", "b"] {
            fs::create_dir(root.path().join(folder)).unwrap();
            (0..3).for_each(|i| fs::write(root.path().join(folder).join(format!("{i}.png")), [i]).unwrap());
        }
        let id = |name: &str| identify(&root.path().join(name)).unwrap();
        assert_eq!(id("a"), id("b"));
        fs::write(root.path().join("b/1.png"), [9]).unwrap();
        assert_ne!(id("a"), id("b"));
        assert_eq!(id("a/0.png").0, *blake3::hash(&[0]).as_bytes());
    }
}
