//! Progress, cancellation, notes and timings of long work, through one trait.

use std::collections::BTreeSet;
use std::sync::Mutex;
use std::time::Instant;

use super::error::{Error, Result};

/// Listens to a long piece of work. What an observer does not take itself goes to the one it names as `inner`; without one
/// it is ignored.
pub trait Observer: Sync {
    /// Who hears what this one does not take itself.
    fn inner(&self) -> Option<&dyn Observer> {
        None
    }
    /// A stage begins that has `total` steps (0 when unknown).
    fn begin(&self, stage: &str, total: u64) {
        if let Some(inner) = self.inner() {
            inner.begin(stage, total);
        }
    }
    /// `steps` more steps of `stage` are done.
    fn advance(&self, stage: &str, steps: u64) {
        if let Some(inner) = self.inner() {
            inner.advance(stage, steps);
        }
    }
    /// A stage is over after `seconds`.
    fn end(&self, stage: &str, seconds: f64) {
        if let Some(inner) = self.inner() {
            inner.end(stage, seconds);
        }
    }
    /// Something the user should read: a warning, a fallback, a refusal.
    fn note(&self, message: &str) {
        if let Some(inner) = self.inner() {
            inner.note(message);
        }
    }
    /// Whether [`Observer::picture`] is of use; pictures for debugging cost time to make.
    fn wants_pictures(&self) -> bool {
        self.inner().is_some_and(|inner| inner.wants_pictures())
    }
    /// A picture for debugging: its name (a slash after every part of the work that it belongs to), width and height, and
    /// packed sRGB bytes.
    fn picture(&self, name: &str, size: (usize, usize), rgb: &[u8]) {
        if let Some(inner) = self.inner() {
            inner.picture(name, size, rgb);
        }
    }
    /// True once the user asked to stop.
    fn cancelled(&self) -> bool {
        self.inner().is_some_and(|inner| inner.cancelled())
    }
}

/// An observer that ignores everything.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Observer for Silent {}

/// Passes everything on to another observer, each note once.
pub struct Once<'a> {
    inner: &'a dyn Observer,
    said: Mutex<BTreeSet<String>>,
}

impl<'a> Once<'a> {
    /// Around `inner`.
    pub fn new(inner: &'a dyn Observer) -> Self {
        Self { inner, said: Mutex::default() }
    }
}

impl Observer for Once<'_> {
    fn inner(&self) -> Option<&dyn Observer> {
        Some(self.inner)
    }
    fn note(&self, message: &str) {
        if self.said.lock().is_ok_and(|mut said| said.insert(message.to_owned())) {
            self.inner.note(message);
        }
    }
}

/// Puts the name of a part of the work and a slash before those of its pictures for debugging.
pub struct Part<'a> {
    inner: &'a dyn Observer,
    name: String,
}

impl<'a> Part<'a> {
    /// Around `inner`.
    pub fn new(inner: &'a dyn Observer, name: String) -> Self {
        Self { inner, name }
    }
}

impl Observer for Part<'_> {
    fn inner(&self) -> Option<&dyn Observer> {
        Some(self.inner)
    }
    fn picture(&self, name: &str, size: (usize, usize), rgb: &[u8]) {
        self.inner.picture(&format!("{}/{name}", self.name), size, rgb);
    }
}

/// An error when the user asked to stop; call it once per step of long work.
///
/// # Errors
/// [`super::error::Kind::Interrupted`] after a cancel.
pub fn check(observer: &dyn Observer) -> Result<()> {
    if observer.cancelled() { Err(Error::interrupted()) } else { Ok(()) }
}

/// Runs `work` as a stage: begin, work, end with its time.
///
/// # Errors
/// Those of `work`.
pub fn stage<T>(observer: &dyn Observer, name: &str, total: u64, work: impl FnOnce() -> Result<T>) -> Result<T> {
    observer.begin(name, total);
    let start = Instant::now();
    let result = work();
    observer.end(name, start.elapsed().as_secs_f64());
    result
}

#[cfg(test)]
pub mod testing {
    //! An observer for tests.

    use std::sync::Mutex;

    use super::Observer;

    /// Keeps all notes.
    #[derive(Default)]
    pub struct Notes(pub Mutex<Vec<String>>);

    impl Observer for Notes {
        fn note(&self, message: &str) {
            self.0.lock().unwrap().push(message.to_owned());
        }
    }
}
