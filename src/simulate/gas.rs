//! Smoke and fire (Stam 1999; Fedkiw, Stam & Jensen 2001): an incompressible gas that carries density and temperature.

use crate::base::error::Result;
use crate::raster::image::Plane;
use crate::simulate::advect::advect;
use crate::simulate::forces::{Eddies, blow, confine, lift, stir};
use crate::simulate::grid::Velocity;
use crate::simulate::project::{Projected, Projection};
use crate::simulate::setup::{Emitter, Setup};
use crate::simulate::transport::transport;

/// Where the density went; units of density × pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Budget {
    /// What was there at first and what emitters gave.
    pub given: f64,
    /// What left through open sides, less what came in.
    pub left: f64,
    /// What faded.
    pub faded: f64,
}

/// The state of a gas.
pub struct Smoke<'s> {
    setup: &'s Setup,
    projection: Projection,
    /// Velocity, pixels per frame.
    pub velocity: Velocity,
    /// Density.
    pub density: Plane,
    /// Temperature over that of the air around.
    pub temperature: Plane,
    /// Where the density went.
    pub budget: Budget,
    steps: usize,
}

impl<'s> Smoke<'s> {
    /// A clear gas that moves with the wind.
    pub fn new(setup: &'s Setup) -> Self {
        let (domain, air) = (&setup.domain, Plane::zeros(setup.domain.width, setup.domain.height));
        Self {
            setup,
            projection: Projection::new(domain),
            velocity: Velocity::uniform(domain, setup.file.wind),
            density: air.clone(),
            temperature: air,
            budget: Budget::default(),
            steps: 0,
        }
    }

    /// First half of a step: emitters, forces, projection. The velocity that is then there carries everything from this
    /// step to the next.
    ///
    /// # Errors
    /// Those of [`Projection::project`].
    pub fn push(&mut self, frame: f32, step: f32) -> Result<Projected> {
        let (file, gas, domain) = (&self.setup.file, &self.setup.gas, &self.setup.domain);
        for emitter in self.setup.emitters.iter().filter(|e| e.works(frame)) {
            let given = emit(emitter, &mut self.density, frame, step);
            self.budget.given += given;
            heat(emitter, &mut self.temperature, frame);
        }
        let gain = self.temperature.data.iter().zip(&self.density.data);
        let gain = gain.map(|(t, d)| step * (gas.buoyancy * t - gas.weight * d)).collect();
        lift(domain, &mut self.velocity, &Plane::from_vec(domain.width, domain.height, gain));
        blow(domain, &mut self.velocity, file.wind, 1.0 - (1.0 - file.drag).powf(step));
        confine(domain, &mut self.velocity, file.vorticity, step);
        if gas.turbulence > 0.0 {
            let eddies = Eddies { size: gas.eddies, strength: step * gas.turbulence, frame, seed: file.seed };
            let opacity = self.alpha();
            stir(domain, &mut self.velocity, &opacity, &eddies);
        }
        self.setup.emitters.iter().filter(|e| e.works(frame)).for_each(|e| steer(e, &mut self.velocity));
        self.projection.project(domain, &mut self.velocity)
    }

    /// Second half of a step: density, temperature and velocity are carried along.
    pub fn carry(&mut self, step: f32) {
        let gas = &self.setup.gas;
        self.budget.left += transport(&mut self.density, &self.velocity, step, 0.0, self.steps).out;
        transport(&mut self.temperature, &self.velocity, step, 0.0, self.steps);
        if gas.fading > 0.0 {
            let keep = (1.0 - gas.fading).powf(step);
            let before = total(&self.density);
            self.density.data.iter_mut().for_each(|d| *d *= keep);
            self.budget.faded += before - total(&self.density);
        }
        let keep = (1.0 - gas.cooling).powf(step);
        self.temperature.data.iter_mut().for_each(|t| *t *= keep);
        self.velocity = advect(&self.velocity, step);
        self.steps += 1;
    }

    /// Opacity in [0, 1].
    pub fn alpha(&self) -> Plane {
        let opacity = self.setup.gas.opacity;
        self.density.map(|d| 1.0 - (-opacity * d.max(0.0)).exp())
    }
}

/// Sum over the pixels, in double precision and a fixed order.
pub(super) fn total(plane: &Plane) -> f64 {
    plane.data.iter().map(|&v| f64::from(v)).sum()
}

/// Adds what an emitter gives in `step` frames; how much it was.
pub(super) fn emit(emitter: &Emitter, to: &mut Plane, frame: f32, step: f32) -> f64 {
    let mut given = 0.0;
    for y in 0..to.height {
        for x in (0..to.width).filter(|&x| emitter.cover.at(x, y) > 0.0) {
            let before = to.at(x, y);
            let gain = step * emitter.file.rate * emitter.cover.at(x, y) * emitter.flicker(x, y, frame);
            *to.at_mut(x, y) = before + gain;
            given += f64::from(to.at(x, y)) - f64::from(before);
        }
    }
    given
}

/// Brings what an emitter covers to its temperature.
fn heat(emitter: &Emitter, temperature: &mut Plane, frame: f32) {
    if emitter.file.temperature == 0.0 {
        return;
    }
    for y in 0..temperature.height {
        for x in (0..temperature.width).filter(|&x| emitter.cover.at(x, y) > 0.0) {
            let hot = emitter.file.temperature * emitter.flicker(x, y, frame);
            let t = temperature.at_mut(x, y);
            *t += emitter.cover.at(x, y) * (hot - *t);
        }
    }
}

/// Gives what an emitter covers its velocity.
pub(super) fn steer(emitter: &Emitter, velocity: &mut Velocity) {
    let Some([u, v]) = emitter.file.velocity else { return };
    let cover = &emitter.cover;
    let (width, height) = (cover.width, cover.height);
    for y in 0..height {
        for x in 0..=width {
            let (l, r) = (x.max(1) - 1, x.min(width - 1));
            let weight = 0.5 * (cover.at(l, y) + cover.at(r, y));
            let speed = velocity.u.at_mut(x, y);
            *speed += weight * (u - *speed);
        }
    }
    for y in 0..=height {
        for x in 0..width {
            let (t, b) = (y.max(1) - 1, y.min(height - 1));
            let weight = 0.5 * (cover.at(x, t) + cover.at(x, b));
            let speed = velocity.v.at_mut(x, y);
            *speed += weight * (v - *speed);
        }
    }
}
