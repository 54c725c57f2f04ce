//! One comparison at a time in a folder.

use std::fs::{File, TryLockError};
use std::path::Path;

use crate::base::error::{Error, Kind, Result};
use crate::base::own_file;

/// Locked while a comparison writes into its folder.
pub const LOCK: &str = ".lock";

/// The folder's lock, as long as the file lives.
///
/// # Errors
/// Another comparison at work there; a folder that cannot be written to.
pub fn lock(folder: &Path) -> Result<File> {
    let path = folder.join(LOCK);
    if !path.exists() {
        own_file::write(&path, b"A comparison locks this file while it is at work here.\n")?;
    }
    let file = File::open(&path).map_err(|e| Error::io(&path, "open", e))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(Error::file(Kind::Usage, folder, "another comparison is at work here")
            .remedy("wait until it has ended, or name another folder with -o")),
        Err(TryLockError::Error(e)) => Err(Error::io(&path, "lock", e)),
    }
}
