//! What a blind test found.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::measure::preference::Estimate;
use crate::report::comparison::sort::Sort;

/// What people chose who did not know which video was which.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct BlindTest {
    /// People who voted.
    pub voters: usize,
    /// Votes that count: a person's first on a pair.
    pub votes: usize,
    /// Pairs that a person saw again, and how often the choice was the same.
    pub repeats: usize,
    /// Share of repeats with the same choice.
    pub agreement: Option<Estimate>,
    /// Share of left among all votes for left or right.
    pub left: Option<Estimate>,
    /// Votes on videos that were made anew or left out since.
    pub outdated: usize,
    /// Whether the page that people vote on still shows any of those.
    pub stale: bool,
    /// Scene and row of those videos.
    pub replaced: BTreeSet<(String, String)>,
    /// The videos planted to be bad.
    pub planted: Vec<Planted>,
    /// Over all scenes, by row.
    pub pooled: Standing,
    /// Scene by scene, those that have votes.
    pub scenes: Vec<(String, Standing)>,
    /// Every vote, for other programs.
    pub cast: Vec<Cast>,
}

/// The rows of a scene, or of all, the strongest first.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Standing {
    /// The rows.
    pub rows: Vec<Judged>,
}

/// A row as it was voted on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// Its name.
    pub name: String,
    /// What it is.
    pub sort: Sort,
    /// Votes on it.
    pub votes: usize,
    /// Share of them that it won, ties as half.
    pub won: Estimate,
    /// Strength by Bradley & Terry, ln of the odds against an average row.
    pub strength: Estimate,
    /// How often it was preferred to each row of the standing, ties as half.
    pub over: Vec<f64>,
}

/// A video planted to be bad.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Planted {
    /// Name of its row.
    pub name: String,
    /// Votes on it against rows that were not planted.
    pub votes: usize,
    /// Share of them that it won, ties as half; none where there were no votes.
    pub won: Option<Estimate>,
}

impl Planted {
    /// Whether it lost more often than chance would have it: its interval ends below one half.
    pub fn found_out(&self) -> bool {
        self.won.is_some_and(|won| won.high < 0.5)
    }
}

/// What became of a vote.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Use {
    /// It counts.
    Counted,
    /// It is a person's second on a pair: it counts for agreement.
    Repeat,
    /// One of its videos was made anew or left out since.
    Outdated,
}

/// One vote with the names of what it was about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cast {
    /// Who voted; may be empty.
    pub voter: String,
    /// The sitting.
    pub session: String,
    /// Number within the sitting, from 1.
    pub order: usize,
    /// The scene.
    pub scene: String,
    /// Row of the left video.
    pub left: String,
    /// Row of the right video.
    pub right: String,
    /// What was chosen.
    pub choice: Choice,
    /// Seconds it took.
    pub seconds: f64,
    /// What became of it.
    pub used: Use,
}

/// What somebody chose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Choice {
    /// The left video, or the upper one where the window is narrow.
    Left,
    /// Neither.
    Tie,
    /// The right video, or the lower one.
    Right,
}

impl Choice {
    pub(super) const ALL: [(&str, Self); 3] = [("left", Self::Left), ("tie", Self::Tie), ("right", Self::Right)];

    /// As files have it.
    pub fn word(self) -> &'static str {
        Self::ALL.iter().find(|(_, choice)| *choice == self).map_or("", |(word, _)| word)
    }
}
