//! Densities carried along, losing nothing: fluxes through the sides of pixels, limited to be monotone (van Leer 1977's
//! central slopes), one direction after the other.
//!
//! Between the two directions a pixel's content is spread over the volume that the first one left it with, so that a
//! constant stays constant where the flow has no divergence.

use macro_rules_attribute::apply;

use crate::base::instructions::kernel;
use crate::base::par;
use crate::raster::image::Plane;
use crate::simulate::grid::Velocity;

/// Most of a pixel's content that leaves it in one direction and one pass.
const MOST_LEAVING: f32 = 0.9;
/// Rows that a thread takes at a time.
const BAND: usize = 32;

/// What passed through the sides of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Passed {
    /// Content that left, less what came in; units of density × pixels.
    pub out: f64,
}

/// Carries `density` along `velocity` for `step` frames; what comes in from outside has density `outside`. `turn` says
/// which direction is first, so that the two take turns.
pub fn transport(density: &mut Plane, velocity: &Velocity, step: f32, outside: f32, turn: usize) -> Passed {
    let passes = passes(velocity, step);
    let part = step / passes as f32;
    let mut out = 0.0;
    for n in 0..passes {
        out += if (turn + n).is_multiple_of(2) {
            let volume = along_rows(density, None, &velocity.u, part, outside);
            volume.0 + along_columns(density, Some(&volume.1), &velocity.v, part, outside).0
        } else {
            let volume = along_columns(density, None, &velocity.v, part, outside);
            volume.0 + along_rows(density, Some(&volume.1), &velocity.u, part, outside).0
        };
    }
    Passed { out }
}

/// How many passes keep [`MOST_LEAVING`].
fn passes(velocity: &Velocity, step: f32) -> usize {
    let (width, height) = (velocity.v.width, velocity.u.height);
    let leaving = |ahead: f32, behind: f32| ahead.max(0.0) - behind.min(0.0);
    let mut most = velocity.greatest();
    for y in 0..height {
        let (u, above, below) = (velocity.u.row(y), velocity.v.row(y), velocity.v.row(y + 1));
        for x in 0..width {
            most = most.max(leaving(u[x + 1], u[x])).max(leaving(below[x], above[x]));
        }
    }
    ((most * step / MOST_LEAVING).ceil() as usize).max(1)
}

/// One pass along rows: what left through the sides, and the volume that pixels are left with.
fn along_rows(m: &mut Plane, volume: Option<&Plane>, speeds: &Plane, step: f32, outside: f32) -> (f64, Plane) {
    let width = m.width;
    let mut left_with = Plane::zeros(width, m.height);
    let mut flux = Plane::zeros(width + 1, m.height);
    rows(&mut flux, |y, flux| {
        let mut padded = vec![outside; width + 4];
        densities(&mut padded[2..width + 2], m.row(y), volume.map(|v| v.row(y)));
        fluxes(flux, [&padded, &padded[1..], &padded[2..], &padded[3..]], speeds.row(y), step);
    });
    rows(m, |y, row| {
        let flux = flux.row(y);
        row.iter_mut().zip(flux.iter().zip(&flux[1..])).for_each(|(m, (a, b))| *m += a - b);
    });
    rows(&mut left_with, |y, row| {
        let u = speeds.row(y);
        row.iter_mut().zip(u.iter().zip(&u[1..])).for_each(|(v, (a, b))| *v = 1.0 + step * (a - b));
    });
    let out = (0..m.height).map(|y| f64::from(flux.at(width, y)) - f64::from(flux.at(0, y))).sum();
    (out, left_with)
}

/// One pass along columns.
fn along_columns(m: &mut Plane, volume: Option<&Plane>, speeds: &Plane, step: f32, outside: f32) -> (f64, Plane) {
    let (width, height) = (m.width, m.height);
    let mut density = Plane::filled(width, height + 4, outside);
    par::for_each_chunk(&mut density.data[2 * width..(height + 2) * width], width, |y, row| {
        densities(row, m.row(y), volume.map(|v| v.row(y)));
    });
    let mut flux = Plane::zeros(width, height + 1);
    rows(&mut flux, |y, flux| {
        let near = [0, 1, 2, 3].map(|k| density.row(y + k));
        fluxes(flux, near, speeds.row(y), step);
    });
    rows(m, |y, row| {
        row.iter_mut().zip(flux.row(y).iter().zip(flux.row(y + 1))).for_each(|(m, (a, b))| *m += a - b);
    });
    let mut left_with = Plane::zeros(width, height);
    rows(&mut left_with, |y, row| {
        let near = speeds.row(y).iter().zip(speeds.row(y + 1));
        row.iter_mut().zip(near).for_each(|(v, (a, b))| *v = 1.0 + step * (a - b));
    });
    let sum = |row: &[f32]| row.iter().map(|&f| f64::from(f)).sum::<f64>();
    (sum(flux.row(height)) - sum(flux.row(0)), left_with)
}

