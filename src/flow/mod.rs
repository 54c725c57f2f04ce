//! Motion between frames.

pub mod field;
