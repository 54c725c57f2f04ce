//! Scales of the three distances of the smoothness term.

use half::slice::HalfFloatSliceExt;
use macro_rules_attribute::apply;
use serde::{Deserialize, Serialize};

use super::grid::{BANDS, Cell, TEXTURE_LEVELS};
use super::tile::Tile;
use super::variant::PIECE_CELLS;
use crate::base::instructions::kernel;
use crate::base::par;

/// Pairs of pieces the normalisers are measured on, at most.
pub const PAIRS: usize = 4096;
/// Power below which the spectrum counts as silence, (pixels per frame)².
const POWER_FLOOR: f32 = 1e-4;
/// Textureness below which a cell counts as flat, of luma in [0, 1].
const TEXTURE_FLOOR: f32 = 1e-3;
/// Share of moving pixels from which on a cell counts.
const MOVING: f32 = 0.5;

/// Medians of the smoothness distances over random neighbouring pieces; each distance is divided by its own, so that
/// the weights σ and ρ are pure numbers (Okabe et al. 2011, §5, gives no units). Distances are means over the cells
/// that two pieces share and that move in both.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Normalizers {
    /// Squared distance of the mean motion vectors, (pixels per frame)².
    pub dc: f32,
    /// Squared distance of the motion spectra, of log₂ of power, summed over the bands.
    pub ac: f32,
    /// Squared distance of the textureness, of log₂, summed over the levels.
    pub texture: f32,
}

impl Default for Normalizers {
    fn default() -> Self {
        Self { dc: 1.0, ac: 1.0, texture: 1.0 }
    }
}

impl Normalizers {
    /// Medians over pairs of consecutive `tiles`, laid side by side and one above the other in turn, overlapping by
    /// half as target nodes do. A median that would be zero (nothing to compare) becomes 1.
    pub fn measure(tiles: &[Tile]) -> Self {
        let pairs = tiles.len() / 2;
        let distances = par::map(pairs, |i| distances(&tiles[2 * i], &tiles[2 * i + 1], i % 2 == 1));
        let median = |which: usize| {
            let mut values: Vec<f32> = distances.iter().flatten().map(|d| d[which]).collect();
            values.sort_by(f32::total_cmp);
            values.get(values.len() / 2).copied().filter(|v| *v > 0.0).unwrap_or(1.0)
        };
        Self { dc: median(0), ac: median(1), texture: median(2) }
    }
}

/// The three distances between a piece and its neighbour to the right (or below), half a piece away; none when no
/// shared cell moves in both.
fn distances(a: &Tile, b: &Tile, below: bool) -> Option<[f32; 3]> {
    const HALF: usize = PIECE_CELLS / 2;
    let (mut sums, mut count) = ([0.0f32; 3], 0);
    for i in 0..HALF {
        for k in 0..PIECE_CELLS {
            let index = |near: usize| if below { near * PIECE_CELLS + k } else { k * PIECE_CELLS + near };
            let (p, q) = (&a.cells[index(HALF + i)], &b.cells[index(i)]);
            if counts(p) && counts(q) {
                let d = cell_distances(p, q);
                sums.iter_mut().zip(d).for_each(|(s, d)| *s += d);
                count += 1;
            }
        }
    }
    (count > 0).then(|| sums.map(|s| s / count as f32))
}

fn cell_distances(p: &Cell, q: &Cell) -> [f32; 3] {
    let (p, q) = (features(p), features(q));
    let distance = |range: std::ops::Range<usize>| range.map(|i| (p[i] - q[i]) * (p[i] - q[i])).sum();
    [distance(DC), distance(AC), distance(TEXTURE)]
}

/// Where the mean motion lies in [`features`].
pub const DC: std::ops::Range<usize> = 0..2;
/// Where the spectrum lies in [`features`].
pub const AC: std::ops::Range<usize> = 2..2 + BANDS;
/// Where the textureness lies in [`features`].
pub const TEXTURE: std::ops::Range<usize> = AC.end..FEATURES;
/// Number of [`features`].
pub const FEATURES: usize = 2 + BANDS + TEXTURE_LEVELS;

/// What the three distances compare: mean motion (pixels per frame), log₂ of the power per band, log₂ of the
/// textureness per level; power and textureness have a small floor added before the logarithm.
pub fn features(cell: &Cell) -> [f32; FEATURES] {
    let log = |v: half::f16, floor: f32| log2(v.to_f32().max(0.0) + floor);
    let mut out = [0.0; FEATURES];
    out[DC].iter_mut().zip(cell.mean).for_each(|(o, v)| *o = v.to_f32());
    out[AC].iter_mut().zip(cell.spectrum).for_each(|(o, v)| *o = log(v, POWER_FLOOR));
    out[TEXTURE].iter_mut().zip(cell.textureness).for_each(|(o, v)| *o = log(v, TEXTURE_FLOOR));
    out
}

/// Per cell its [`features`], its activity and its share of pixels that move.
pub fn features_of(cells: &[Cell], out: &mut [[f32; FEATURES + 2]]) {
    // A cell's numbers lie in this order.
    bytemuck::cast_slice::<Cell, half::f16>(cells).convert_to_f32_slice(out.as_flattened_mut());
    take_logarithms(out);
}

#[apply(kernel)]
fn take_logarithms(rows: &mut [[f32; FEATURES + 2]]) {
    for row in rows {
        row[AC].iter_mut().for_each(|v| *v = log2(v.max(0.0) + POWER_FLOOR));
        row[TEXTURE].iter_mut().for_each(|v| *v = log2(v.max(0.0) + TEXTURE_FLOOR));
    }
}

/// Whether a cell counts in the distances: most of its pixels move significantly.
pub fn counts(cell: &Cell) -> bool {
    cell.significant.to_f32() >= MOVING
}

/// log₂ of a positive normal number to about 1e-4, by plain sums and products: the library's own may differ in the last
/// bit between machines, and the result is stored.
#[inline(always)]
fn log2(v: f32) -> f32 {
    let bits = v.to_bits();
    let exponent = (bits >> 23) as i32 - 127;
    let m = f32::from_bits(bits & 0x007f_ffff | 0x3f80_0000);
    // log₂ m = 2/ln 2 · artanh((m − 1)/(m + 1)), the series to the seventh power.
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    exponent as f32 + s * (2.885_39 + s2 * (0.961_796_7 + s2 * (0.577_078 + s2 * 0.412_199)))
}

#[cfg(test)]
mod tests {
    use half::f16;

    use super::*;

    #[test]
    fn the_logarithm_is_one() {
        for i in 1..2000 {
            let v = 1e-4 * 1.01f32.powi(i);
            assert!((log2(v) - v.log2()).abs() < 3e-4, "{v}: {} for {}", log2(v), v.log2());
        }
    }

    #[test]
    fn medians_of_a_known_difference() {
        let tile = |u: f32, power: f32| Tile {
            cells: [Cell {
                mean: [f16::from_f32(u), f16::ZERO],
                spectrum: [f16::from_f32(power); BANDS],
                significant: f16::ONE,
                ..Cell::default()
            }; PIECE_CELLS * PIECE_CELLS],
        };
        let tiles: Vec<Tile> = (0..40).map(|i| tile((i % 2) as f32 * 2.0, [1.0, 4.0][i % 2])).collect();
        let n = Normalizers::measure(&tiles);
        assert_eq!((n.dc, n.texture), (4.0, 1.0));
        assert!((n.ac - 4.0 * BANDS as f32).abs() < 0.05, "{}", n.ac);
        assert_eq!(Normalizers::measure(&[]), Normalizers::default());
    }
}
