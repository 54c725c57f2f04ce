//! Voting: every pixel becomes the mean of what the patches over it have there (Wexler et al. 2007).

use super::atlas::Place;
use super::channels::Stack;
use super::nnf::Nnf;
use crate::base::par;
use crate::raster::image::Plane;

/// Rows that one thread votes at a time.
const BAND: usize = 16;

/// What is voted: the field, and the image whose pixels its places name.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vote<'a> {
    pub nnf: &'a Nnf,
    pub source: &'a Stack,
    /// Reach of a patch.
    pub radius: usize,
    /// How many channels are voted, the first ones.
    pub channels: usize,
    /// Weight of every target patch; none counts all alike.
    pub weights: Option<&'a [f32]>,
}

impl Vote<'_> {
    /// Overwrites the voted channels of `target`, rounded to bytes; pixels under no patch become 0.
    pub fn write(&self, target: &mut Stack) {
        let (width, channels) = (target.width, target.channels);
        par::for_each_chunk(target.bytes_mut(), BAND * width * channels, |band, bytes| {
            let mut sums = vec![0.0; width * self.channels];
            for (j, row) in bytes.chunks_exact_mut(width * channels).enumerate() {
                self.row(band * BAND + j, &mut sums);
                for (pixel, sums) in row.chunks_exact_mut(channels).zip(sums.chunks_exact(self.channels)) {
                    pixel.iter_mut().zip(sums).for_each(|(p, s)| *p = (s + 0.5) as u8);
                }
            }
        });
    }

    /// The voted channels as planes with values in [0, 1], not rounded.
    pub fn planes(&self) -> Vec<Plane> {
        let (width, height) = (self.nnf.width, self.nnf.cells.len() / self.nnf.width.max(1));
        let rows = par::map(height, |y| {
            let mut sums = vec![0.0; width * self.channels];
            self.row(y, &mut sums);
            sums
        });
        let value = |c: usize, x: usize, y: usize| rows[y][x * self.channels + c] * (1.0 / 255.0);
        (0..self.channels).map(|c| Plane::from_fn(width, height, |x, y| value(c, x, y))).collect()
    }

    /// The voted bytes of row `y`, not rounded.
    fn row(&self, y: usize, sums: &mut [f32]) {
        match self.channels {
            3 => self.row_of::<3>(y, sums),
            4 => self.row_of::<4>(y, sums),
            _ => self.row_of::<0>(y, sums),
        }
    }

    /// `C` channels, or as many as there are where `C` is 0.
    fn row_of<const C: usize>(&self, y: usize, sums: &mut [f32]) {
        let channels = if C > 0 { C } else { self.channels };
        let (width, radius) = (self.nnf.width, self.radius);
        let mut totals = vec![0.0; width];
        sums.fill(0.0);
        for cy in y.saturating_sub(radius)..(y + radius + 1).min(self.nnf.cells.len() / width) {
            let down = y as isize - cy as isize;
            for cx in 0..width {
                let cell = self.nnf.cells[cy * width + cx];
                if cell.place == Place::NONE {
                    continue;
                }
                let weight = self.weights.map_or(1.0, |w| w[cy * width + cx]);
                // A patch lies within its image on both sides.
                let first = (cell.place.index() as isize + down * self.source.width as isize) as usize - radius;
                let from = &self.source.bytes()[first * self.source.channels..];
                let left = cx - radius;
                for k in 0..=2 * radius {
                    let pixel = &from[k * self.source.channels..][..channels];
                    let to = &mut sums[(left + k) * channels..][..channels];
                    to.iter_mut().zip(pixel).for_each(|(s, &p)| *s += weight * f32::from(p));
                    totals[left + k] += weight;
                }
            }
        }
        for (pixel, &total) in sums.chunks_exact_mut(channels).zip(&totals) {
            let share = if total > 0.0 { 1.0 / total } else { 0.0 };
            pixel.iter_mut().for_each(|s| *s *= share);
        }
    }
}
