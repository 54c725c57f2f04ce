//! What a measure is.

use super::subject::Subject;

/// Which way a measure is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Better {
    /// Smaller is better.
    Lower,
    /// Larger is better.
    Higher,
    /// Nearer to 0 is better, from either side.
    Zero,
    /// Nearer to 1 is better, from either side.
    One,
}

impl Better {
    /// How bad a value is: the lower, the better.
    pub fn badness(self, value: f64) -> f64 {
        match self {
            Self::Lower => value,
            Self::Higher => -value,
            Self::Zero => value.abs(),
            Self::One => (value - 1.0).abs(),
        }
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Lower => "lower",
            Self::Higher => "higher",
            Self::Zero => "near 0",
            Self::One => "near 1",
        }
    }
}

/// One measure.
#[derive(Debug, Clone, Copy)]
pub struct Measure {
    /// Name, as tables print it.
    pub name: &'static str,
    /// Unit of the value.
    pub unit: &'static str,
    /// What is computed, in one line.
    pub definition: &'static str,
    /// What it needs beyond the frames; empty when nothing.
    pub needs: &'static str,
    /// Which way is better.
    pub better: Better,
    /// The value; `None` when an input is missing or the value has no meaning (0 / 0).
    pub compute: fn(&Subject) -> Option<f64>,
}
