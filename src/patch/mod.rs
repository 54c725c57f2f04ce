//! Patch optimization: what all exemplar methods share.
//!
//! A frame `X` is made of patches of an exemplar `Z`. With `x̃`, `z̃` patches over all channels, synthesised ones and guides,
//! the energy is `E = Σ_q min_p D(z̃_p, x̃_q)` with `D` a weighted sum of squared differences (LazyFluids 2015, Eq. 7 and 9).
//! It is lowered coarse to fine by two steps in turns: **search** gives every target patch a source patch, the
//! nearest-neighbour field; **vote** makes every pixel the mean of the patches over it (Wexler et al. 2007).
//!
//! - [`channels`]: the channels, their weights, and how they lie in memory.
//! - [`segments`]: which pixels are centres of patches, and whether of the outline or the interior.
//! - [`atlas`]: all exemplar images of a level in one array.
//! - [`nnf`]: the field.
//! - `distance`, [`patch_match`], [`vote`]: the two steps.
//! - [`rules`]: how the field is constrained: plain, coherent, bidirectional, by an occurrence map, or uniform. `usage`,
//!   `leftovers`, `exchange` and `chains` do the last two, `coherence` and `completeness` those before.
//! - [`image`], [`engine`]: what goes in and out, and the loop.
//!
//! A method says which channels there are, what they weigh, which images are the source and what a frame starts from. For
//! Kwatra et al. 2005 that is colour and the previous frame carried along the flow; LazyFluids adds alpha, blurred alpha as a
//! guide, and the previous frame on both sides; a video exemplar is another [`engine::Source`] each frame.

pub mod atlas;
mod chains;
pub mod channels;
mod coherence;
mod completeness;
mod distance;
pub mod engine;
mod exchange;
pub mod image;
mod leftovers;
mod level;
pub mod nnf;
pub mod patch_match;
pub mod rules;
pub mod segments;
#[cfg(test)]
mod testing;
mod usage;
pub mod vote;
