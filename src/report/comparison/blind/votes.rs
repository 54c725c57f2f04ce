//! Files of votes: checked, kept in the comparison's folder, read again.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::Value;

use super::findings::Choice;
use super::key::{self, Key};
use crate::base::atomic_file;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::text::counted;

/// What a file of votes says it is.
pub const FORMAT: &str = "enliven votes 1";
/// Folder that votes are kept in, within the comparison's.
pub const FOLDER: &str = "votes";
/// Largest file that is read: a hundred thousand votes.
const BYTES: u64 = 1 << 24;
/// Longest name of a voter, in characters.
const NAME: usize = 200;

/// One choice between two videos.
#[derive(Debug, Clone, PartialEq)]
pub struct Vote {
    /// Name of the left video.
    pub left: String,
    /// Name of the right video.
    pub right: String,
    /// What was chosen.
    pub choice: Choice,
    /// Seconds from when the pair was shown.
    pub seconds: f64,
}

/// A file of votes: what one person chose in one sitting, in that order.
#[derive(Debug, Clone, PartialEq)]
pub struct Ballot {
    /// Fingerprint of the comparison, [`Key::comparison`].
    pub comparison: String,
    /// Name of the sitting, also the seed of its random order.
    pub session: String,
    /// Who voted; may be empty.
    pub voter: String,
    /// When the file was saved, in UTC, as ISO 8601.
    pub saved: String,
    /// The votes.
    pub votes: Vec<Vote>,
}

/// The file as it is written, before anything in it is believed.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    #[serde(rename = "format")]
    _format: String,
    comparison: String,
    session: String,
    voter: String,
    saved: String,
    votes: Vec<WrittenVote>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenVote {
    left: String,
    right: String,
    choice: String,
    seconds: f64,
}

impl Ballot {
    /// Checks that the content of a file of votes belongs to the comparison of `key`.
    ///
    /// # Errors
    /// A file that is no such file, or of another comparison, or holds no votes or votes on videos that are not its.
    fn parse(bytes: &[u8], path: &Path, key: &Key) -> Result<Self> {
        let value: Value = serde_json::from_slice(bytes).map_err(|e| bad(path, format!("is not JSON: {e}")))?;
        match value.get("format").and_then(Value::as_str) {
            Some(FORMAT) => {}
            Some(other) => return Err(bad(path, format!("its format is {other:?}")).allowed(format!("{FORMAT:?}"))),
            None => return Err(bad(path, "does not say \"format\"").allowed(format!("{FORMAT:?}"))),
        }
        let written: Written =
            serde_json::from_value(value).map_err(|e| bad(path, format!("cannot be read as votes: {e}")))?;
        written.check(path, key)
    }
}

impl Written {
    fn check(self, path: &Path, key: &Key) -> Result<Ballot> {
        let Self { comparison, session, voter, saved, votes, .. } = self;
        if !key.knows_comparison(&comparison) {
            return Err(Error::file(
                Kind::Unusable,
                path,
                format!("its votes are on another comparison, {comparison:?}"),
            )
            .allowed(format!("{:?}", key.comparison))
            .remedy("name the folder of that comparison with -o"));
        }
        if !key::is_name(&session) {
            return Err(bad(path, format!("its session is {session:?}")).allowed("16 letters of 0 to 9 and a to f"));
        }
        if voter.chars().count() > NAME {
            return Err(bad(path, "its voter's name is too long").allowed(format!("at most {NAME} characters")));
        }
        if !is_time(&saved) {
            return Err(bad(path, format!("its time is {saved:?}")).allowed("a time such as 2025-01-31T12:00:00Z"));
        }
        if votes.is_empty() {
            return Err(Error::file(Kind::Unusable, path, "holds no vote"));
        }
        let check = |(i, vote): (usize, WrittenVote)| vote.check(i + 1, path, key);
        let votes = votes.into_iter().enumerate().map(check).collect::<Result<_>>()?;
        Ok(Ballot { comparison, session, voter, saved, votes })
    }
}

