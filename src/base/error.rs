//! The one error type of the crate.
//!
//! An error is one sentence a person can act on: what (the *subject*, usually a file), what is wrong with it (the
//! *problem*), what would be allowed, and how to mend it (the *remedy*).

use std::fmt;
use std::path::Path;

/// Result with the crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What sort of failure an [`Error`] is; the exit code follows from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The command line, a scene file or an option is wrong (exit code 2).
    Usage,
    /// A file does not exist, cannot be read or cannot be written.
    Io,
    /// A file was read, and what it holds is damaged or not what its name promises.
    Data,
    /// A file is sound, but of a sort this build cannot read (codec, newer version).
    Unsupported,
    /// An input is sound but cannot be used for what was asked (too small, all black, no candidates…).
    Unusable,
    /// The user interrupted the run (exit code 130).
    Interrupted,
    /// A limit was reached: memory, disk, size.
    Limit,
}

/// One clear sentence: subject, problem, allowed range, remedy.
#[derive(Debug)]
pub struct Error {
    kind: Kind,
    subject: String,
    problem: String,
    allowed: Option<String>,
    remedy: Option<String>,
    source: Option<Box<dyn std::error::Error + Send + Sync>>,
}

impl Error {
    /// An error about `subject` (a file, an option) with the `problem` in a few words.
    pub fn new(kind: Kind, subject: impl fmt::Display, problem: impl Into<String>) -> Self {
        Self { kind, subject: subject.to_string(), problem: problem.into(), allowed: None, remedy: None, source: None }
    }

    /// An error about a file.
    pub fn file(kind: Kind, path: &Path, problem: impl Into<String>) -> Self {
        Self::new(kind, path.display(), problem)
    }

    /// A file operation that the system refused.
    pub fn io(path: &Path, action: &str, source: std::io::Error) -> Self {
        use std::io::ErrorKind;
        let (why, remedy) = match source.kind() {
            ErrorKind::NotFound => ("there is no such file or folder", "check the name"),
            ErrorKind::NotADirectory => ("a part of its path is a file, not a folder", "choose another place"),
            ErrorKind::AlreadyExists => ("a file of that name is in the way", "choose another name"),
            ErrorKind::PermissionDenied => ("permission denied", "check the permissions, or choose another place"),
            ErrorKind::StorageFull => ("no space left", "free some space on that disk, or write elsewhere"),
            _ => return Self::file(Kind::Io, path, format!("cannot {action}: {source}")).source(source),
        };
        let kind = if source.kind() == ErrorKind::StorageFull { Kind::Limit } else { Kind::Io };
        Self::file(kind, path, format!("cannot {action}: {why}")).remedy(remedy).source(source)
    }

    /// The run was interrupted by the user.
    pub fn interrupted() -> Self {
        Self::new(Kind::Interrupted, "interrupted", "nothing was left half-written")
    }

    /// Adds what would have been allowed.
    pub fn allowed(mut self, allowed: impl Into<String>) -> Self {
        self.allowed = Some(allowed.into());
        self
    }

    /// Adds what the user can do.
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = Some(remedy.into());
        self
    }

    /// Says what the error is about by another name, one that the user knows.
    pub fn about(mut self, subject: impl fmt::Display) -> Self {
        self.subject = subject.to_string();
        self
    }

    /// Says which file holds what the error is about.
    pub fn within(mut self, path: &Path) -> Self {
        self.subject = format!("{}: {}", path.display(), self.subject);
        self
    }

    /// Adds the underlying cause.
    pub fn source(mut self, source: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Self {
        self.source = Some(source.into());
        self
    }

    /// The sort of failure.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// What the error is about.
    pub fn subject(&self) -> &str {
        &self.subject
    }

    /// What is wrong, without the subject.
    pub fn problem(&self) -> &str {
        &self.problem
    }

    /// Process exit code: 1 failed, 2 bad usage, 130 interrupted.
    pub fn exit_code(&self) -> u8 {
        match self.kind {
            Kind::Usage => 2,
            Kind::Interrupted => 130,
            _ => 1,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.subject, self.problem)?;
        if let Some(allowed) = &self.allowed {
            write!(f, " (allowed: {allowed})")?;
        }
        if let Some(remedy) = &self.remedy {
            write!(f, "; {remedy}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.source.as_deref().map(|source| source as &(dyn std::error::Error + 'static))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_as_one_sentence() {
        let error =
            Error::new(Kind::Usage, "--frames", "0 frames asked").allowed("1 to 100000").remedy("give --frames 120");
        assert_eq!(error.to_string(), "--frames: 0 frames asked (allowed: 1 to 100000); give --frames 120");
        assert_eq!(error.exit_code(), 2);
    }

    #[test]
    fn a_full_disk_is_a_limit_with_a_remedy() {
        let error = Error::io(Path::new("a.pack"), "write", std::io::ErrorKind::StorageFull.into());
        assert_eq!(error.kind(), Kind::Limit);
        assert!(error.to_string().contains("free some space"));
    }
}
