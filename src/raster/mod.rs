//! Images in memory, the filters on them, and single pictures in files.

pub mod components;
pub mod filter;
pub mod image;
pub mod picture_io;
pub mod pyramid;
pub mod resample;
