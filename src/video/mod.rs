//! Reading and writing moving pictures.

pub mod animation;
mod avc_headers;
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
mod mp4_boxes;
pub mod mp4_writer;
mod palette;
pub mod png_folder;
pub mod scale;
pub mod sink;
pub mod source;
pub mod vp9;
pub mod webm;
pub mod y4m;
pub mod y4m_writer;
pub mod yuv;
