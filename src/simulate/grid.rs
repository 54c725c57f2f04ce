//! The staggered grid: scalars at the centres of pixels, velocities at their sides (Harlow & Welch 1965).

use crate::flow::field::Field;
use crate::raster::image::Plane;

/// What is beyond one side of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// A wall without friction.
    #[default]
    Closed,
    /// More room: the fluid leaves and comes in freely.
    Open,
}

/// The four sides of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct Sides {
    /// At x = 0.
    pub left: Side,
    /// At x = width.
    pub right: Side,
    /// At y = 0.
    pub top: Side,
    /// At y = height.
    pub bottom: Side,
}

/// Velocities in pixels per frame: `u` at the left and right sides of pixels, `v` at their upper and lower sides.
#[derive(Debug, Clone, PartialEq)]
pub struct Velocity {
    /// `(width + 1)` × `height`; `(x, y)` is the left side of pixel `(x, y)`; positive to the right.
    pub u: Plane,
    /// `width` × `(height + 1)`; `(x, y)` is the upper side of pixel `(x, y)`; positive downwards.
    pub v: Plane,
}

impl Velocity {
    /// The same velocity everywhere, where `domain` lets it through.
    pub fn uniform(domain: &Domain, [u, v]: [f32; 2]) -> Self {
        let through = |weight: f32, speed: f32| if weight > 0.0 { speed } else { 0.0 };
        Self { u: domain.pass_u.map(|w| through(w, u)), v: domain.pass_v.map(|w| through(w, v)) }
    }

    /// The greatest component, pixels per frame; not a number where one is not.
    pub fn greatest(&self) -> f32 {
        let (u, v) = (greatest(&self.u.data), greatest(&self.v.data));
        if u.is_nan() { u } else { v.max(u) + 0.0 * v }
    }

    /// Velocities at the centres of pixels.
    pub fn centred(&self) -> Field {
        let (width, height) = (self.v.width, self.u.height);
        let mut field = Field::zeros(width, height);
        for y in 0..height {
            let (u, above, below) = (self.u.row(y), self.v.row(y), self.v.row(y + 1));
            let (left, right) = (&u[..width], &u[1..]);
            field.u.row_mut(y).iter_mut().zip(left).zip(right).for_each(|((o, a), b)| *o = 0.5 * (a + b));
            field.v.row_mut(y).iter_mut().zip(above).zip(below).for_each(|((o, a), b)| *o = 0.5 * (a + b));
        }
        field
    }
}

/// Where the fluid may be: pixels and the sides between them.
#[derive(Debug, Clone)]
pub struct Domain {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// One value a pixel, true in obstacles.
    pub solid: Vec<bool>,
    /// What is beyond the picture.
    pub sides: Sides,
    /// How much a step of pressure across a vertical side of a pixel drives the fluid through it: 0 at obstacles and
    /// walls, 1 inside, 2 at open sides of the picture, where the pressure is 0 half a pixel away.
    pub pass_u: Plane,
    /// The same for horizontal sides.
    pub pass_v: Plane,
}

impl Domain {
    /// A picture of `width` × `height` pixels with obstacles.
    ///
    /// # Panics
    /// When `solid` has not one value a pixel.
    pub fn new(width: usize, height: usize, solid: Vec<bool>, sides: Sides) -> Self {
        assert_eq!(solid.len(), width * height);
        let fluid = |x: usize, y: usize| !solid[y * width + x];
        let edge = |side: Side, free: bool| if side == Side::Open && free { 2.0 } else { 0.0 };
        let pass_u = Plane::from_fn(width + 1, height, |x, y| match x {
            0 => edge(sides.left, fluid(0, y)),
            x if x == width => edge(sides.right, fluid(x - 1, y)),
            x => f32::from(fluid(x - 1, y) && fluid(x, y)),
        });
        let pass_v = Plane::from_fn(width, height + 1, |x, y| match y {
            0 => edge(sides.top, fluid(x, 0)),
            y if y == height => edge(sides.bottom, fluid(x, y - 1)),
            y => f32::from(fluid(x, y - 1) && fluid(x, y)),
        });
        Self { width, height, solid, sides, pass_u, pass_v }
    }

    /// Stops what would go through obstacles and walls.
    pub fn obstruct(&self, velocity: &mut Velocity) {
        let stop = |speeds: &mut Plane, pass: &Plane| {
            speeds.data.iter_mut().zip(&pass.data).filter(|(_, w)| **w == 0.0).for_each(|(v, _)| *v = 0.0);
        };
        stop(&mut velocity.u, &self.pass_u);
        stop(&mut velocity.v, &self.pass_v);
    }

    /// What flows out of each pixel, per frame; 0 in obstacles.
    pub fn divergence(&self, velocity: &Velocity) -> Plane {
        let mut out = Plane::zeros(self.width, self.height);
        for y in 0..self.height {
            let (u, above, below) = (velocity.u.row(y), velocity.v.row(y), velocity.v.row(y + 1));
            let solid = &self.solid[y * self.width..];
            for (x, out) in out.row_mut(y).iter_mut().enumerate().filter(|(x, _)| !solid[*x]) {
                *out = (u[x + 1] - u[x]) + (below[x] - above[x]);
            }
        }
        out
    }
}

/// The greatest absolute value; not a number where one is not finite.
pub(super) fn greatest(values: &[f32]) -> f32 {
    let (mut most, mut finite) = ([0.0f32; 16], [0.0f32; 16]);
    for chunk in values.chunks(16) {
        for ((most, finite), value) in most.iter_mut().zip(&mut finite).zip(chunk) {
            *most = if value.abs() > *most { value.abs() } else { *most };
            *finite += value * 0.0;
        }
    }
    most.into_iter().fold(0.0, f32::max) + finite.iter().sum::<f32>()
}
