//! What every other module stands on: errors, threads, hashing randomness, progress, whole files and those of our own, words
//! and matrix products.

pub mod atomic_file;
pub mod error;
pub mod instructions;
pub mod matmul;
pub mod observe;
pub mod options;
pub mod own_file;
pub mod par;
pub mod rng;
pub mod text;
