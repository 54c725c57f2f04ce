//! Reading a band of a level through the geometry of a placed piece.

use macro_rules_attribute::apply;

use super::layout::Placement;
use crate::base::instructions::kernel;
use crate::library::variant::Geometry;
use crate::raster::catmull_rom;
use crate::raster::image::Plane;

/// A rectangle of a band's canvas, and where in the band of the level each of its pixels lies.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// Left edge on the band's canvas.
    pub x: usize,
    /// Top edge on the band's canvas.
    pub y: usize,
    /// Width in pixels of the band.
    pub width: usize,
    /// Height in pixels of the band.
    pub height: usize,
    map: Map,
}

/// Position on the level's band of a window's pixel `(i, j)`: `origin + i * right + j * down`, centres at ½.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Map {
    origin: (f32, f32),
    right: (f32, f32),
    down: (f32, f32),
}

impl Map {
    #[inline(always)]
    fn at(&self, i: usize, j: usize) -> (f32, f32) {
        let (i, j) = (i as f32, j as f32);
        (self.origin.0 + i * self.right.0 + j * self.down.0, self.origin.1 + i * self.right.1 + j * self.down.1)
    }
}

impl Window {
    /// The window `x0..x1`, `y0..y1` (pixels of the band's canvas) for a placement, at band `band` (0 = full size).
    pub fn new(placement: &Placement, geometry: &Geometry, band: usize, x: (usize, usize), y: (usize, usize)) -> Self {
        let step = (1u32 << band) as f32;
        let offset = |piece: usize, node: usize| piece as f32 - node as f32;
        let (ox, oy) = (offset(placement.piece.0, placement.node.0), offset(placement.piece.1, placement.node.1));
        let level = |i: f32, j: f32| {
            let (cx, cy) = ((x.0 as f32 + 0.5 + i) * step + ox, (y.0 as f32 + 0.5 + j) * step + oy);
            let (lx, ly) = geometry.to_level(cx, cy);
            (lx / step, ly / step)
        };
        let (origin, right, down) = (level(0.0, 0.0), level(1.0, 0.0), level(0.0, 1.0));
        let minus = |a: (f32, f32)| (a.0 - origin.0, a.1 - origin.1);
        let map = Map { origin, right: minus(right), down: minus(down) };
        Self { x: x.0, y: y.0, width: x.1 - x.0, height: y.1 - y.0, map }
    }

    /// The same footage over the window `x0..x1`, `y0..y1`, which may reach beyond this one.
    pub fn moved_to(&self, x: (usize, usize), y: (usize, usize)) -> Self {
        let Map { origin, right, down } = self.map;
        let (i, j) = (x.0 as f32 - self.x as f32, y.0 as f32 - self.y as f32);
        let origin = (origin.0 + i * right.0 + j * down.0, origin.1 + i * right.1 + j * down.1);
        Self { x: x.0, y: y.0, width: x.1 - x.0, height: y.1 - y.0, map: Map { origin, right, down } }
    }

    /// Position of pixel `(i, j)` of the window on the level's band, centres at ½.
    pub fn position(&self, i: usize, j: usize) -> (f32, f32) {
        self.map.at(i, j)
    }

    /// Adds `weights` × the band of the level to the canvas, over the window.
    pub fn accumulate(&self, band: &Plane, weights: &[f32], canvas: &mut Plane) {
        match self.whole_shift() {
            Some((x, flip)) => self.accumulate_rows(band, weights, canvas, x, flip),
            None => self.accumulate_sampled(band, weights, canvas),
        }
    }

    /// Left-most band column of the first pixel and whether columns run backwards, when pixels fall on pixels.
    fn whole_shift(&self) -> Option<(isize, bool)> {
        let Map { origin, right, down } = self.map;
        let whole = |v: f32| (v - 0.5 - (v - 0.5).round()).abs() < 1e-3;
        let upright = right.1.abs() < 1e-4 && down.0.abs() < 1e-4;
        (upright && whole(origin.0) && whole(origin.1)).then(|| ((origin.0 - 0.5).round() as isize, right.0 < 0.0))
    }

