//! Squares of one clip, turned, as one plane over the picture.

use crate::assign::nodes::{NodeGrid, STRIDE};
use crate::assign::turned::Turned;
use crate::base::par;
use crate::library::variant::PIECE;
use crate::raster::catmull_rom;
use crate::raster::image::Plane;

/// Displacement at which two pieces of footage are no longer the same, pixels: their fine detail is unlike then.
const STRANGERS: f32 = 2.0;
/// Least weight of a square: on the border of the picture nothing else may be there.
const LEAST: f32 = 1e-3;

/// Where everything lies.
pub struct Patchwork<'a> {
    size: (usize, usize),
    grid: &'a NodeGrid,
    footage: &'a [Turned],
    /// Weight of each row or column of a square.
    window: [f32; PIECE],
    /// Factor that gives the sum of pieces the contrast of one.
    gain: Plane,
}

impl<'a> Patchwork<'a> {
    /// On a picture of `size`, `footage` for the nodes of `grid`.
    pub fn new(size: (usize, usize), grid: &'a NodeGrid, footage: &'a [Turned]) -> Self {
        let weight = |i: usize| ((i as f32 + 0.5) * std::f32::consts::PI / PIECE as f32).sin().powi(2).max(LEAST);
        let mut out = Self { size, grid, footage, window: std::array::from_fn(weight), gain: Plane::default() };
        out.gain = out.each_pixel(|x, y, over| out.contrast(x, y, over));
        out
    }

    /// Residuals of a frame, of which `planes` holds one for every phase: unlike footage is mixed without loss of
    /// contrast. 0 where no square lies.
    pub fn residual(&self, planes: &[Plane]) -> Plane {
        let mut out = self
            .each_pixel(|x, y, over| over.iter().map(|(w, f)| w * self.read(&planes[f.phase], f, x, y)).sum::<f32>());
        out.data.iter_mut().zip(&self.gain.data).for_each(|(v, g)| *v *= g);
        out
    }

    /// A quantity of the clip that does not change, mixed as what it is. 0 where no square lies.
    pub fn quantity(&self, plane: &Plane) -> Plane {
        self.each_pixel(|x, y, over| {
            let (sum, total) = over.iter().fold((0.0, 0.0), |(sum, total), (w, f)| {
                let (sx, sy) = f.place(x as f32 + 0.5, y as f32 + 0.5);
                (sum + w * plane.bilinear(sx, sy), total + w)
            });
            if total > 0.0 { sum / total } else { 0.0 }
        })
    }

    fn read(&self, plane: &Plane, footage: &Turned, x: usize, y: usize) -> f32 {
        let (sx, sy) = footage.place(x as f32 + 0.5, y as f32 + 0.5);
        catmull_rom::sample(plane, sx, sy)
    }

    /// One over the contrast that the weighted sum has where every piece has contrast 1.
    fn contrast(&self, x: usize, y: usize, over: &[(f32, &Turned)]) -> f32 {
        let place = (x as f32 + 0.5, y as f32 + 0.5);
        let of = |a: &(f32, &Turned)| over.iter().map(|b| a.0 * b.0 * a.1.alike(b.1, place, STRANGERS)).sum::<f32>();
        let variance = over.iter().map(of).sum::<f32>();
        if variance > 0.0 { 1.0 / variance.sqrt() } else { 0.0 }
    }

    /// Calls `f` with every pixel and the squares over it with their weights.
    fn each_pixel(&self, f: impl Fn(usize, usize, &[(f32, &Turned)]) -> f32 + Sync + Send) -> Plane {
        let mut out = Plane::zeros(self.size.0, self.size.1);
        par::for_each_chunk(&mut out.data, self.size.0.max(1), |y, row| {
            let mut over = Vec::with_capacity(4);
            for (x, v) in row.iter_mut().enumerate() {
                over.clear();
                over.extend(self.over(x, y));
                *v = f(x, y, &over);
            }
        });
        out
    }

