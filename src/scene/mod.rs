//! What is to be animated: a picture, its matte, and what a person asked for.

pub mod asked;
pub mod clip_strokes;
pub mod designed;
pub mod exemplar;
pub mod exemplar_file;
pub mod file;
pub mod flow_files;
pub mod frame_map;
pub mod leave_one_out;
pub mod left_out;
pub mod parameters;
#[expect(clippy::module_inception, reason = "the scene is what this group is about")]
pub mod scene;
pub mod sequence;
pub mod target;