fn densities(out: &mut [f32], content: &[f32], volume: Option<&[f32]>) {
    match volume {
        None => out.copy_from_slice(content),
        Some(volume) => out.iter_mut().zip(content.iter().zip(volume)).for_each(|(o, (m, v))| *o = m / v.max(0.1)),
    }
}

/// Flux through each side from the two densities before and the two after it.
#[apply(kernel)]
fn fluxes(out: &mut [f32], along: [&[f32]; 4], speeds: &[f32], step: f32) {
    let n = out.len();
    let ([a, b, c, d], speeds) = (along.map(|values| &values[..n]), &speeds[..n]);
    for k in 0..n {
        let way = step * speeds[k];
        let ahead = b[k] + 0.5 * (1.0 - way) * slope(b[k] - a[k], c[k] - b[k]);
        let behind = c[k] - 0.5 * (1.0 + way) * slope(c[k] - b[k], d[k] - c[k]);
        out[k] = way.max(0.0) * ahead + way.min(0.0) * behind;
    }
}

/// Van Leer's monotonised central slope of two differences.
#[inline(always)]
fn slope(a: f32, b: f32) -> f32 {
    let same = if a * b > 0.0 { 1.0 } else { 0.0 };
    let size = (2.0 * a.abs()).min(2.0 * b.abs()).min(0.5 * (a + b).abs());
    same * size.copysign(a)
}

fn rows(plane: &mut Plane, f: impl Fn(usize, &mut [f32]) + Sync + Send) {
    let width = plane.width;
    par::for_each_chunk(&mut plane.data, width * BAND, |band, rows| {
        rows.chunks_exact_mut(width).enumerate().for_each(|(y, row)| f(band * BAND + y, row));
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::gas::total;
    use crate::simulate::grid::{Domain, Side, Sides};
    use crate::simulate::project::Projection;

    /// A flow without divergence round a rock, up to about three pixels per frame.
    fn swirl(sides: Sides) -> (Domain, Velocity) {
        let solid = (0..64 * 48).map(|i| (20..26).contains(&(i % 64)) && (18..30).contains(&(i / 64))).collect();
        let domain = Domain::new(64, 48, solid, sides);
        let wave = |a: usize, b: usize| (a as f32 * 0.13).sin() + (b as f32 * 0.21).cos() + 0.5;
        let mut velocity =
            Velocity { u: Plane::from_fn(65, 48, |x, y| 2.0 * wave(y, x)), v: Plane::from_fn(64, 49, wave) };
        Projection::new(&domain).project(&domain, &mut velocity).unwrap();
        (domain, velocity)
    }

    #[test]
    fn nothing_is_lost_and_nothing_gets_out_of_range() {
        let open = Sides { right: Side::Open, top: Side::Open, ..Sides::default() };
        for sides in [Sides::default(), open] {
            let (domain, velocity) = swirl(sides);
            let mut density = Plane::from_fn(64, 48, |x, y| f32::from((x / 8 + y / 8) % 2 == 0 && x > 30));
            let (before, mut out) = (total(&density), 0.0);
            for n in 0..60 {
                out += transport(&mut density, &velocity, 1.0, 0.0, n).out;
            }
            assert!((total(&density) + out - before).abs() < 1e-4 * before, "{} + {out} of {before}", total(&density));
            assert!(density.data.iter().all(|&d| (-1e-4..1.05).contains(&d)));
            let inside = density.data.iter().zip(&domain.solid).filter(|(_, s)| **s);
            assert!(inside.into_iter().all(|(d, _)| *d == 0.0));
        }
    }

    #[test]
    fn a_constant_stays_constant() {
        let (domain, velocity) = swirl(Sides { left: Side::Open, right: Side::Open, ..Sides::default() });
        let mut density = Plane::from_vec(64, 48, domain.solid.iter().map(|&s| f32::from(!s)).collect());
        for n in 0..20 {
            transport(&mut density, &velocity, 1.0, 1.0, n);
        }
        let fluid = density.data.iter().zip(&domain.solid).filter(|(_, s)| !**s);
        let worst = fluid.map(|(d, _)| (d - 1.0).abs()).fold(0.0, f32::max);
        assert!(worst < 5e-3, "{worst}");
    }

    #[test]
    fn a_blob_goes_where_the_flow_goes_and_stays_sharp() {
        let domain = Domain::new(
            96,
            32,
            vec![false; 96 * 32],
            Sides { left: Side::Open, right: Side::Open, ..Sides::default() },
        );
        let velocity = Velocity::uniform(&domain, [1.3, 0.0]);
        let blob = |cx: f32| {
            Plane::from_fn(96, 32, |x, y| (-0.5 * ((x as f32 - cx).powi(2) + (y as f32 - 16.0).powi(2)) / 16.0).exp())
        };
        let mut density = blob(20.0);
        for n in 0..40 {
            transport(&mut density, &velocity, 1.0, 0.0, n);
        }
        let off = density.data.iter().zip(&blob(72.0).data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 0.08, "{off}");
    }
}
