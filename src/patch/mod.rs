//! Patch optimization: what all exemplar methods share.
//!
//! A frame `X` is made of patches of an exemplar `Z`. With `x̃`, `z̃` patches over all channels, synthesised ones and guides,
//! the energy is `E = Σ_q min_p D(z̃_p, x̃_q)` with `D` a weighted sum of squared differences (LazyFluids 2015, Eq. 7 and 9).
//! It is lowered coarse to fine by two steps in turns: **search** gives every target patch a source patch, the
//! nearest-neighbour field; **vote** makes every pixel the mean of the patches over it (Wexler et al. 2007).
//!
//! - [`data`]: channels and how they lie in memory, segments, sites, patches and where they lie, poses, fields.
//! - `distance`, [`patch_match`], [`vote`]: the two steps.
//! - [`rules`]: how the field is constrained, a file a rule behind one trait: plain, coherent, bidirectional, by an occurrence
//!   map, uniform, or by a price on repetition.
//! - [`terms`]: what a method adds to distances, and which poses it tries.
//! - [`session`]: levels and frames in the order that a method likes; [`engine`]: sources, and one frame after the other.
//!
//! A method says which channels there are, what they weigh, what the source is, what a frame starts from, and whether patches
//! stand upright or turn ([`data::pose::Pose`]). For Kwatra et al. 2005 that is colour and the previous frame carried along
//! the flow; LazyFluids adds alpha, blurred alpha as a guide, and the previous frame on both sides; a video exemplar is
//! another [`engine::Source`] each frame, or all its frames at once ([`engine::Engine::clip`]).

pub mod data;
mod distance;
pub mod engine;
mod level;
pub mod patch_match;
pub mod rules;
pub mod session;
pub mod terms;
#[cfg(test)]
mod testing;
pub mod vote;
