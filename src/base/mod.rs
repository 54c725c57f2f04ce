//! What every other module stands on: errors, threads, hashing randomness, progress and matrix products.

pub mod error;
pub mod matmul;
pub mod observe;
pub mod par;
pub mod rng;
