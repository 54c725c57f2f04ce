//! Variants of a clip (flip × scale × rotation) and how their coordinates map to the clip's.
//!
//! A clip at one of the scales is a *level*; a level, flipped and then rotated about its centre, is a *variant*, on a
//! canvas just large enough. Positions are continuous, in pixels, centres at ½.

use serde::{Deserialize, Serialize};

/// Side of a piece, in pixels of its variant (Okabe et al. 2011, §4).
pub const PIECE: usize = 48;
/// Side of a cell of the descriptor grids, in pixels of the level.
pub const CELL: usize = 4;
/// Cells along a side of a piece.
pub const PIECE_CELLS: usize = PIECE / CELL;

/// The scales of a clip, as fractions of the working size (Okabe et al. 2011, §4).
pub const SCALES: [f32; 3] = [1.0, 0.75, 0.5];
/// The rotations of a clip, in degrees, image axes (positive turns right to down).
pub const ROTATIONS: [f32; 3] = [0.0, -22.5, 22.5];

/// One of the 18 variants of a clip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Variant {
    /// Mirrored left to right.
    pub flip: bool,
    /// Index into [`SCALES`].
    pub scale: u8,
    /// Index into [`ROTATIONS`].
    pub rotation: u8,
}

impl Variant {
    /// Number of variants.
    pub const COUNT: usize = 2 * SCALES.len() * ROTATIONS.len();

    /// All variants, by [`Variant::index`].
    pub fn all() -> impl Iterator<Item = Variant> {
        (0..Self::COUNT as u8).map(|i| Variant::from_index(i).expect("index below COUNT"))
    }

    /// Number of this variant, `0..COUNT`; unflipped, full scale, unrotated is 0.
    pub fn index(self) -> u8 {
        (self.scale * ROTATIONS.len() as u8 + self.rotation) * 2 + u8::from(self.flip)
    }

    /// The variant of that number, if there is one.
    pub fn from_index(index: u8) -> Option<Self> {
        let rotations = ROTATIONS.len() as u8;
        let variant = Self { flip: index % 2 == 1, rotation: index / 2 % rotations, scale: index / 2 / rotations };
        ((index as usize) < Self::COUNT).then_some(variant)
    }

    /// Scale factor relative to the clip's working size.
    pub fn scale_factor(self) -> f32 {
        SCALES[self.scale as usize]
    }

    /// Rotation in degrees, image axes.
    pub fn degrees(self) -> f32 {
        ROTATIONS[self.rotation as usize]
    }

    /// Geometry for a clip of `width` × `height` working pixels (multiples of 16).
    pub fn geometry(self, width: usize, height: usize) -> Geometry {
        let (lw, lh) = level_size(width, height, self.scale);
        // cos and sin of 22.5° as literals: library transcendentals may differ in the last bit between machines.
        let (cos, sin) = match self.rotation {
            0 => (1.0, 0.0),
            1 => (0.923_879_5, -0.382_683_43),
            _ => (0.923_879_5, 0.382_683_43),
        };
        let (w, h) = (lw as f32, lh as f32);
        let (width, height) = if self.rotation == 0 {
            (lw, lh)
        } else {
            let up = |v: f32| (v / CELL as f32).ceil() as usize * CELL;
            (up(w * cos + h * f32::abs(sin)), up(w * f32::abs(sin) + h * cos))
        };
        Geometry { level_width: lw, level_height: lh, width, height, flip: self.flip, cos, sin }
    }
}

/// Size of a clip of `width` × `height` working pixels (multiples of 16) at scale number `scale`.
pub fn level_size(width: usize, height: usize, scale: u8) -> (usize, usize) {
    let of = |v: usize| match scale {
        0 => v,
        1 => v * 3 / 4,
        _ => v / 2,
    };
    (of(width), of(height))
}

/// How a variant's canvas lies on its level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// Width of the level in pixels.
    pub level_width: usize,
    /// Height of the level in pixels.
    pub level_height: usize,
    /// Width of the variant's canvas in pixels.
    pub width: usize,
    /// Height of the variant's canvas in pixels.
    pub height: usize,
    flip: bool,
    cos: f32,
    sin: f32,
}

impl Geometry {
    /// Level position shown at canvas position `(x, y)`.
    #[inline]
    pub fn to_level(&self, x: f32, y: f32) -> (f32, f32) {
        let (dx, dy) = (x - 0.5 * self.width as f32, y - 0.5 * self.height as f32);
        let lx = self.cos * dx + self.sin * dy + 0.5 * self.level_width as f32;
        let ly = -self.sin * dx + self.cos * dy + 0.5 * self.level_height as f32;
        (if self.flip { self.level_width as f32 - lx } else { lx }, ly)
    }

    /// Canvas position of level position `(x, y)`.
    #[cfg(test)]
    pub fn from_level(&self, x: f32, y: f32) -> (f32, f32) {
        let x = if self.flip { self.level_width as f32 - x } else { x };
        let (dx, dy) = (x - 0.5 * self.level_width as f32, y - 0.5 * self.level_height as f32);
        let vx = self.cos * dx - self.sin * dy + 0.5 * self.width as f32;
        let vy = self.sin * dx + self.cos * dy + 0.5 * self.height as f32;
        (vx, vy)
    }

    /// A motion vector of the level as it appears in the variant.
    #[inline]
    pub fn vector_from_level(&self, u: f32, v: f32) -> (f32, f32) {
        let u = if self.flip { -u } else { u };
        (self.cos * u - self.sin * v, self.sin * u + self.cos * v)
    }

    /// True when the square of `side` pixels at canvas position `(x, y)` shows only the level's own pixels.
    pub fn covers(&self, x: usize, y: usize, side: usize) -> bool {
        let eps = 1e-3;
        let (x1, y1) = ((x + side) as f32, (y + side) as f32);
        [(x as f32, y as f32), (x1, y as f32), (x as f32, y1), (x1, y1)].into_iter().all(|(cx, cy)| {
            let (lx, ly) = self.to_level(cx, cy);
            lx >= -eps && ly >= -eps && lx <= self.level_width as f32 + eps && ly <= self.level_height as f32 + eps
        })
    }

    /// True when the variant's cells fall on the level's cells (no rotation).
    pub fn aligned(&self) -> bool {
        self.sin == 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_round_trip() {
        for (i, variant) in Variant::all().enumerate() {
            assert_eq!(variant.index() as usize, i);
        }
        assert_eq!(Variant::from_index(18), None);
    }

    #[test]
    fn canvas_and_level_are_inverse_maps() {
        for variant in Variant::all() {
            let g = variant.geometry(640, 352);
            let (x, y) = g.to_level(100.25, 50.5);
            let (cx, cy) = g.from_level(x, y);
            assert!((cx - 100.25).abs() < 1e-3 && (cy - 50.5).abs() < 1e-3, "{variant:?}");
        }
    }

    #[test]
    fn vectors_turn_with_the_picture() {
        for variant in Variant::all() {
            let g = variant.geometry(640, 352);
            let (ax, ay) = g.from_level(200.0, 100.0);
            let (bx, by) = g.from_level(203.0, 101.0);
            let (u, v) = g.vector_from_level(3.0, 1.0);
            assert!((bx - ax - u).abs() < 1e-3 && (by - ay - v).abs() < 1e-3, "{variant:?}");
        }
    }

    #[test]
    fn rotated_corners_are_not_covered() {
        let g = Variant { flip: false, scale: 0, rotation: 2 }.geometry(640, 352);
        assert!(!g.covers(0, 0, PIECE));
        assert!(g.covers(g.width / 2 - 24, g.height / 2 - 24, PIECE));
    }
}
