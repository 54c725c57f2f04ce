//! Who is asked to leave a place, see [`super::exchange`].

use crate::patch::data::field::Cell;

/// Nobody: the place has room.
pub(in crate::patch) const NOBODY: u32 = u32::MAX;

/// A place of the atlas, as those see it who would like to have it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asked {
    /// Who would have to leave: the one that would lose least, or any one by chance.
    pub holder: u32,
    /// Its distance here.
    pub held: u32,
    /// What it wished for last.
    pub wish: Cell,
    /// Whether one more patch may come without any other leaving.
    pub has_room: bool,
}

impl Asked {
    /// What the holder would lose by taking what it wished for last; negative if it would gain.
    pub fn loss(&self) -> i64 {
        i64::from(self.wish.distance) - i64::from(self.held)
    }

    /// Says who is asked from now on.
    pub fn hold(&mut self, holder: u32, held: Cell, wish: Cell) {
        (self.holder, self.held, self.wish) = (holder, held.distance, wish);
    }
}
