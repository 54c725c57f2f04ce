//! What the engine works on: channels, images, patches and where they lie, poses and fields. No algorithm stands here.

pub mod channels;
pub mod field;
pub mod image;
pub mod patches;
pub mod pose;
pub mod segments;
pub mod sites;
