//! Images in memory and the filters on them.

pub mod filter;
pub mod image;
pub mod resample;
