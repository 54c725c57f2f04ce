//! Which piece of the library each square of the picture gets.

pub mod candidates;
pub mod nodes;
