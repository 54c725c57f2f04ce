//! From assigned pieces to frames: blended differences over the recovered average image (Okabe et al. 2011, §6).

pub mod blend;
pub mod composite;
pub mod contrast;
pub mod layout;
pub mod recover;
pub mod sample;
