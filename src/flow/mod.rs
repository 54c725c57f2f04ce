//! Motion between frames.

pub mod draw;
pub mod field;
pub mod io;
pub mod tv_l1;
