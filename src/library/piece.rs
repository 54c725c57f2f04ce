//! Names of clips and pieces.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::variant::Variant;

/// Identity of a clip: BLAKE3 hash of its file's bytes (of a folder: of its frames' bytes in order).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ClipId(pub [u8; 32]);

impl ClipId {
    /// Whether `name` is this clip as reports name it, or the first 8 or more of its 64 hexadecimal digits.
    pub fn is_called(&self, name: &str) -> bool {
        name.len() >= 8 && blake3::Hash::from(self.0).to_hex().starts_with(&name.to_ascii_lowercase())
    }
}

impl fmt::Display for ClipId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0[..8].iter().try_for_each(|b| write!(f, "{b:02x}"))
    }
}

impl fmt::Debug for ClipId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ClipId({self})")
    }
}

/// Stable name of a piece: what files store.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct PieceRef {
    /// The clip.
    pub clip: ClipId,
    /// The variant of it.
    pub variant: Variant,
    /// Left edge on the variant's canvas, pixels, a multiple of 4.
    pub x: u16,
    /// Top edge on the variant's canvas, pixels, a multiple of 4.
    pub y: u16,
}

/// Number of a piece within one pack; only meaningful in memory. Pieces are ordered by [`PieceRef`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PieceIx(pub u32);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clip_answers_to_its_short_and_its_full_name() {
        let id = ClipId(std::array::from_fn(|i| 17 * i as u8));
        assert!(id.is_called(&id.to_string()) && id.is_called(&id.to_string()[..8]));
        assert!(id.is_called("00112233445566778899AABBCCDDEEFF"));
        assert!(!id.is_called("0011223") && !id.is_called("") && !id.is_called("0011223344556676"));
    }
}
