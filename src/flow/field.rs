//! Dense motion fields.

use ndarray::Array3;

use crate::raster::image::Plane;

/// Motion in pixels per frame: what is at `x` in frame `t` is at `x + (u, v)` in frame `t + 1`; `u` right, `v` down.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Field {
    /// Horizontal component, pixels per frame, positive to the right.
    pub u: Plane,
    /// Vertical component, pixels per frame, positive downwards.
    pub v: Plane,
}

impl Field {
    /// No motion.
    pub fn zeros(width: usize, height: usize) -> Self {
        Self { u: Plane::zeros(width, height), v: Plane::zeros(width, height) }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.u.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.u.height
    }

    /// Length of the motion vectors.
    pub fn magnitude(&self) -> Plane {
        let data = self.u.data.iter().zip(&self.v.data).map(|(u, v)| (u * u + v * v).sqrt()).collect();
        Plane::from_vec(self.width(), self.height(), data)
    }

    /// As an array (y, x, component).
    pub fn to_array(&self) -> Array3<f32> {
        let [u, v] = [&self.u, &self.v];
        Array3::from_shape_fn((self.height(), self.width(), 2), |(y, x, c)| [u, v][c].at(x, y))
    }
}
