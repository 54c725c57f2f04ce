//! Reading and writing moving pictures.

mod avc_headers;
pub mod clip;
mod mp4_boxes;
pub mod mp4_writer;
pub mod png_folder;
pub mod sink;
pub mod y4m_writer;
pub mod yuv;
