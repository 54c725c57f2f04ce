//! Fluids simulated in two dimensions: designed targets for the exemplar methods, and flows that are known.
//!
//! A [`file`] says what comes in where; [`setup`] checks it and makes pixels of it; [`fluid`] gives frame after frame, each
//! with its flow and its opacity; [`output`] writes them. Pixels are the grid, frames the unit of time.
//!
//! - [`gas`]: smoke and fire, incompressible (Stam 1999; Fedkiw, Stam & Jensen 2001).
//! - [`water`]: shallow water, whose surface has divergence and a height.
//! - [`grid`], [`advect`], [`transport`], [`project`]: the staggered grid, velocities carried along, densities carried
//!   along, the pressure.

pub mod advect;
pub mod file;
pub mod fluid;
mod forces;
pub mod gas;
pub mod grid;
mod multigrid;
mod noise;
pub mod output;
mod preview;
pub mod project;
pub mod setup;
pub mod transport;
pub mod water;
