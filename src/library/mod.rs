//! The library of clips: variants, pieces, and the pack that holds them.

pub mod acceptance;
pub mod analyse;
pub mod grid;
pub mod piece;
pub mod variant;
