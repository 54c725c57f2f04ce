//! What is measured, and what it is measured against.

use super::footage::Footage;
use crate::flow::field::Field;
use crate::raster::image::Plane;

/// A piece where it lies, in pixels of the footage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// Left edge.
    pub x: f32,
    /// Top edge.
    pub y: f32,
    /// Length of its sides.
    pub side: f32,
    /// Mean length of its piece's motion, pixels per frame.
    pub activity: f32,
}

/// How often each source (a piece, a patch of an exemplar) was used.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Usage {
    /// Uses of every source; those never used may be left out.
    pub counts: Vec<u64>,
    /// How many sources there were to choose from.
    pub sources: u64,
}

/// A video with everything known of it; what is unknown stays `None` or empty.
///
/// All pixels are pixels of `footage`. Reference and picture must be of the same pixel scale (a wave as many pixels long
/// in all of them), the reference also of the same frame rate; sizes may differ.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// The video.
    pub footage: &'a Footage,
    /// The picture it was made from, which its frames should look like.
    pub picture: Option<&'a Footage>,
    /// A real clip, which it should move like; without a picture also what it should look like.
    pub reference: Option<&'a Footage>,
    /// The motion asked for, pixels per frame (of length 1 where only a direction was asked), of the footage's size;
    /// zero where nothing was asked.
    pub asked: Option<&'a Field>,
    /// The speed asked for, pixels per frame, of the footage's size; zero where nothing was asked. Without it the length
    /// of `asked` counts.
    pub asked_speed: Option<&'a Plane>,
    /// The pieces it was made of.
    pub nodes: &'a [Node],
    /// How often each source was used.
    pub usage: Option<&'a Usage>,
    /// Seed of the samples; any two give nearly the same values.
    pub seed: u64,
}

impl<'a> Subject<'a> {
    /// A video of which nothing else is known.
    pub fn new(footage: &'a Footage) -> Self {
        Self {
            footage,
            picture: None,
            reference: None,
            asked: None,
            asked_speed: None,
            nodes: &[],
            usage: None,
            seed: 1,
        }
    }

    /// What the frames should look like: the picture, or else the reference.
    pub(super) fn appearance(&self) -> Option<&'a Footage> {
        self.picture.or(self.reference)
    }
}
