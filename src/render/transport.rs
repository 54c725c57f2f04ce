//! A plane carried one frame along a flow that does not change.

use crate::base::par;
use crate::flow::field::Field;
use crate::raster::catmull_rom;
use crate::raster::image::Plane;

/// What flows in over the border of a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Inflow {
    /// The border goes on.
    Border,
    /// Nothing: what was carried round would come back as an echo, and draw lines along a steady flow.
    Nothing,
}

/// Where what is seen at each pixel was a frame before.
#[derive(Debug, Clone, PartialEq)]
pub struct Transport {
    width: usize,
    /// None where nothing was.
    places: Vec<Option<(f32, f32)>>,
}

impl Transport {
    /// Along `flow`, pixels per frame (midpoint rule).
    pub fn along(flow: &Field, inflow: Inflow) -> Self {
        let (width, height) = (flow.width(), flow.height());
        let at = |x: f32, y: f32| (flow.u.bilinear(x, y), flow.v.bilinear(x, y));
        let place = |i: usize| {
            let (x, y) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let (u, v) = (flow.u.data[i], flow.v.data[i]);
            let (u, v) = at(x - 0.5 * u, y - 0.5 * v);
            let (x, y) = (x - u, y - v);
            let inside = (0.0..=width as f32).contains(&x) && (0.0..=height as f32).contains(&y);
            (inside || inflow == Inflow::Border).then_some((x, y))
        };
        Self { width, places: par::map(width * height, place) }
    }

    /// The plane a frame later.
    pub fn apply(&self, plane: &Plane) -> Plane {
        let mut out = Plane::zeros(plane.width, plane.height);
        par::for_each_chunk(&mut out.data, self.width.max(1), |y, row| {
            let places = &self.places[y * self.width..][..row.len()];
            row.iter_mut().zip(places).for_each(|(v, p)| *v = p.map_or(0.0, |(x, y)| catmull_rom::sample(plane, x, y)));
        });
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_carried_is_as_far_downstream_as_the_flow_says() {
        let wave = |x: f32, y: f32| (0.2 * x).sin() + (0.15 * y).cos();
        let plane = Plane::from_fn(60, 50, |x, y| wave(x as f32, y as f32));
        let flow = Field { u: Plane::filled(60, 50, 2.25), v: Plane::filled(60, 50, -1.5) };
        let carried = Transport::along(&flow, Inflow::Border).apply(&plane);
        for (x, y) in [(10, 10), (30, 25), (55, 40)] {
            let wanted = wave(x as f32 - 2.25, y as f32 + 1.5);
            assert!((carried.at(x, y) - wanted).abs() < 5e-3, "{} {wanted}", carried.at(x, y));
        }
        let still = Transport::along(&Field::zeros(60, 50), Inflow::Nothing).apply(&plane);
        assert!(still.data.iter().zip(&plane.data).all(|(a, b)| (a - b).abs() < 1e-6));
    }

    #[test]
    fn over_the_border_comes_the_border_or_nothing() {
        let plane = Plane::filled(40, 30, 1.0);
        let flow = Field { u: Plane::filled(40, 30, 4.0), v: Plane::zeros(40, 30) };
        let row = |inflow| Transport::along(&flow, inflow).apply(&plane).row(15).to_vec();
        assert!(row(Inflow::Border).iter().all(|v| (v - 1.0).abs() < 1e-5));
        let fresh = row(Inflow::Nothing);
        assert!(fresh[..3].iter().all(|&v| v == 0.0) && fresh[4..].iter().all(|v| (v - 1.0).abs() < 1e-5), "{fresh:?}");
    }
}
