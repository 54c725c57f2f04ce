//! The library of clips: variants, pieces, and the pack that holds them.

pub mod acceptance;
pub mod analyse;
pub mod analyse_clip;
pub mod assemble;
pub mod build;
pub mod estimate;
pub mod features;
pub mod format;
pub mod frames;
pub mod grid;
pub mod inputs;
pub mod metadata;
pub mod normalizers;
pub mod piece;
pub mod pieces;
pub mod reader;
pub mod segment;
pub mod significance;
pub mod statistics;
pub mod store;
pub mod tile;
pub mod variant;
pub mod verify;
pub mod workshop;
pub mod writer;
