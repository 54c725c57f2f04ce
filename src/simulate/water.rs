//! Water seen from above: the shallow-water equations on the staggered grid. The depth is carried by fluxes and loses
//! nothing; the surface spreads and draws together where it rises and falls, so its divergence is not zero.

use crate::raster::image::Plane;
use crate::simulate::advect::advect;
use crate::simulate::forces::{blow, confine, vorticity};
use crate::simulate::gas::{Budget, emit, steer, total};
use crate::simulate::grid::Velocity;
use crate::simulate::setup::Setup;
use crate::simulate::transport::transport;

/// Farthest that a wave travels in one part of a step, pixels; the scheme is stable up to 1/√2.
const MAX_WAVE: f32 = 0.5;
/// Water shallower than this, in pixels, does not move.
const DRY: f32 = 1e-3;

/// Turning from which on water foams, and from which it foams most, 1 / frame.
const CALM: f32 = 0.08;
const WILD: f32 = 0.4;
/// Share of what is not foam yet that becomes foam where it foams most, and share of the foam that fades, 1 / frame.
const FOAMING: f32 = 0.25;
const FADING: f32 = 0.03;

/// The state of water.
pub struct Shallow<'s> {
    setup: &'s Setup,
    /// Velocity, pixels per frame.
    pub velocity: Velocity,
    /// Depth, pixels; 0 in obstacles.
    pub depth: Plane,
    /// Foam for the preview, 0 to about 1: made where the water turns hard, carried along, fading.
    pub foam: Plane,
    /// Where the water went; nothing fades.
    pub budget: Budget,
    steps: usize,
}

impl<'s> Shallow<'s> {
    /// Water of even depth that moves with the current.
    pub fn new(setup: &'s Setup) -> Self {
        let domain = &setup.domain;
        let rest = domain.solid.iter().map(|&s| if s { 0.0 } else { setup.water.depth }).collect();
        let depth = Plane::from_vec(domain.width, domain.height, rest);
        let budget = Budget { given: total(&depth), ..Budget::default() };
        let foam = Plane::zeros(domain.width, domain.height);
        Self { setup, velocity: Velocity::uniform(domain, setup.file.wind), depth, foam, budget, steps: 0 }
    }

    /// First half of a step: emitters and forces.
    pub fn push(&mut self, frame: f32, step: f32) {
        let (file, domain) = (&self.setup.file, &self.setup.domain);
        for emitter in self.setup.emitters.iter().filter(|e| e.works(frame)) {
            self.budget.given += emit(emitter, &mut self.depth, frame, step);
            steer(emitter, &mut self.velocity);
        }
        blow(domain, &mut self.velocity, file.wind, 1.0 - (1.0 - file.drag).powf(step));
        confine(domain, &mut self.velocity, file.vorticity, step);
        domain.obstruct(&mut self.velocity);
    }

    /// Second half of a step: waves in as many parts as they need, then the velocity carried along.
    pub fn carry(&mut self, step: f32) {
        let deepest = self.depth.data.iter().fold(0.0f32, |most, &d| most.max(d));
        let fastest = (self.setup.water.gravity * deepest).sqrt();
        let parts = ((fastest * step / MAX_WAVE).ceil() as usize).max(1);
        let part = step / parts as f32;
        for n in 0..parts {
            self.fall(part);
            self.calm();
            let outside = self.setup.water.depth;
            self.budget.left += transport(&mut self.depth, &self.velocity, part, outside, self.steps + n).out;
        }
        self.whiten(step);
        self.velocity = advect(&self.velocity, step);
        self.setup.domain.obstruct(&mut self.velocity);
        self.steps += 1;
    }

    /// Makes foam, carries it, and lets it fade.
    fn whiten(&mut self, step: f32) {
        let turning = vorticity(&self.setup.domain, &self.velocity);
        for (foam, turning) in self.foam.data.iter_mut().zip(&turning.data) {
            let hard = ((turning.abs() - CALM) / (WILD - CALM)).clamp(0.0, 1.0);
            *foam += step * (hard * FOAMING * (1.0 - *foam) - FADING * *foam);
        }
        transport(&mut self.foam, &self.velocity, step, 0.0, self.steps);
    }

    /// Water runs down its own slope; at open sides waves leave (Flather 1976).
    fn fall(&mut self, step: f32) {
        let (domain, water) = (&self.setup.domain, &self.setup.water);
        let wind = self.setup.file.wind;
        let pull = water.gravity * step;
        let leave = (water.gravity / water.depth).sqrt();
        let depth = &self.depth;
        let between = |speed: &mut f32, a: f32, b: f32| {
            *speed = if a > DRY || b > DRY { *speed - pull * (b - a) } else { 0.0 };
        };
        let at_side = |inside: f32, wind: f32, outwards: f32| wind + outwards * leave * (inside - water.depth);
        for y in 0..domain.height {
            let (d, pass, u) = (depth.row(y), domain.pass_u.row(y), self.velocity.u.row_mut(y));
            for x in 1..domain.width {
                if pass[x] > 0.0 {
                    between(&mut u[x], d[x - 1], d[x]);
                }
            }
            for (x, inside, outwards) in [(0, 0, -1.0), (domain.width, domain.width - 1, 1.0)] {
                if pass[x] > 0.0 {
                    u[x] = at_side(d[inside], wind[0], outwards);
                }
            }
        }
        for y in 0..=domain.height {
            let (pass, v) = (domain.pass_v.row(y), self.velocity.v.row_mut(y));
            let (above, below) = (depth.row(y.max(1) - 1), depth.row(y.min(domain.height - 1)));
            for x in (0..domain.width).filter(|&x| pass[x] > 0.0) {
                match y {
                    0 => v[x] = at_side(below[x], wind[1], -1.0),
                    y if y == domain.height => v[x] = at_side(above[x], wind[1], 1.0),
                    _ => between(&mut v[x], above[x], below[x]),
                }
            }
        }
    }

    /// Takes the shortest waves out and leaves eddies: velocities move down the slope of their divergence.
    fn calm(&mut self) {
        let (domain, damping) = (&self.setup.domain, self.setup.water.damping);
        let divergence = domain.divergence(&self.velocity);
        for y in 0..domain.height {
            let (d, pass, u) = (divergence.row(y), domain.pass_u.row(y), self.velocity.u.row_mut(y));
            for x in (1..domain.width).filter(|&x| pass[x] > 0.0) {
                u[x] += damping * (d[x] - d[x - 1]);
            }
        }
        for y in 1..domain.height {
            let (above, below, pass) = (divergence.row(y - 1), divergence.row(y), domain.pass_v.row(y));
            let v = self.velocity.v.row_mut(y);
            for x in (0..domain.width).filter(|&x| pass[x] > 0.0) {
                v[x] += damping * (below[x] - above[x]);
            }
        }
    }

    /// Opacity: 1 where there is water.
    pub fn alpha(&self) -> Plane {
        self.depth.map(|d| (d / 1.0f32.min(self.setup.water.depth)).clamp(0.0, 1.0))
    }
}
