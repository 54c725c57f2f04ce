//! Motion borrowed piece by piece from a library: pieces are chosen for nodes, placed, and made frames.

pub mod assignment_picture;
pub mod base_flow;
pub mod choice;
pub mod fluctuation;
pub mod footage;
pub mod frames;
pub mod gate;
pub mod legend;
pub mod options;
pub mod outcome;
pub mod outline;
pub mod phases;
pub mod pick;
pub mod piece_method;
pub mod placing;
pub mod playback;
pub mod rendering;
pub mod run;
pub mod slowness;
pub mod travel;
