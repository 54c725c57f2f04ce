//! Cuts variants into pieces and describes them (Okabe et al. 2011, §4).

use super::metadata::PieceCounts;
use super::segment::Segment;
use super::tile::{GridView, Tile};
use super::variant::{Geometry, PIECE, SCALES, Variant, level_size};
use crate::base::error::Result;
use crate::base::par;
use crate::descriptor::dense_sift::{self, DescriptorGrid};
use crate::raster::catmull_rom;
use crate::raster::image::Plane;
use crate::raster::resample;

/// Places of pieces on one variant's canvas, and what became of the others.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Cut {
    /// Left and top edges, pixels, ordered by left, then top.
    pub places: Vec<(u16, u16)>,
    /// Kept and dropped.
    pub counts: PieceCounts,
}

/// Which places of a variant's regular grid become pieces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cutting {
    /// Distance of neighbouring pieces, pixels, a multiple of 4.
    pub stride: usize,
    /// Least share of moving pixels, thousandths.
    pub moving_permille: u32,
}

impl Cutting {
    /// Cuts one variant of a clip whose cells at the variant's scale are `grid`.
    pub fn cut(&self, grid: &GridView, geometry: &Geometry) -> Cut {
        let mut cut = Cut::default();
        let steps = |side: usize| (0..(side + 1).saturating_sub(PIECE)).step_by(self.stride.max(4));
        for x in steps(geometry.width) {
            for y in steps(geometry.height) {
                if !geometry.covers(x, y, PIECE) {
                    cut.counts.outside += 1;
                } else if Tile::sample(grid, geometry, x, y).moving() * 1000.0 < self.moving_permille as f32 {
                    cut.counts.still += 1;
                } else {
                    cut.counts.kept += 1;
                    cut.places.push((x as u16, y as u16));
                }
            }
        }
        cut
    }

    /// Cuts all variants of a clip, by [`Variant::index`].
    ///
    /// # Errors
    /// When the segment is damaged.
    pub fn cut_all(&self, segment: &Segment) -> Result<Vec<Cut>> {
        let (width, height) = (segment.meta.width as usize, segment.meta.height as usize);
        let variants: Vec<Variant> = Variant::all().collect();
        par::try_map(variants.len(), |i| {
            let grid = segment.grid(variants[i].scale)?;
            Ok(self.cut(&grid, &variants[i].geometry(width, height)))
        })
    }
}

/// Luma of a clip's average image at every scale, from which the variants' pictures are made.
pub struct Levels {
    width: usize,
    height: usize,
    luma: [Plane; SCALES.len()],
}

impl Levels {
    /// Those of an analysed clip.
    ///
    /// # Errors
    /// When the segment is damaged.
    pub fn of(segment: &Segment) -> Result<Self> {
        Ok(Self::new(&segment.average()?.luma()))
    }

    /// Those of a picture at working size (multiples of 16).
    pub fn new(luma: &Plane) -> Self {
        let level = |scale: usize| {
            let (w, h) = level_size(luma.width, luma.height, scale as u8);
            resample::resize(luma, w, h)
        };
        Self { width: luma.width, height: luma.height, luma: std::array::from_fn(level) }
    }

    /// Descriptors of one variant, on the 4-px grid of its canvas.
    pub fn describe(&self, variant: Variant) -> DescriptorGrid {
        let geometry = variant.geometry(self.width, self.height);
        dense_sift::describe(&turn(&self.luma[variant.scale as usize], &geometry))
    }
}

/// A level's picture on its variant's canvas. Flips are exact; rotations sample with a Catmull–Rom cubic, and show the
/// border's pixels outside the level.
pub fn turn(level: &Plane, geometry: &Geometry) -> Plane {
    let sample = |x: usize, y: usize| {
        let (lx, ly) = geometry.to_level(x as f32 + 0.5, y as f32 + 0.5);
        if geometry.aligned() { level.at(lx as usize, ly as usize) } else { catmull_rom::sample(level, lx, ly) }
    };
    Plane::from_fn(geometry.width, geometry.height, sample)
}

#[cfg(test)]
mod tests {
    use half::f16;

    use super::*;
    use crate::base::rng;
    use crate::library::grid::CellGrid;

    fn smooth_noise(width: usize, height: usize) -> Plane {
        let noise = Plane::from_fn(width, height, |x, y| rng::unit(rng::hash(1, &[x as u64, y as u64])));
        crate::raster::filter::gaussian(&noise, 2.0)
    }

    #[test]
    fn a_flip_is_exact_and_turning_back_gives_the_level() {
        let level = smooth_noise(160, 96);
        let flipped = turn(&level, &Variant { flip: true, scale: 0, rotation: 0 }.geometry(160, 96));
        assert!((0..96).all(|y| (0..160).all(|x| flipped.at(x, y) == level.at(159 - x, y))));
        for variant in Variant::all().filter(|v| v.scale == 0 && v.rotation > 0) {
            let geometry = variant.geometry(160, 96);
            let canvas = turn(&level, &geometry);
            for (x, y) in [(80, 48), (60, 40), (100, 55)] {
                let (cx, cy) = geometry.from_level(x as f32 + 0.5, y as f32 + 0.5);
                assert!((catmull_rom::sample(&canvas, cx, cy) - level.at(x, y)).abs() < 0.01, "{variant:?} at {x},{y}");
            }
        }
    }

    #[test]
    fn pieces_lie_inside_move_and_are_all_accounted_for() {
        let mut grid = CellGrid::for_clip(320, 192, 0);
        let width = grid.width;
        for (i, cell) in grid.cells.iter_mut().enumerate() {
            cell.significant = if i % width < width / 2 { f16::ONE } else { f16::ZERO };
        }
        let cutting = Cutting { stride: 16, moving_permille: 50 };
        for variant in Variant::all().filter(|v| v.scale == 0) {
            let geometry = variant.geometry(320, 192);
            let cut = cutting.cut(&GridView::from(&grid), &geometry);
            let side = |n: usize| (n - PIECE) / 16 + 1;
            let PieceCounts { kept, outside, still } = cut.counts;
            assert_eq!((kept + outside + still) as usize, side(geometry.width) * side(geometry.height));
            assert_eq!(kept as usize, cut.places.len());
            assert!(cut.places.is_sorted() && kept > 0 && still > 0 && (outside > 0) == (variant.rotation > 0));
            for &(x, y) in &cut.places {
                assert!(geometry.covers(x as usize, y as usize, PIECE));
                let (lx, _) = geometry.to_level(f32::from(x) + 24.0, f32::from(y) + 24.0);
                assert!(lx < 160.0 + 34.0, "{variant:?}: a piece that does not move");
            }
        }
    }

    #[test]
    fn the_descriptors_of_a_flipped_variant_are_the_flipped_descriptors() {
        let levels = Levels::new(&smooth_noise(160, 96));
        for scale in 0..3 {
            let plain = levels.describe(Variant { flip: false, scale, rotation: 0 });
            let flipped = levels.describe(Variant { flip: true, scale, rotation: 0 });
            for (i, j) in [(0, 0), (3, 2), (7, 5)] {
                let (a, b) = (plain.at(i, j), flipped.at(plain.width - 1 - i, j));
                assert!((0..a.len()).all(|k| a[k] == b[dense_sift::mirrored(k)]), "scale {scale} at {i},{j}");
            }
        }
    }
}
