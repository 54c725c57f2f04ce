//! Where patches of the target are centred: what a search has to know of it, whatever it is.
//!
//! A picture's pixels are sites. So are those of a height field, whose frames stretch and turn what is laid on them.

use super::channels::Layout;
use super::patches::Patches;
use super::pose::Matrix;

/// A site beside another, and how far it is: pixels across and down in the other's frame.
pub type Neighbour = (usize, (i32, i32));

/// Sites of patches, numbered from 0 such that near ones mostly have near numbers.
pub trait Sites: Sync {
    /// Whether every frame is the identity, so that upright patches can be compared where they lie.
    fn in_place(&self) -> bool;

    /// Number of sites, those without a patch included.
    fn count(&self) -> usize;

    /// Sites that one thread goes through in order; the result depends on it, so it must not depend on the machine.
    fn band(&self) -> usize;

    /// The segment of each site, see [`super::segments`].
    fn labels(&self) -> &[u8];

    /// Sites beside this one of lower number, or with `after` of higher.
    fn neighbours(&self, site: usize, after: bool) -> [Option<Neighbour>; 2];

    /// From offsets on the target to offsets in the source, before a pose.
    fn frame(&self, site: usize) -> Matrix;

    /// The patch of a site, from its first byte on, and the bytes from one of its rows to the next; what is not there as it
    /// is needed is put into `buffer`.
    fn rows<'a>(&'a self, site: usize, layout: &Layout, buffer: &'a mut Vec<u8>) -> (&'a [u8], usize);

    /// Whether two sites are less than so many pixels apart across and down.
    fn are_near(&self, a: usize, b: usize, pixels: usize) -> bool;
}

/// Rows of a picture that one thread goes through.
pub(in crate::patch) const BAND: usize = 16;

impl Sites for Patches {
    #[inline]
    fn in_place(&self) -> bool {
        self.frames.is_none()
    }

    fn count(&self) -> usize {
        Patches::labels(self).len()
    }

    fn band(&self) -> usize {
        BAND * self.stack.width
    }

    fn labels(&self) -> &[u8] {
        Patches::labels(self)
    }

    #[inline]
    fn neighbours(&self, site: usize, after: bool) -> [Option<Neighbour>; 2] {
        let sign = if after { 1 } else { -1 };
        // Where the neighbour has a patch, the row does not end between them.
        let beside = |x: i32, y: i32| self.pixel_beside(site, (x as isize, y as isize)).map(|i| (i, (x, y)));
        [beside(sign, 0), beside(0, sign)]
    }

    #[inline]
    fn frame(&self, site: usize) -> Matrix {
        self.frames.as_ref().map_or(Matrix::IDENTITY, |frames| frames[site])
    }

    #[inline]
    fn rows<'a>(&'a self, site: usize, layout: &Layout, _: &'a mut Vec<u8>) -> (&'a [u8], usize) {
        let corner = (site - layout.radius() * (self.stack.width + 1)) * self.stack.channels;
        (&self.stack.bytes()[corner..], self.stack.stride())
    }

    fn are_near(&self, a: usize, b: usize, pixels: usize) -> bool {
        let w = self.stack.width;
        (a % w).abs_diff(b % w).max((a / w).abs_diff(b / w)) < pixels
    }
}
