//! Pictures for debugging, written to a folder as the work goes on.

use std::path::PathBuf;
use std::sync::Mutex;

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::raster::image::Rgb8;
use crate::raster::picture_io::write_png;

/// Writes every picture for debugging that it is handed, `frame-00012/level-0-field.png`; the work stops when one cannot be
/// written.
pub struct DebugPictures<'a> {
    inner: &'a dyn Observer,
    folder: PathBuf,
    written: Mutex<Result<usize>>,
}

impl<'a> DebugPictures<'a> {
    /// Into `folder`, which is made; all else goes to `inner`.
    ///
    /// # Errors
    /// A folder that cannot be made.
    pub fn new(inner: &'a dyn Observer, folder: PathBuf) -> Result<Self> {
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "make the folder", e))?;
        let frames = std::fs::read_dir(&folder).map_err(|e| Error::io(&folder, "list", e))?;
        if frames.flatten().any(|entry| entry.file_name().to_string_lossy().starts_with("frame-")) {
            return Err(Error::file(Kind::Usage, &folder, "holds frames of an earlier run")
                .remedy("remove it, or name another folder with --debug"));
        }
        Ok(Self { inner, folder, written: Mutex::new(Ok(0)) })
    }

    /// The result of the work; says how many pictures were written where it is good.
    ///
    /// # Errors
    /// That of the first picture that could not be written; those of the work.
    pub fn finish<T>(self, result: Result<T>) -> Result<T> {
        let written = self.written.into_inner().unwrap_or(Ok(0))?;
        let result = result?;
        let folder = self.folder.display();
        self.inner.note(&match written {
            0 => format!("{folder}: no pictures: only methods that match patches make any"),
            count => format!("{folder}: {count} pictures of fields, usage and channels"),
        });
        Ok(result)
    }
}

impl Observer for DebugPictures<'_> {
    fn inner(&self) -> Option<&dyn Observer> {
        Some(self.inner)
    }

    fn wants_pictures(&self) -> bool {
        true
    }

    fn picture(&self, name: &str, (width, height): (usize, usize), rgb: &[u8]) {
        let path = self.folder.join(format!("{}.png", name.replace(' ', "-")));
        let parent = path.parent().unwrap_or(&self.folder);
        let done = std::fs::create_dir_all(parent)
            .map_err(|e| Error::io(parent, "make the folder", e))
            .and_then(|()| write_png(&path, &Rgb8 { width, height, data: rgb.to_vec() }));
        if let Ok(mut written) = self.written.lock()
            && let Ok(count) = &mut *written
        {
            match done {
                Ok(()) => *count += 1,
                Err(error) => *written = Err(error),
            }
        }
    }

    fn cancelled(&self) -> bool {
        self.inner.cancelled() || self.written.lock().is_ok_and(|written| written.is_err())
    }
}
