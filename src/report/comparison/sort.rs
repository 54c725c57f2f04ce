//! What a row of a comparison is.

use serde::{Deserialize, Serialize};

/// What a row is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sort {
    /// The picture, held still.
    Frozen,
    /// The real clip: its second half, measured against its first.
    Real,
    /// A method's frames in an order by chance: bad on purpose, for the blind test.
    Shuffled,
    /// A method.
    #[default]
    Method,
}

impl Sort {
    /// Whether it is there to be seen as bad.
    pub fn is_bad(self) -> bool {
        matches!(self, Self::Frozen | Self::Shuffled)
    }
}
