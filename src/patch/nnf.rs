//! The nearest-neighbour field: for every target patch a source patch.

use super::atlas::{Atlas, Place};
use super::patch_match::Search;
use super::segments::{NO_PATCH, Patches};
use crate::base::rng;
use crate::raster::image::Rgb8;

/// What a target patch is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell {
    /// Its source patch; [`Place::NONE`] where the pixel is no patch centre.
    pub place: Place,
    /// Their distance in whole numbers, see [`super::channels::Layout::to_energy`].
    pub distance: u32,
}

impl Cell {
    /// No patch.
    pub const NONE: Self = Self { place: Place::NONE, distance: 0 };
}

/// One cell per pixel of the target.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Nnf {
    /// Width in pixels.
    pub width: usize,
    /// The cells, row by row.
    pub cells: Vec<Cell>,
}

impl Nnf {
    /// Gives every patch of `target` the place that `choose(pixel, segment)` names; distances are not known yet.
    pub(super) fn from_fn(target: &Patches, mut choose: impl FnMut(usize, u8) -> Option<Place>) -> Self {
        let cell = |(i, &label): (usize, &u8)| match label {
            NO_PATCH => Cell::NONE,
            segment => choose(i, segment).map_or(Cell::NONE, |place| Cell { place, distance: u32::MAX }),
        };
        Self { width: target.stack.width, cells: target.labels().iter().enumerate().map(cell).collect() }
    }

    /// Places by chance, within each patch's segment.
    pub fn random(target: &Patches, source: &Patches, seed: u64) -> Self {
        Self::from_fn(target, |i, segment| source.any(segment, rng::hash(seed, &[i as u64])).map(Place))
    }

    /// This field of a coarser level as the next finer one starts: each cell becomes four. `from` and `to` are the sources
    /// of the two levels; what has no counterpart in its segment is given a place by chance.
    pub(super) fn refined(&self, from: &Atlas, target: &Patches, to: &Atlas, seed: u64) -> Self {
        let rows = self.cells.len() / self.width;
        Self::from_fn(target, |i, segment| {
            let (x, y) = (i % target.stack.width, i / target.stack.width);
            let inherited = self.near(x / 2, y / 2, rows).and_then(|(place, cx, cy)| {
                let (image, sx, sy) = from.locate(place);
                // The patch that covers the same pixels relative to the coarse match.
                let along = |s: usize, v: usize, c: usize| (2 * s + v).checked_sub(2 * c);
                to.at(image, along(sx, x, cx)?, along(sy, y, cy)?, segment)
            });
            inherited.or_else(|| to.patches.any(segment, rng::hash(seed, &[i as u64])).map(Place))
        })
    }

    /// This field, whose places lie in the finest atlas `from`, on level `level` with source `to`. Patches without a
    /// counterpart have no place.
    pub(super) fn coarsened(&self, from: &Atlas, level: usize, target: &Patches, to: &Atlas) -> Self {
        let rows = self.cells.len() / self.width;
        Self::from_fn(target, |i, segment| {
            let fine = |v: usize| (v << level) + (1 << level) / 2;
            let (x, y) = (fine(i % target.stack.width), fine(i / target.stack.width));
            let (place, cx, cy) = self.near(x, y, rows)?;
            let (image, sx, sy) = from.locate(place);
            let along = |s: usize, v: usize, c: usize| Some((s + v).checked_sub(c)? >> level);
            to.at(image, along(sx, x, cx)?, along(sy, y, cy)?, segment)
        })
    }

    /// Takes every place of `other` that is nearer.
    pub(super) fn merge(&mut self, search: &Search, other: &Self) {
        search.evaluate(self);
        let mut other = other.clone();
        search.evaluate(&mut other);
        for (cell, other) in self.cells.iter_mut().zip(other.cells) {
            if other.place != Place::NONE && other.distance < cell.distance {
                *cell = other;
            }
        }
    }

    /// The field carried along a flow: `from(x, y)` is where the patch at a pixel was before, in pixels (centres at ½).
    pub fn carried(&self, from: impl Fn(usize, usize) -> (f32, f32)) -> Self {
        let (width, height) = (self.width, self.cells.len() / self.width.max(1));
        let cell = |i: usize| {
            let (x, y) = from(i % width, i / width);
            let inside = x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
            if inside { self.cells[y as usize * width + x as usize] } else { Cell::NONE }
        };
        Self { width, cells: (0..self.cells.len()).map(cell).collect() }
    }

    /// The place at `(x, y)` or, on the border where no patch is centred, at the nearest pixel that has one.
    fn near(&self, x: usize, y: usize, rows: usize) -> Option<(Place, usize, usize)> {
        const REACH: usize = 4;
        let at = |x: usize, y: usize| {
            let place = self.cells[y * self.width + x].place;
            (place != Place::NONE).then_some((place, x, y))
        };
        let (x, y) = (x.min(self.width - 1), y.min(rows - 1));
        at(x, y).or_else(|| {
            let around = |v: usize, size: usize| v.saturating_sub(REACH)..(v + REACH + 1).min(size);
            let all = around(y, rows).flat_map(|cy| around(x, self.width).map(move |cx| (cx, cy)));
            all.filter_map(|(cx, cy)| at(cx, cy))
                .min_by_key(|&(_, cx, cy)| (cx.abs_diff(x).pow(2) + cy.abs_diff(y).pow(2), cy, cx))
        })
    }

    /// Sum of all distances, in whole numbers.
    pub fn total(&self) -> u64 {
        self.assigned().map(|(_, cell)| u64::from(cell.distance)).sum()
    }

    /// The patches that have a place, with their pixel numbers.
    pub fn assigned(&self) -> impl Iterator<Item = (usize, Cell)> {
        self.cells.iter().copied().enumerate().filter(|(_, cell)| cell.place != Place::NONE)
    }

    /// How often every pixel of the atlas is the centre of an assigned patch (δ of LazyFluids, Eq. 5).
    pub fn usage(&self, atlas: &Atlas) -> Vec<u32> {
        let mut usage = vec![0; atlas.patches.labels().len()];
        self.assigned().for_each(|(_, cell)| usage[cell.place.index()] += 1);
        usage
    }

    /// The field as colours: red and green are the place across and down its image, blue tells the image. Black has no patch.
    pub fn picture(&self, atlas: &Atlas) -> Rgb8 {
        let mut out = Rgb8::black(self.width, self.cells.len() / self.width.max(1));
        for (i, cell) in self.assigned() {
            let (image, x, y) = atlas.locate(cell.place);
            let (width, height) = atlas.size(image);
            let scale = |v: usize, size: usize| (32 + 223 * v / size.max(1)) as u8;
            out.data[3 * i..3 * i + 3].copy_from_slice(&[
                scale(x, width),
                scale(y, height),
                scale(image, atlas.images()),
            ]);
        }
        out
    }
}

/// Usage counts as grey levels: `mean` uses are middle grey, twice as many are white.
pub fn usage_picture(usage: &[u32], atlas: &Atlas, mean: f64) -> Rgb8 {
    let stack = &atlas.patches.stack;
    let grey = |&n: &u32| [(f64::from(n) / mean.max(f64::MIN_POSITIVE) * 127.5).min(255.0) as u8; 3];
    Rgb8 { width: stack.width, height: stack.height, data: usage.iter().flat_map(grey).collect() }
}
