//! Motion between frames, and motion as a person asks for it.

pub mod along_streaks;
pub mod draw;
pub mod ensemble;
pub mod field;
pub mod io;
pub mod mean_motion;
pub mod orientation;
pub mod painted_strokes;
pub mod radial_basis;
pub mod rendered;
pub mod stroke_files;
pub mod strokes;
pub mod tv_l1;
