//! What looks are borrowed from.

pub mod differences;
#[expect(clippy::module_inception, reason = "exemplars are what this room is about")]
pub mod exemplar;
pub mod files;
pub mod own;
