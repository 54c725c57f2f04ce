//! The library from outside. One program for all of it, since linking the library is what takes long.

mod build;
#[path = "../common/mod.rs"]
mod common;
mod crash;
mod exemplar;
mod fixtures;
mod keep;
mod measure;
mod pack;
mod patch;
mod patch_in_time;
mod reading;
mod render;
mod scene;
mod scenes;
mod simulate;
mod synth;
mod writing;
