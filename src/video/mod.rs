//! Reading and writing moving pictures.

pub mod clip;
pub mod conform;
pub mod looping;
pub mod read;
pub mod steps;
pub mod write;
pub mod yuv;
