//! Reading and writing moving pictures.

pub mod clip;
