//! Where what is seen at a place comes from and goes to along a static flow.

use crate::base::par;
use crate::flow::field::Field;
use crate::library::variant::CELL;
use crate::raster::image::Plane;

/// Ages that are kept on each side of 0; between them ways are straight.
const AGES: usize = 16;
/// Longest step of the integration, pixels of the working image.
const STEP: f32 = 1.5;

/// Streamlines through the centre of every cell of [`CELL`] pixels of the working image.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectories {
    /// Per age from `-span` to `span`: the way from a cell's centre to where it was that many frames ago, working pixels.
    ways: Vec<Field>,
    span: f32,
}

impl Trajectories {
    /// Follows `flow`, working pixels per frame at working size and clamped beyond its borders, for `span` frames each
    /// way (midpoint rule).
    pub fn trace(flow: &Field, span: f32) -> Self {
        let size = (flow.width().div_ceil(CELL), flow.height().div_ceil(CELL));
        let frames = span / AGES as f32;
        let lines = par::map(size.0 * size.1, |cell| {
            let centre = |i: usize| (i * CELL) as f32 + 0.5 * CELL as f32;
            let start = (centre(cell % size.0), centre(cell / size.0));
            [-1.0f32, 1.0].map(|sign| {
                let follow = |place: &mut (f32, f32), _| {
                    *place = step(flow, *place, sign * frames);
                    Some((place.0 - start.0, place.1 - start.1))
                };
                (0..AGES).scan(start, follow).collect::<Vec<_>>()
            })
        });
        let way = |age: usize, cell: usize| match age.cmp(&AGES) {
            std::cmp::Ordering::Equal => (0.0, 0.0),
            // What is young comes from upstream: a positive age looks back against the flow.
            std::cmp::Ordering::Greater => lines[cell][0][age - AGES - 1],
            std::cmp::Ordering::Less => lines[cell][1][AGES - age - 1],
        };
        let plane = |age: usize, of: fn((f32, f32)) -> f32| {
            Plane::from_vec(size.0, size.1, (0..lines.len()).map(|cell| of(way(age, cell))).collect())
        };
        let field = |age: usize| Field { u: plane(age, |w| w.0), v: plane(age, |w| w.1) };
        Self { ways: par::map(2 * AGES + 1, field), span }
    }

    /// Width and height in cells.
    pub fn size(&self) -> (usize, usize) {
        (self.ways[0].width(), self.ways[0].height())
    }

    /// Way from the centre of a cell, by its index, to where what is there was `age` frames ago (negative: where it will
    /// be), working pixels; ages beyond the span count as it.
    pub fn way(&self, cell: usize, age: f32) -> (f32, f32) {
        let place = ((age / self.span + 1.0) * AGES as f32).clamp(0.0, 2.0 * AGES as f32);
        let first = (place as usize).min(2 * AGES - 1);
        let (share, from, to) = (place - first as f32, &self.ways[first], &self.ways[first + 1]);
        let between = |from: &Plane, to: &Plane| from.data[cell] + share * (to.data[cell] - from.data[cell]);
        (between(&from.u, &to.u), between(&from.v, &to.v))
    }

    /// [`Self::way`] from a place `(dx, dy)` pixels from the centre of a cell, interpolated between centres.
    pub fn way_near(&self, cell: usize, (dx, dy): (f32, f32), age: f32) -> (f32, f32) {
        let (width, height) = self.size();
        let axis = |cell: usize, d: f32, size: usize| {
            let place = (cell as f32 + d / CELL as f32).clamp(0.0, (size - 1) as f32);
            let first = (place as usize).min(size.saturating_sub(2));
            (first, (first + 1).min(size - 1), place - first as f32)
        };
        let ((x0, x1, ax), (y0, y1, ay)) = (axis(cell % width, dx, width), axis(cell / width, dy, height));
        let corners = [
            (x0, y0, (1.0 - ax) * (1.0 - ay)),
            (x1, y0, ax * (1.0 - ay)),
            (x0, y1, (1.0 - ax) * ay),
            (x1, y1, ax * ay),
        ];
        corners.into_iter().fold((0.0, 0.0), |(u, v), (x, y, weight)| {
            let way = self.way(y * width + x, age);
            (u + weight * way.0, v + weight * way.1)
        })
    }
}

/// Goes along the flow for `frames` frames, back for fewer than none.
fn step(flow: &Field, mut place: (f32, f32), frames: f32) -> (f32, f32) {
    let at = |(x, y): (f32, f32)| (flow.u.bilinear(x, y), flow.v.bilinear(x, y));
    let (u, v) = at(place);
    let steps = (u.hypot(v) * frames.abs() / STEP).ceil().max(1.0);
    let time = frames / steps;
    for _ in 0..steps as usize {
        let (u, v) = at(place);
        let (u, v) = at((place.0 + 0.5 * time * u, place.1 + 0.5 * time * v));
        place = (place.0 + time * u, place.1 + time * v);
    }
    place
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_flow_goes_straight_both_ways() {
        let flow = Field { u: Plane::filled(64, 48, 1.5), v: Plane::filled(64, 48, -0.5) };
        let lines = Trajectories::trace(&flow, 20.0);
        for age in [-20.0, -7.3, 0.0, 0.4, 11.0, 20.0] {
            let (u, v) = lines.way(77, age);
            assert!((u + 1.5 * age).abs() < 1e-3 && (v - 0.5 * age).abs() < 1e-3, "{age}: {u}, {v}");
        }
    }

    #[test]
    fn a_whirl_leads_back_to_its_start() {
        let (cx, cy, turn) = (48.0, 48.0, std::f32::consts::TAU / 40.0);
        let flow = Field {
            u: Plane::from_fn(96, 96, |_, y| -turn * (y as f32 + 0.5 - cy)),
            v: Plane::from_fn(96, 96, |x, _| turn * (x as f32 + 0.5 - cx)),
        };
        let lines = Trajectories::trace(&flow, 40.0);
        // A cell 18 pixels from the centre of the whirl: half a turn away after half the time.
        let cell = 12 * lines.size().0 + 16;
        let (x, y) = (66.0 - cx, 50.0 - cy);
        let (half, whole) = (lines.way(cell, 20.0), lines.way(cell, 40.0));
        assert!((half.0 + 2.0 * x).abs() < 0.5 && (half.1 + 2.0 * y).abs() < 0.5, "{half:?}");
        assert!(whole.0.hypot(whole.1) < 0.5, "{whole:?}");
    }
}
