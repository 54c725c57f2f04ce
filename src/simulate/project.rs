//! Projection: the pressure that leaves a velocity without divergence (Stam 1999, §2.1, step 4), by conjugate gradients
//! with a multigrid preconditioner.

use crate::base::error::{Error, Kind, Result};
use crate::simulate::grid::{Domain, Velocity, greatest};
use crate::simulate::multigrid::Multigrid;

/// Most divergence that is left, times the side of a pixel, over the greatest speed.
pub const TOLERANCE: f32 = 1e-4;
/// Speeds below this, in pixels per frame, are stillness: divergence is compared with it where all is slower.
pub const STILL: f32 = 1e-3;
/// Part of the tolerance that the solver aims at; the rest is for rounding.
const MARGIN: f32 = 0.5;
/// Most rounds of conjugate gradients in one go, and most goes.
const MAX_ROUNDS: usize = 60;
const MAX_GOES: usize = 4;

/// What a projection came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projected {
    /// Greatest divergence left times the side of a pixel over the greatest speed (or [`STILL`], if that is more).
    pub divergence: f32,
    /// Rounds of conjugate gradients.
    pub rounds: usize,
}

/// The solver for one domain, with its memory.
pub struct Projection {
    grids: Multigrid,
    pressure: Vec<f32>,
    residual: Vec<f32>,
    direction: Vec<f32>,
    image: Vec<f32>,
}

impl Projection {
    /// A solver for `domain`.
    pub fn new(domain: &Domain) -> Self {
        let grids = Multigrid::new(domain);
        let zeros = || vec![0.0; grids.levels[0].sum.len()];
        let (pressure, residual, direction, image) = (zeros(), zeros(), zeros(), zeros());
        Self { grids, pressure, residual, direction, image }
    }

    /// Takes the divergence out of `velocity`, down to [`TOLERANCE`].
    ///
    /// # Errors
    /// A velocity that is not a number; divergence that does not go away.
    pub fn project(&mut self, domain: &Domain, velocity: &mut Velocity) -> Result<Projected> {
        domain.obstruct(velocity);
        let mut rounds = 0;
        for _ in 0..MAX_GOES {
            let (divergence, speed) = self.measure(domain, velocity);
            if !(divergence.is_finite() && speed.is_finite()) {
                return Err(Error::new(Kind::Unusable, "simulation", "velocities are no numbers any more")
                    .remedy("give more steps a frame, or gentler forces"));
            }
            if rounds > 0 && divergence <= TOLERANCE * speed || divergence == 0.0 {
                return Ok(Projected { divergence: divergence / speed, rounds });
            }
            rounds += self.solve(MARGIN * TOLERANCE * speed);
            self.subtract_gradient(domain, velocity);
        }
        let (divergence, speed) = self.measure(domain, velocity);
        if divergence <= TOLERANCE * speed {
            return Ok(Projected { divergence: divergence / speed, rounds });
        }
        Err(Error::new(Kind::Unusable, "simulation", format!("divergence {:.1e} does not go away", divergence / speed))
            .allowed(format!("up to {TOLERANCE:.0e} of the greatest speed"))
            .remedy("make obstacles and emitters less intricate"))
    }

    /// Puts minus the divergence into the residual; the greatest divergence, and the speed to compare it with.
    fn measure(&mut self, domain: &Domain, velocity: &Velocity) -> (f32, f32) {
        let divergence = domain.divergence(velocity);
        let stride = domain.width + 2;
        for y in 0..domain.height {
            let row = &mut self.residual[(y + 1) * stride + 1..][..domain.width];
            row.iter_mut().zip(divergence.row(y)).for_each(|(r, d)| *r = -d);
        }
        (greatest(&self.residual), velocity.greatest().max(STILL))
    }

    /// Solves for the pressure of the residual until no pixel has more than `target` left; the number of rounds.
    fn solve(&mut self, target: f32) -> usize {
        let stride = self.grids.levels[0].width + 2;
        self.pressure.fill(0.0);
        self.grids.cycle(&self.residual);
        self.direction.copy_from_slice(self.grids.answer());
        let mut old = dot(&self.residual, &self.direction, stride);
        for round in 1..=MAX_ROUNDS {
            self.grids.levels[0].apply(&self.direction, &mut self.image);
            let curvature = dot(&self.direction, &self.image, stride);
            if curvature <= 0.0 {
                return round;
            }
            let step = (old / curvature) as f32;
            add(&mut self.pressure, &self.direction, step);
            add(&mut self.residual, &self.image, -step);
            if greatest(&self.residual) <= target {
                return round;
            }
            self.grids.cycle(&self.residual);
            let new = dot(&self.residual, self.grids.answer(), stride);
            let keep = (new / old) as f32;
            self.direction.iter_mut().zip(self.grids.answer()).for_each(|(d, z)| *d = z + keep * *d);
            old = new;
        }
        MAX_ROUNDS
    }

