//! A plane carried one frame along a flow that does not change.

use super::mirror::Mirror;
use crate::base::par;
use crate::flow::field::Field;
use crate::raster::catmull_rom;
use crate::raster::image::Plane;

/// Where what is seen at each pixel was a frame before.
#[derive(Debug, Clone, PartialEq)]
pub struct Transport {
    width: usize,
    places: Vec<(f32, f32)>,
}

impl Transport {
    /// Along `flow`, pixels per frame (midpoint rule); what comes from where there is no fluid comes from the `mirror`, or
    /// else from the border.
    pub fn along(flow: &Field, mirror: Option<&Mirror>) -> Self {
        let (width, height) = (flow.width(), flow.height());
        let at = |x: f32, y: f32| (flow.u.bilinear(x, y), flow.v.bilinear(x, y));
        let place = |i: usize| {
            let (x, y) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let (u, v) = (flow.u.data[i], flow.v.data[i]);
            let (u, v) = at(x - 0.5 * u, y - 0.5 * v);
            mirror.map_or((x - u, y - v), |mirror| mirror.place(x - u, y - v))
        };
        Self { width, places: par::map(width * height, place) }
    }

    /// The plane a frame later.
    pub fn apply(&self, plane: &Plane) -> Plane {
        let mut out = Plane::zeros(plane.width, plane.height);
        par::for_each_chunk(&mut out.data, self.width.max(1), |y, row| {
            let places = &self.places[y * self.width..][..row.len()];
            row.iter_mut().zip(places).for_each(|(v, &(x, y))| *v = catmull_rom::sample(plane, x, y));
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
        let carried = Transport::along(&flow, None).apply(&plane);
        for (x, y) in [(10, 10), (30, 25), (55, 40)] {
            let wanted = wave(x as f32 - 2.25, y as f32 + 1.5);
            assert!((carried.at(x, y) - wanted).abs() < 5e-3, "{} {wanted}", carried.at(x, y));
        }
        let still = Transport::along(&Field::zeros(60, 50), None).apply(&plane);
        assert!(still.data.iter().zip(&plane.data).all(|(a, b)| (a - b).abs() < 1e-6));
    }

    #[test]
    fn what_flows_in_over_the_edge_is_fluid_in_the_mirror() {
        let matte = Plane::from_fn(40, 30, |x, _| f32::from(x >= 20));
        let plane = Plane::from_fn(40, 30, |x, _| if x < 20 { 9.0 } else { 1.0 });
        let flow = Field { u: Plane::filled(40, 30, 4.0), v: Plane::zeros(40, 30) };
        let carried = Transport::along(&flow, Some(&Mirror::new(&matte))).apply(&plane);
        assert!((24..40).chain([22]).all(|x| (carried.at(x, 15) - 1.0).abs() < 1e-3), "{:?}", carried.row(15));
    }
}
