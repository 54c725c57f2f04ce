//! Clips that show the same footage: encoded again, cut shorter, shrunk.
//!
//! Compared is how the picture changes, not how it looks: two recordings of one place from one tripod look alike and are
//! different clips. Every frame becomes a small luma picture, less the one before; a run of these of one clip is held
//! against every run of the other, and the best correlation tells. The whole picture's brightness is left out, for any
//! two fades are alike.

use super::reader::Pack;
use crate::base::error::Result;
use crate::base::matmul;
use crate::base::observe::{self, Observer};
use crate::raster::image::Plane;
use crate::raster::pyramid::reduce;
use crate::raster::resample::resize;

/// Sides of the small pictures.
const SIDE: usize = 24;
/// Changes in a run that is compared: about a second.
const RUN: usize = 24;
/// Every so many frames a run of the first clip begins.
const STEP: usize = 8;

/// Clips nearer than this show the same footage. Of twelve copies of six real clips (cut to 2.6 s, shrunk or enlarged,
/// encoded again at 25 or 30 frames/s) eleven lay within 0.35 of their originals, and one that a decoder's duplicates
/// had made to play at another speed at 0.76; of 406 pairs of different clips the nearest lay at 0.61, two surges of one
/// stream from one camera among them.
pub const SAME: f32 = 0.5;

/// How a clip's picture changes from frame to frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Changes {
    /// `SIDE²` numbers per change, of mean 0.
    rows: Vec<f32>,
    /// Squared length of every change.
    squares: Vec<f32>,
}

impl Changes {
    /// Reads clip number `clip` of a pack.
    ///
    /// # Errors
    /// A damaged pack, a cancel.
    pub fn of(pack: &Pack, clip: u32, observer: &dyn Observer) -> Result<Self> {
        let mut thumbnails = Vec::new();
        for frame in pack.frames(clip)? {
            observe::check(observer)?;
            thumbnails.push(thumbnail(&frame?.luma()));
        }
        Ok(Self::between(&thumbnails))
    }

    fn between(thumbnails: &[Plane]) -> Self {
        let change = |pair: &[Plane]| {
            let change: Vec<f32> = pair[1].data.iter().zip(&pair[0].data).map(|(b, a)| b - a).collect();
            let mean = change.iter().sum::<f32>() / change.len() as f32;
            change.into_iter().map(move |c| c - mean)
        };
        let rows: Vec<f32> = thumbnails.windows(2).flat_map(change).collect();
        let squares = rows.chunks_exact(SIDE * SIDE).map(|row| row.iter().map(|v| v * v).sum()).collect();
        Self { rows, squares }
    }

    /// Distance of two clips: 1 less the best correlation of a run of one with a run of the other; 0 for the same
    /// footage, near 1 for different ones, 1 where one is shorter than a run.
    pub fn distance(&self, other: &Self) -> f32 {
        let (n, m) = (self.squares.len(), other.squares.len());
        if n.min(m) < RUN {
            return 1.0;
        }
        let mut products = vec![0.0; n * m];
        matmul::a_bt(n, m, SIDE * SIDE, &self.rows, &other.rows, &mut products);
        let energy = |squares: &[f32], at: usize| squares[at..at + RUN].iter().sum::<f32>();
        let correlation = |i: usize, j: usize| {
            let together = (0..RUN).map(|k| products[(i + k) * m + j + k]).sum::<f32>();
            together / (energy(&self.squares, i) * energy(&other.squares, j)).sqrt().max(1e-12)
        };
        let pairs = (0..=n - RUN).step_by(STEP).flat_map(|i| (0..=m - RUN).map(move |j| (i, j)));
        1.0 - pairs.map(|(i, j)| correlation(i, j)).fold(0.0, f32::max)
    }
}

/// Luma shrunk to a square whatever its shape: an encoder may have cut a few pixels off one side.
fn thumbnail(luma: &Plane) -> Plane {
    // Two cheap halvings first: most of the cost of a thumbnail is reading the full frame.
    resize(&reduce(&reduce(luma)), SIDE, SIDE)
}