    fn subtract_gradient(&self, domain: &Domain, velocity: &mut Velocity) {
        let (width, stride) = (domain.width, domain.width + 2);
        for y in 0..=domain.height {
            let here = &self.pressure[(y + 1) * stride..][..stride];
            let above = &self.pressure[y * stride..][..stride];
            let v = velocity.v.row_mut(y).iter_mut().zip(domain.pass_v.row(y));
            v.zip(here[1..].iter().zip(&above[1..])).for_each(|((v, w), (b, a))| *v -= w * (b - a));
            if y < domain.height {
                let u = velocity.u.row_mut(y).iter_mut().zip(domain.pass_u.row(y));
                u.zip(here[1..].iter().zip(&here[..=width])).for_each(|((u, w), (b, a))| *u -= w * (b - a));
            }
        }
    }
}

/// Scalar product: eight sums a row, rows added up in order and in double precision.
fn dot(a: &[f32], b: &[f32], stride: usize) -> f64 {
    let row = |(a, b): (&[f32], &[f32])| {
        let mut sums = [0.0f32; 8];
        for (a, b) in a.chunks(8).zip(b.chunks(8)) {
            sums.iter_mut().zip(a.iter().zip(b)).for_each(|(s, (a, b))| *s += a * b);
        }
        sums.iter().map(|&s| f64::from(s)).sum::<f64>()
    };
    a.chunks(stride).zip(b.chunks(stride)).map(row).sum()
}

fn add(to: &mut [f32], values: &[f32], weight: f32) {
    to.iter_mut().zip(values).for_each(|(t, v)| *t += weight * v);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{hash, unit};
    use crate::raster::image::Plane;
    use crate::simulate::grid::{Side, Sides};

    fn noise(domain: &Domain) -> Velocity {
        let value = |plane: u64| move |x: usize, y: usize| unit(hash(plane, &[x as u64, y as u64])) * 4.0 - 2.0;
        Velocity {
            u: Plane::from_fn(domain.width + 1, domain.height, value(1)),
            v: Plane::from_fn(domain.width, domain.height + 1, value(2)),
        }
    }

    fn domain(width: usize, height: usize, sides: Sides, holes: bool) -> Domain {
        let solid = |i: usize| {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let ring = (x - 30.0).hypot(y - 25.0);
            holes && ((8.0..12.0).contains(&ring) || (x as usize == 50 && y > 10.0))
        };
        Domain::new(width, height, (0..width * height).map(solid).collect(), sides)
    }

    #[test]
    fn divergence_goes_away_in_few_rounds() {
        let open = Sides { left: Side::Open, top: Side::Open, ..Sides::default() };
        let all = Sides { left: Side::Open, top: Side::Open, right: Side::Open, bottom: Side::Open };
        for (width, height, sides, holes, most) in [
            (64, 64, Sides::default(), false, 12),
            (128, 64, open, false, 12),
            (67, 45, all, false, 14),
            (9, 150, open, false, 20),
            (96, 80, open, true, 30),
            (96, 80, Sides::default(), true, 30),
        ] {
            let domain = domain(width, height, sides, holes);
            let mut velocity = noise(&domain);
            let done = Projection::new(&domain).project(&domain, &mut velocity).unwrap();
            assert!(
                done.divergence <= TOLERANCE && done.rounds <= most,
                "{width} x {height} {sides:?} {holes}: {done:?}"
            );
            let left = domain.divergence(&velocity);
            assert!(greatest(&left.data) <= TOLERANCE * velocity.greatest());
        }
    }

    #[test]
    fn what_has_no_divergence_stays() {
        let domain = domain(64, 48, Sides::default(), false);
        let mut velocity = Velocity::uniform(&domain, [0.0; 2]);
        let done = Projection::new(&domain).project(&domain, &mut velocity).unwrap();
        assert_eq!((velocity.greatest(), done.divergence, done.rounds), (0.0, 0.0, 0));
        velocity.u.data[70] = f32::NAN;
        let error = Projection::new(&domain).project(&domain, &mut velocity).unwrap_err();
        assert!(error.to_string().contains("no numbers"), "{error}");
    }
}
