//! Enliven brings a still picture of water, fire or smoke to life.
//!
//! Offline, clips become a library: clips → variants → pieces → descriptors → one pack ([`library`]). Online, a
//! picture with a matte becomes nodes, nodes get candidates, candidates become labels, labels become frames.

pub mod assign;
pub mod base;
pub mod cli;
pub mod descriptor;
pub mod flow;
pub mod library;
pub mod measure;
pub mod patch;
pub mod raster;
pub mod render;
pub mod report;
pub mod scene;
pub mod simulate;
pub mod synth;
pub mod video;
