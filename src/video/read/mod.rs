//! A file per format in, behind one trait, and [`source`], which tells formats apart.

pub mod animation;
mod array;
pub mod avi;
pub mod decoder;
pub mod ffmpeg;
pub mod folder;
pub mod h264;
pub mod mjpeg;
pub mod mp4;
pub mod source;
pub mod vp9;
pub mod webm;
pub mod y4m;
