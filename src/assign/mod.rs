//! Which piece of the library each square of the picture gets.

pub mod candidates;
pub mod energy;
pub mod icm;
pub mod nodes;
pub mod pair_costs;
