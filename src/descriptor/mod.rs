//! What describes a place of a clip or a picture: its motion over time, its texture, its appearance.

pub mod dense_sift;
pub mod motion_spectrum;
pub mod spatial_pyramid;
pub mod textureness;
pub mod vocabulary;
