//! The nearest-neighbour field: for every target patch a source patch.

use super::patches::{Offset, Patches, Place};
use super::pose::{ONE, Pose, Upright};
use super::segments::NO_PATCH;
use crate::base::rng;
use crate::raster::image::Rgb8;

/// What a target patch is given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell<P = Upright> {
    /// Its source patch; [`Place::NONE`] where the pixel is no patch centre.
    pub place: Place,
    /// Their distance in whole numbers, see [`super::channels::Layout::to_energy`].
    pub distance: u32,
    /// How the patch is laid on its site.
    pub pose: P,
}

impl<P: Pose> Cell<P> {
    /// No patch.
    pub fn none() -> Self {
        Self { place: Place::NONE, distance: 0, pose: P::default() }
    }
}

impl Cell {
    /// No patch.
    pub const NONE: Self = Self { place: Place::NONE, distance: 0, pose: Upright };

    /// An upright patch.
    pub fn new(place: Place, distance: u32) -> Self {
        Self { place, distance, pose: Upright }
    }
}

/// One cell per pixel of the target.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Nnf<P = Upright> {
    /// Width in pixels.
    pub width: usize,
    /// The cells, row by row.
    pub cells: Vec<Cell<P>>,
}

impl<P: Pose> Nnf<P> {
    /// Gives every patch of `target` the place that `choose(pixel, segment)` names; distances are not known yet.
    pub(in crate::patch) fn from_fn(target: &Patches, mut choose: impl FnMut(usize, u8) -> Option<(Place, P)>) -> Self {
        let cell = |(i, &label): (usize, &u8)| match label {
            NO_PATCH => Cell::none(),
            segment => {
                choose(i, segment).map_or(Cell::none(), |(place, pose)| Cell { place, distance: u32::MAX, pose })
            }
        };
        Self { width: target.stack.width, cells: target.labels().iter().enumerate().map(cell).collect() }
    }

    /// Places by chance, within each patch's segment, and poses by chance.
    pub fn random(target: &Patches, source: &Patches, seed: u64) -> Self {
        Self::from_fn(target, |i, segment| any(source, segment, rng::hash(seed, &[i as u64])))
    }

    /// This field of a coarser level as the next finer one starts: each cell becomes four. `from` and `to` are the sources
    /// of the two levels; what has no counterpart in its segment is given a place by chance.
    pub(in crate::patch) fn refined(&self, from: &Patches, target: &Patches, to: &Patches, seed: u64) -> Self {
        let rows = self.cells.len() / self.width;
        Self::from_fn(target, |i, segment| {
            let (x, y) = (i % target.stack.width, i / target.stack.width);
            let inherited = self.near(x / 2, y / 2, rows).and_then(|(cell, cx, cy)| {
                let (image, sx, sy) = from.locate(cell.place);
                // The patch that covers the same pixels relative to the coarse match.
                let (dx, dy) = finer(cell.pose, (x as isize - 2 * cx as isize, y as isize - 2 * cy as isize));
                let along = |s: usize, d: isize| (2 * s).checked_add_signed(d);
                Some((to.at(image, along(sx, dx)?, along(sy, dy)?, segment)?, cell.pose))
            });
            inherited.or_else(|| any(to, segment, rng::hash(seed, &[i as u64])))
        })
    }

    /// This field, whose places lie in the finest source `from`, on level `level` with source `to`. Patches without a
    /// counterpart have no place.
    pub(in crate::patch) fn coarsened(&self, from: &Patches, level: usize, target: &Patches, to: &Patches) -> Self {
        let rows = self.cells.len() / self.width;
        Self::from_fn(target, |i, segment| {
            let fine = |v: usize| (v << level) + (1 << level) / 2;
            let (x, y) = (fine(i % target.stack.width), fine(i / target.stack.width));
            let (cell, cx, cy) = self.near(x, y, rows)?;
            let (image, sx, sy) = from.locate(cell.place);
            let offset = (x as i32 - cx as i32, y as i32 - cy as i32);
            let (dx, dy) = if P::UPRIGHT {
                (offset.0 as isize, offset.1 as isize)
            } else {
                cell.pose.matrix().step(offset.0, offset.1)
            };
            let along = |s: usize, d: isize| Some(s.checked_add_signed(d)? >> level);
            Some((to.at(image, along(sx, dx)?, along(sy, dy)?, segment)?, cell.pose))
        })
    }

    /// The field carried along a flow: `from(x, y)` is where the patch at a pixel was before, in pixels (centres at ½).
    pub fn carried(&self, from: impl Fn(usize, usize) -> (f32, f32)) -> Self {
        let (width, height) = (self.width, self.cells.len() / self.width.max(1));
        let cell = |i: usize| {
            let (x, y) = from(i % width, i / width);
            let inside = x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
            if inside { self.cells[y as usize * width + x as usize] } else { Cell::none() }
        };
        Self { width, cells: (0..self.cells.len()).map(cell).collect() }
    }