    /// The squares over a pixel, four at most, with their weights.
    fn over(&self, x: usize, y: usize) -> impl Iterator<Item = (f32, &'a Turned)> {
        let before = |v: usize| [(v / STRIDE).checked_sub(1), Some(v / STRIDE)];
        let (columns, rows) = (before(x), before(y));
        let pairs = rows.into_iter().flatten().flat_map(move |r| columns.into_iter().flatten().map(move |c| (c, r)));
        pairs.filter_map(move |(column, row)| {
            let node = self.grid.number(column, row)? as usize;
            let weight = self.window[x - column * STRIDE] * self.window[y - row * STRIDE];
            Some((weight, &self.footage[node]))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{hash, unit};
    use crate::raster::filter::gaussian;

    const SIZE: (usize, usize) = (120, 96);

    fn noise(seed: u64) -> Plane {
        let at = |x: usize, y: usize| unit(hash(seed, &[x as u64, y as u64])) - 0.5;
        gaussian(&Plane::from_fn(240, 240, at), 1.2)
    }

    fn grid() -> NodeGrid {
        NodeGrid::over(&Plane::filled(SIZE.0, SIZE.1, 1.0), 0.02).unwrap()
    }

    fn footage(grid: &NodeGrid, of: impl Fn(usize, (f32, f32)) -> Turned) -> Vec<Turned> {
        let centre = |i: usize| (grid.nodes[i].x as f32 + 24.0, grid.nodes[i].y as f32 + 24.0);
        (0..grid.nodes.len()).map(|i| of(i, centre(i))).collect()
    }

    #[test]
    fn footage_that_goes_on_from_square_to_square_is_copied() {
        let (grid, plane) = (grid(), noise(1));
        let copy = footage(&grid, |_, centre| Turned {
            centre,
            source: (centre.0 + 30.0, centre.1 + 40.0),
            turn: 0.0,
            phase: 0,
        });
        let work = Patchwork::new(SIZE, &grid, &copy);
        let (out, quantity) = (work.residual(std::slice::from_ref(&plane)), work.quantity(&plane));
        for (x, y) in [(0, 0), (60, 50), (119, 95), (24, 71)] {
            assert!((out.at(x, y) - plane.at(x + 30, y + 40)).abs() < 1e-4);
            assert!((quantity.at(x, y) - plane.at(x + 30, y + 40)).abs() < 1e-4);
        }
    }

    #[test]
    fn a_turned_square_shows_its_footage_turned() {
        let grid = grid();
        // A quarter turn: what points right in the clip points down on the picture.
        let turn = std::f32::consts::FRAC_PI_2;
        let about = |p: (f32, f32)| (120.0 + p.1, 120.0 - p.0);
        let turned = footage(&grid, |_, centre| Turned { centre, source: about(centre), turn, phase: 0 });
        let slope = Plane::from_fn(240, 240, |x, _| x as f32 + 0.5);
        let out = Patchwork::new(SIZE, &grid, &turned).residual(&[slope]);
        assert!((out.at(60, 50) - out.at(60, 40) - 10.0).abs() < 1e-2, "brighter downwards");
        assert!((out.at(70, 50) - out.at(60, 50)).abs() < 1e-2);
    }

    #[test]
    fn strangers_side_by_side_keep_their_contrast() {
        let (grid, planes) = (grid(), [noise(1), noise(2)]);
        let any = |i: usize| {
            let place = |k: u64| 60.0 + 120.0 * unit(hash(i as u64, &[k]));
            (place(1), place(2), 6.0 * unit(hash(i as u64, &[3])))
        };
        let strangers =
            footage(&grid, |i, centre| Turned { centre, source: (any(i).0, any(i).1), turn: any(i).2, phase: i % 2 });
        let out = Patchwork::new(SIZE, &grid, &strangers).residual(&planes);
        let deviation = |p: &Plane| (p.data.iter().map(|v| v * v).sum::<f32>() / p.data.len() as f32).sqrt();
        let ratio = deviation(&out) / deviation(&planes[0]);
        assert!((ratio - 1.0).abs() < 0.12, "{ratio}");
    }
}
