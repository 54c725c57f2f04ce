//! Reading and writing moving pictures.

pub mod animation;
mod animation_writer;
mod apng_writer;
pub mod avi;
pub mod clip;
pub mod conform;
pub mod decoder;
pub mod ffmpeg;
pub mod folder;
pub mod gif_writer;
pub mod h264;
pub mod looping;
pub mod mjpeg;
pub mod mp4;
pub mod mp4_writer;
mod palette;
mod patch;
pub mod png_folder;
pub mod scale;
pub mod sink;
pub mod source;
pub mod vp9;
pub mod webm;
mod webp_writer;
pub mod y4m;
pub mod y4m_writer;
pub mod yuv;
