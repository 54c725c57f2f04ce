//! The commands of the two programs, thin: parse, call the library, print.

pub mod animate;
pub mod common;
pub mod compare;
pub mod debug_pictures;
pub mod demo;
pub mod measure;
pub mod methods;
pub mod simulate;
