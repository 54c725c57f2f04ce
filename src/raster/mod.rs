//! Images in memory, the filters on them, and single pictures in files.

pub mod catmull_rom;
pub mod components;
pub mod exr_file;
pub mod filter;
pub mod image;
pub mod npy;
pub mod picture_io;
pub mod premultiplied;
pub mod pyramid;
pub mod resample;
