//! Strokes as files, JSON or a painting.

use std::path::Path;

use super::painted_strokes;
use super::strokes::{self, Stroke};
use crate::base::error::Result;

/// Reads the strokes for a picture of `size` pixels: JSON ([`strokes::read`]); or a picture of that size with coloured
/// strokes on transparency (PNG or WebP by its name), each from its faint to its strong end ([`painted_strokes::read`]).
///
/// # Errors
/// Those of the two; a painted stroke without a gradient; a painting of another size.
pub fn read(path: &Path, size: (usize, usize)) -> Result<Vec<Stroke>> {
    let painted = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png") || e.eq_ignore_ascii_case("webp"));
    if painted { painted_strokes::read(path, size) } else { strokes::read(path, size) }
}