    fn accumulate_rows(&self, band: &Plane, weights: &[f32], canvas: &mut Plane, x: isize, flip: bool) {
        let width = self.width as isize;
        let left = if flip { x - width + 1 } else { x };
        let inside = left >= 0 && left + width <= band.width as isize;
        let top = (self.map.origin.1 - 0.5).round() as isize;
        let mut edge = vec![0.0; self.width];
        for (j, weights) in weights.chunks_exact(self.width).enumerate() {
            let row = band.row((top + j as isize).clamp(0, band.height as isize - 1) as usize);
            let source = if inside {
                &row[left as usize..left as usize + self.width]
            } else {
                let at = |i: usize| (left + i as isize).clamp(0, band.width as isize - 1) as usize;
                edge.iter_mut().enumerate().for_each(|(i, e)| *e = row[at(i)]);
                &edge
            };
            let out = &mut canvas.row_mut(self.y + j)[self.x..self.x + self.width];
            if flip {
                out.iter_mut().zip(weights).zip(source.iter().rev()).for_each(|((o, w), s)| *o += w * s);
            } else {
                out.iter_mut().zip(weights).zip(source).for_each(|((o, w), s)| *o += w * s);
            }
        }
    }

    fn accumulate_sampled(&self, band: &Plane, weights: &[f32], canvas: &mut Plane) {
        for (j, weights) in weights.chunks_exact(self.width).enumerate() {
            let out = &mut canvas.row_mut(self.y + j)[self.x..self.x + self.width];
            sample_row(band, self.map, j, weights, out);
        }
    }
}

/// Adds `weights` × the band, where row `j` of the window lies on it.
#[apply(kernel)]
fn sample_row(band: &Plane, map: Map, j: usize, weights: &[f32], out: &mut [f32]) {
    for (i, (o, &w)) in out.iter_mut().zip(weights).enumerate() {
        if w != 0.0 {
            let (x, y) = map.at(i, j);
            *o += w * catmull_rom::sample(band, x, y);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::library::variant::Variant;

    fn placement(variant: Variant) -> Placement {
        Placement { node: (24, 48), source: 0, variant, piece: (32, 20), cells: Vec::new() }
    }

    #[test]
    fn every_variant_reads_where_its_geometry_points() {
        for variant in Variant::all() {
            let geometry = variant.geometry(320, 240);
            let level = Plane::from_fn(geometry.level_width, geometry.level_height, |x, y| {
                0.3 * (x as f32 + 0.5) - 0.2 * (y as f32 + 0.5)
            });
            let p = placement(variant);
            let window = Window::new(&p, &geometry, 0, (24, 72), (48, 96));
            let mut canvas = Plane::zeros(160, 160);
            window.accumulate(&level, &[1.0; 48 * 48], &mut canvas);
            for (x, y) in [(30, 50), (71, 95), (24, 48)] {
                let (lx, ly) = geometry.to_level(x as f32 + 0.5 - 24.0 + 32.0, y as f32 + 0.5 - 48.0 + 20.0);
                let inside = lx > 2.0 && ly > 2.0 && lx < level.width as f32 - 2.0 && ly < level.height as f32 - 2.0;
                let expected = 0.3 * lx - 0.2 * ly;
                assert!(!inside || (canvas.at(x, y) - expected).abs() < 1e-3, "{variant:?} at {x},{y}");
            }
        }
    }

    #[test]
    fn unrotated_pieces_are_copied_exactly_on_three_bands() {
        for flip in [false, true] {
            let variant = Variant { flip, scale: 0, rotation: 0 };
            let geometry = variant.geometry(320, 240);
            for band in 0..3 {
                let window = Window::new(
                    &placement(variant),
                    &geometry,
                    band,
                    (24 >> band, 72 >> band),
                    (48 >> band, 96 >> band),
                );
                assert_eq!(window.whole_shift().map(|s| s.1), Some(flip), "band {band}");
            }
        }
    }
}
