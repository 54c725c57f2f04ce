//! What a person can choose of a build.

use super::format::{FEATURES, Parameters};
use super::grid::Cell;
use super::variant::{CELL, PIECE};
use crate::base::error::{Error, Kind, Result};
use crate::descriptor::vocabulary::{MAX_WORDS, WORDS};

/// Library frame rate, frames per second.
pub const RATE: u32 = 25;

/// What to build.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Options {
    /// Tag of the clips ("water"); may be empty.
    pub tag: String,
    /// Distance of neighbouring pieces, pixels. 24, the distance of nodes, lets neighbouring nodes continue one clip; less
    /// suits small fluids.
    pub stride: u32,
    /// Visual words to learn (k).
    pub words: u32,
    /// Longest side of a working frame, pixels.
    pub working: u32,
    /// Least share of moving pixels of a piece, thousandths.
    pub moving_permille: u32,
    /// Whether a pack may be replaced that holds clips which are not given this time. No part of the pack.
    pub replace: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { tag: String::new(), stride: 24, words: WORDS as u32, working: 640, moving_permille: 50, replace: false }
    }
}

impl Options {
    /// Checks every option.
    ///
    /// # Errors
    /// [`Kind::Usage`] naming the option and its range.
    pub fn check(&self) -> Result<()> {
        let bad = |name: &str, value: u32, allowed: String| {
            Err(Error::new(Kind::Usage, name, format!("{value} asked")).allowed(allowed))
        };
        if !(4..=PIECE as u32).contains(&self.stride) || !self.stride.is_multiple_of(CELL as u32) {
            return bad("--stride", self.stride, format!("multiples of 4 from 4 to {PIECE}"));
        }
        if !(1..=MAX_WORDS as u32).contains(&self.words) {
            return bad("--words", self.words, format!("1 to {MAX_WORDS}"));
        }
        if !(64..=4096).contains(&self.working) {
            return bad("--working-size", self.working, "64 to 4096".to_owned());
        }
        if self.moving_permille > 1000 {
            return bad("--moving", self.moving_permille, "0 to 1000".to_owned());
        }
        if self.tag.len() > 64 || self.tag.chars().any(|c| c.is_control() || c == ',') {
            return Err(Error::new(Kind::Usage, "--tag", "too long, or with commas or control characters")
                .allowed("up to 64 bytes"));
        }
        Ok(())
    }

    /// As they stand in the pack's header.
    pub fn parameters(&self) -> Parameters {
        Parameters {
            rate: RATE,
            stride: self.stride,
            words: self.words,
            piece: PIECE as u32,
            cell: CELL as u32,
            cell_bytes: size_of::<Cell>() as u32,
            working: self.working,
            moving_permille: self.moving_permille,
            features: FEATURES,
        }
    }
}
