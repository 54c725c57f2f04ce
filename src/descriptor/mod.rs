//! What describes a place of a clip: its motion over time, its texture, its appearance.

pub mod motion_spectrum;
pub mod textureness;