    /// The field with every place moved by so many frames, as `frames(pixel, cell)` says; what leaves the clip loses its
    /// place. `target` says which patches are centred where.
    pub fn shifted(&self, source: &Patches, target: &Patches, frames: impl Fn(usize, Cell<P>) -> isize) -> Self {
        let cell = |(i, &cell): (usize, &Cell<P>)| {
            let segment = target.labels()[i];
            if cell.place == Place::NONE || segment == NO_PATCH {
                return Cell::none();
            }
            let offset = Offset { t: frames(i, cell), ..Offset::default() };
            source.moved(cell.place, offset, segment).map_or(Cell::none(), |place| Cell { place, ..cell })
        };
        Self { width: self.width, cells: self.cells.iter().enumerate().map(cell).collect() }
    }

    /// The cell at `(x, y)` or, on the border where no patch is centred, at the nearest pixel that has one.
    fn near(&self, x: usize, y: usize, rows: usize) -> Option<(Cell<P>, usize, usize)> {
        const REACH: usize = 4;
        let at = |x: usize, y: usize| {
            let cell = self.cells[y * self.width + x];
            (cell.place != Place::NONE).then_some((cell, x, y))
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
    pub fn assigned(&self) -> impl Iterator<Item = (usize, Cell<P>)> {
        self.cells.iter().copied().enumerate().filter(|(_, cell)| cell.place != Place::NONE)
    }

    /// How often every pixel of the source is the centre of an assigned patch (δ of LazyFluids, Eq. 5).
    pub fn usage(&self, source: &Patches) -> Vec<u32> {
        let mut usage = vec![0; source.labels().len()];
        self.assigned().for_each(|(_, cell)| usage[cell.place.index()] += 1);
        usage
    }

    /// The field as colours: red and green are the place across and down its image, blue tells the image. Black has no patch.
    pub fn picture(&self, source: &Patches) -> Rgb8 {
        let mut out = Rgb8::black(self.width, self.cells.len() / self.width.max(1));
        for (i, cell) in self.assigned() {
            let (image, x, y) = source.locate(cell.place);
            let (width, height) = source.size(image);
            let scale = |v: usize, size: usize| (32 + 223 * v / size.max(1)) as u8;
            out.data[3 * i..3 * i + 3].copy_from_slice(&[
                scale(x, width),
                scale(y, height),
                scale(image, source.images()),
            ]);
        }
        out
    }
}

/// A patch of the segment and a pose, by chance.
fn any<P: Pose>(source: &Patches, segment: u8, chance: u64) -> Option<(Place, P)> {
    Some((Place(source.any(segment, chance)?), P::default().near(P::REACH, rng::mix(chance))))
}

/// From twice a coarse match to the finer one, for a site that lies `offset` from twice the coarse site. A turned patch turns
/// about the middle of the coarse pixel, which lies half a fine pixel right of and below twice its number (Fluidymation,
/// §3.6).
fn finer<P: Pose>(pose: P, offset: (isize, isize)) -> (isize, isize) {
    if P::UPRIGHT {
        return offset;
    }
    // In halves of a pixel.
    let (x, y) = pose.matrix().apply(2 * offset.0 as i32 - 1, 2 * offset.1 as i32 - 1);
    let whole = |v: i32| ((v + 2 * ONE) >> 17) as isize;
    (whole(x), whole(y))
}

/// Usage counts as grey levels: `mean` uses are middle grey, twice as many are white.
pub fn usage_picture(usage: &[u32], source: &Patches, mean: f64) -> Rgb8 {
    let stack = &source.stack;
    let grey = |&n: &u32| [(f64::from(n) / mean.max(f64::MIN_POSITIVE) * 127.5).min(255.0) as u8; 3];
    Rgb8 { width: stack.width, height: stack.height, data: usage.iter().flat_map(grey).collect() }
}

#[cfg(test)]
mod tests {
    use super::super::pose::Turn;
    use super::*;

    #[test]
    fn finer_fields_turn_about_the_middle_of_the_coarse_pixel() {
        assert_eq!(size_of::<Cell>(), 8);
        for offset in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            assert_eq!(finer(Upright, offset), offset);
            assert_eq!(finer(Turn::degrees(0.0), offset), offset);
            // Half a turn: the other corner.
            assert_eq!(finer(Turn::degrees(180.0), offset), (1 - offset.0, 1 - offset.1));
        }
        // A quarter clockwise: what lay to the left comes to lie above.
        let quarter = |offset| finer(Turn::degrees(90.0), offset);
        assert_eq!([quarter((0, 0)), quarter((1, 0)), quarter((0, 1))], [(0, 1), (0, 0), (1, 1)]);
    }
}
