//! Which piece of the library each square of the picture gets.

pub mod binary;
pub mod candidates;
#[cfg(test)]
mod cases;
pub mod dual_bound;
pub mod energy;
pub mod expansion;
pub mod fusion;
pub mod max_flow;
pub mod nodes;
pub mod pair_costs;
pub mod solve;
pub mod turned;
