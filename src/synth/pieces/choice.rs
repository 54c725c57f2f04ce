//! A piece of one of the libraries, by its number.

use crate::library::piece::PieceIx;

/// A piece of one of the libraries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Choice {
    /// Number of the library.
    pub pack: usize,
    /// The piece.
    pub piece: PieceIx,
}
