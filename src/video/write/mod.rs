//! A file per format out, behind one trait, and [`sink`], which chooses by the name of the file.

mod animation;
mod apng;
pub mod both;
pub mod gif;
pub mod mp4;
pub mod npy;
pub mod options;
mod palette;
mod patch;
pub mod png_folder;
pub mod sink;
mod webp;
pub mod y4m;
