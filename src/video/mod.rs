//! Reading and writing moving pictures.

pub mod clip;
pub mod yuv;
