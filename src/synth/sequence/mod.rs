//! Frames made one from the other with the patch engine.

pub mod chain;
pub mod channels;
pub mod detail;
pub mod patch_method;
pub mod whole_pixels;
