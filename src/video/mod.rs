//! Reading and writing moving pictures.

mod avc_headers;
pub mod clip;
pub mod gif_writer;
pub mod looping;
mod mp4_boxes;
pub mod mp4_writer;
mod palette;
pub mod png_folder;
pub mod sink;
pub mod y4m_writer;
pub mod yuv;