impl WrittenVote {
    fn check(self, number: usize, path: &Path, key: &Key) -> Result<Vote> {
        let Self { left, right, choice, seconds } = self;
        let bad = |problem: String| bad(path, format!("vote {number}: {problem}"));
        if let Some(unknown) = [&left, &right].into_iter().find(|id| key.named(id).is_none()) {
            return Err(bad(format!("no video {unknown:?} is in this comparison")));
        }
        let scene = |id: &str| key.named(id).map(|named| &named.scene);
        if left == right || scene(&left) != scene(&right) {
            return Err(
                bad(format!("{left:?} and {right:?} are never shown together")).allowed("two videos of one scene")
            );
        }
        let Some(&(_, choice)) = Choice::ALL.iter().find(|(word, _)| *word == choice) else {
            return Err(bad(format!("its choice is {choice:?}")).allowed("left, tie, right"));
        };
        if seconds < 0.0 {
            return Err(bad(format!("it took {seconds} seconds")).allowed("0 and more"));
        }
        Ok(Vote { left, right, choice, seconds })
    }
}

fn read(path: &Path) -> Result<Vec<u8>> {
    let length = fs::metadata(path).map_err(|e| Error::io(path, "open", e))?.len();
    if length > BYTES {
        let problem = format!("it is too large for votes, {length} bytes");
        return Err(bad(path, problem).allowed(format!("at most {BYTES}")));
    }
    fs::read(path).map_err(|e| Error::io(path, "read", e))
}

fn bad(path: &Path, problem: impl Into<String>) -> Error {
    Error::file(Kind::Data, path, problem).remedy("name a file that the page of the blind test saved")
}

/// Whether a text is like `2025-01-31T12:00:00Z`, so that later ones come later in the alphabet.
fn is_time(text: &str) -> bool {
    let like = |(c, pattern): (char, char)| if pattern == '0' { c.is_ascii_digit() } else { c == pattern };
    let pattern = "0000-00-00T00:00:00Z";
    text.len() == pattern.len() && text.chars().zip(pattern.chars()).all(like)
}

/// Reads files of votes and keeps them below `folder`. A sitting counts once: of two files of it, the one that was saved
/// later; what is left out is told.
///
/// # Errors
/// A file that is no such file, or of another comparison, or holds no votes or votes on videos that are not its, before
/// anything is kept; a folder that cannot be written to.
pub fn keep(files: &[PathBuf], folder: &Path, key: &Key, observer: &dyn Observer) -> Result<()> {
    let contents = files.iter().map(|path| read(path)).collect::<Result<Vec<_>>>()?;
    let parse = |(bytes, path): (&Vec<u8>, &PathBuf)| Ballot::parse(bytes, path, key);
    let ballots = contents.iter().zip(files).map(parse).collect::<Result<Vec<_>>>()?;
    let below = folder.join(FOLDER);
    fs::create_dir_all(&below).map_err(|e| Error::io(&below, "make the folder", e))?;
    let mut latest = kept(folder, key)?;
    for ((path, bytes), ballot) in files.iter().zip(&contents).zip(ballots) {
        let called = path.display();
        match latest.get(&ballot.session) {
            Some(before) if before.saved >= ballot.saved => {
                observer.note(&format!("{called}: these votes are counted already, by session {}", ballot.session));
                continue;
            }
            Some(_) => observer.note(&format!("{called}: takes the place of what this session saved before")),
            None => observer.note(&format!("{called}: {}", counted(ballot.votes.len() as u64, "vote"))),
        }
        atomic_file::write(&below.join(format!("{}.json", ballot.session)), bytes)?;
        latest.insert(ballot.session.clone(), ballot);
    }
    Ok(())
}

/// The votes that were kept, by session.
///
/// # Errors
/// A file among them that is not sound.
pub fn kept(folder: &Path, key: &Key) -> Result<BTreeMap<String, Ballot>> {
    let below = folder.join(FOLDER);
    if !below.exists() {
        return Ok(BTreeMap::new());
    }
    let failed = |e| Error::io(&below, "read", e);
    let entries = fs::read_dir(&below).map_err(failed)?;
    let paths =
        entries.map(|entry| entry.map(|entry| entry.path())).collect::<std::io::Result<Vec<_>>>().map_err(failed)?;
    let votes = paths.iter().filter(|path| path.extension().is_some_and(|end| end == "json"));
    let ballot = |path: &PathBuf| {
        let ballot = Ballot::parse(&read(path)?, path, key)?;
        Ok((ballot.session.clone(), ballot))
    };
    votes.map(ballot).collect()
}
