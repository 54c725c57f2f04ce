//! What is to be animated: a picture, its matte, and what a person asked for.

pub mod asked;
pub mod clip_strokes;
pub mod designed;
pub mod file;
pub mod frame_map;
pub mod leave_one_out;
pub mod left_out;
#[expect(clippy::module_inception, reason = "the scene is what this group is about")]
pub mod scene;
mod sequence;
pub mod target;
