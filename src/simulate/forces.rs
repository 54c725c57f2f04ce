//! What pushes the fluid: buoyancy, wind, and vorticity confinement.

use crate::raster::image::Plane;
use crate::simulate::grid::{Domain, Velocity};
use crate::simulate::noise::smooth_noise;

/// How long an eddy of noise lasts, frames.
const EDDY_LIFE: f32 = 10.0;
/// Less opaque than this, gas is not stirred.
const CLEAR: f32 = 0.01;

/// Pulls the velocity towards `wind`, pixels per frame, by the share `pull` of the difference.
pub(super) fn blow(domain: &Domain, velocity: &mut Velocity, wind: [f32; 2], pull: f32) {
    if pull == 0.0 {
        return;
    }
    let pulled = |speeds: &mut Plane, pass: &Plane, wind: f32| {
        let inside = speeds.data.iter_mut().zip(&pass.data).filter(|(_, w)| **w > 0.0);
        inside.for_each(|(v, _)| *v += pull * (wind - *v));
    };
    pulled(&mut velocity.u, &domain.pass_u, wind[0]);
    pulled(&mut velocity.v, &domain.pass_v, wind[1]);
}

/// Lifts what is hot and lets sink what is heavy: the upward acceleration times the time is `gain`, pixels per frame, at
/// the centres of pixels.
pub(super) fn lift(domain: &Domain, velocity: &mut Velocity, gain: &Plane) {
    for y in 0..=domain.height {
        let (above, below) = (gain.row(y.max(1) - 1), gain.row(y.min(domain.height - 1)));
        let v = velocity.v.row_mut(y).iter_mut().zip(domain.pass_v.row(y));
        let inside = v.zip(above.iter().zip(below)).filter(|((_, w), _)| **w > 0.0);
        inside.for_each(|((v, _), (a, b))| *v -= 0.5 * (a + b));
    }
}

/// Gives back the turning that the grid takes away (Fedkiw, Stam & Jensen 2001, Eq. 11): a force `strength` N × ω, where ω
/// is the vorticity and N points to where there is more of it, for `step` frames.
pub(super) fn confine(domain: &Domain, velocity: &mut Velocity, strength: f32, step: f32) {
    if strength == 0.0 {
        return;
    }
    let (width, height) = (domain.width, domain.height);
    let vorticity = vorticity(domain, velocity);
    let (mut fx, mut fy) = (Plane::zeros(width, height), Plane::zeros(width, height));
    for y in 1..height.max(2) - 1 {
        for x in 1..width.max(2) - 1 {
            let gx = 0.5 * (vorticity.at(x + 1, y).abs() - vorticity.at(x - 1, y).abs());
            let gy = 0.5 * (vorticity.at(x, y + 1).abs() - vorticity.at(x, y - 1).abs());
            let scale = strength * step * vorticity.at(x, y) / (gx * gx + gy * gy).sqrt().max(1e-6);
            *fx.at_mut(x, y) = gy * scale;
            *fy.at_mut(x, y) = -gx * scale;
        }
    }
    push(domain, velocity, &fx, &fy);
}

/// How fast the fluid turns at the centre of each pixel, 1 / frame; 0 in obstacles.
pub(super) fn vorticity(domain: &Domain, velocity: &Velocity) -> Plane {
    let (width, height) = (domain.width, domain.height);
    let field = velocity.centred();
    Plane::from_fn(width, height, |x, y| {
        if domain.solid[y * width + x] {
            return 0.0;
        }
        let (l, r) = (x.max(1) - 1, (x + 1).min(width - 1));
        let (t, b) = (y.max(1) - 1, (y + 1).min(height - 1));
        0.5 * ((field.v.at(r, y) - field.v.at(l, y)) - (field.u.at(x, b) - field.u.at(x, t)))
    })
}

/// Eddies of noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct Eddies {
    /// Their size, pixels.
    pub size: f32,
    /// Their acceleration times the time, pixels per frame.
    pub strength: f32,
    /// Where in time.
    pub frame: f32,
    /// Which noise.
    pub seed: u64,
}

/// Stirs the gas, as much as it is opaque: the force is the curl of a smooth noise, so it turns and does not press
/// (Bridson, Hourihan & Nordenstam 2007, §2).
pub(super) fn stir(domain: &Domain, velocity: &mut Velocity, opacity: &Plane, eddies: &Eddies) {
    let (width, height) = (domain.width, domain.height);
    let (mut fx, mut fy) = (Plane::zeros(width, height), Plane::zeros(width, height));
    let potential =
        |x: f32, y: f32| smooth_noise(eddies.seed, [x / eddies.size, y / eddies.size, eddies.frame / EDDY_LIFE]);
    let rows = fx.data.chunks_exact_mut(width).zip(fy.data.chunks_exact_mut(width)).enumerate();
    for (y, (fx, fy)) in rows {
        for x in (0..width).filter(|&x| opacity.at(x, y) > CLEAR) {
            let gain = eddies.strength * eddies.size * opacity.at(x, y);
            let (x0, y0) = (x as f32, y as f32);
            fx[x] = gain * (potential(x0, y0 + 0.5) - potential(x0, y0 - 0.5));
            fy[x] = gain * (potential(x0 - 0.5, y0) - potential(x0 + 0.5, y0));
        }
    }
    push(domain, velocity, &fx, &fy);
}

/// Adds what is given at the centres of pixels to their sides.
fn push(domain: &Domain, velocity: &mut Velocity, fx: &Plane, fy: &Plane) {
    for y in 0..domain.height {
        let (fx, pass) = (fx.row(y), domain.pass_u.row(y));
        let u = &mut velocity.u.row_mut(y)[1..domain.width];
        u.iter_mut().zip(&pass[1..]).zip(fx.iter().zip(&fx[1..])).for_each(|((u, w), (a, b))| *u += w * 0.5 * (a + b));
    }
    for y in 1..domain.height {
        let v = velocity.v.row_mut(y).iter_mut().zip(domain.pass_v.row(y));
        v.zip(fy.row(y - 1).iter().zip(fy.row(y))).for_each(|((v, w), (a, b))| *v += w * 0.5 * (a + b));
    }
}
