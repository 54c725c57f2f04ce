//! From assigned pieces to frames: blended differences over the recovered average image, inside a matte that may move,
//! before what is behind it (Okabe et al. 2011, §6).

pub mod appearance;
pub mod band_gains;
pub mod blend;
pub mod boundary;
pub mod carry;
pub mod composite;
pub mod contrast;
pub mod drift;
pub mod extrapolate;
pub mod fade;
pub mod inpaint;
pub mod layers;
pub mod layout;
pub mod mirror;
pub mod overlay;
pub mod patchwork;
pub mod recover;
pub mod residuals;
pub mod sample;
pub mod streaks;
pub mod sway;
pub mod trajectory;
pub mod transport;
