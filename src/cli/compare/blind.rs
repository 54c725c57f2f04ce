//! The blind test's part of the command: what takes part, and votes that come back.

use std::path::{Path, PathBuf};

use super::lock::lock;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::cli::common::say;
use crate::report::comparison::blind::{BlindTest, KEY, Key, PAGE, result, votes, write_page};
use crate::report::comparison::{Comparison, Row, Sort};

/// A bad video that is mixed in to see whether votes mean anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Plant {
    /// The picture held still, where a scene has one
    Frozen,
    /// The first method's frames in an order by chance
    Shuffled,
}

impl Plant {
    fn sort(self) -> Sort {
        match self {
            Self::Frozen => Sort::Frozen,
            Self::Shuffled => Sort::Shuffled,
        }
    }

    /// As the command line has it.
    pub fn word(self) -> &'static str {
        match self {
            Self::Frozen => "frozen",
            Self::Shuffled => "shuffled",
        }
    }
}

/// Makes the page that people vote on: real clips, methods and what is planted.
///
/// # Errors
/// Fewer than two videos of every scene; a folder that cannot be written to.
pub fn make(comparison: &Comparison, folder: &Path, planted: &[Plant], observer: &dyn Observer) -> Result<()> {
    let takes_part = |sort: Sort| !sort.is_bad() || planted.iter().any(|plant| plant.sort() == sort);
    let key = Key::make(comparison, folder, takes_part)?;
    let key = match Key::load(folder)? {
        Some(before) => key.after(before),
        None => key,
    };
    key.write(comparison, folder)?;
    write_page(comparison, &key, folder)?;
    let bad = |row: &Row| row.is_made() && row.sort.is_bad() && takes_part(row.sort);
    for scene in comparison.scenes.iter().filter(|scene| !scene.rows.iter().any(bad)) {
        observer.note(&format!("{}: no bad video takes part in the blind test; --plant shuffled adds one", scene.name));
    }
    observer.note(&format!(
        "{}: for people to vote on; give it away with the folder blind beside it, without blind-key.json",
        folder.join(PAGE).display()
    ));
    Ok(())
}

/// Adds the votes that were read before to the page, where there are any.
///
/// # Errors
/// Votes that cannot be read; a folder that cannot be written to.
pub fn show_votes(comparison: &mut Comparison, folder: &Path) -> Result<()> {
    comparison.blind = result::read(comparison, folder)?;
    if comparison.blind.is_some() { comparison.write(folder) } else { Ok(()) }
}

/// Reads files of votes into the comparison in `folder`, and prints what they say.
///
/// # Errors
/// A folder without a blind test; files that are no votes on it.
pub fn read_votes(files: &[PathBuf], folder: &Path, observer: &dyn Observer) -> Result<()> {
    // Not to leave a lock in just any folder; what counts is read under it.
    Comparison::read(folder)?;
    let _lock = lock(folder)?;
    let mut comparison = Comparison::read(folder)?;
    let key = Key::load(folder)?.ok_or_else(|| {
        Error::file(Kind::Unusable, folder, format!("there is no blind test in this folder ({KEY})"))
            .remedy("run the comparison with --blind")
    })?;
    votes::keep(files, folder, &key, observer)?;
    show_votes(&mut comparison, folder)?;
    if let Some(test) = &comparison.blind {
        say!("{}: blind test, {}", folder.join("index.html").display(), test.summary());
        print(test);
    }
    Ok(())
}

fn print(test: &BlindTest) {
    test.table().iter().for_each(|line| say!("{line}"));
    say!("{}", test.verdict());
    test.remarks().iter().for_each(|line| say!("{line}"));
}
