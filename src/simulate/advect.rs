//! Velocities carried along themselves: MacCormack's scheme on semi-Lagrangian steps (Selle et al. 2008), paths by the
//! midpoint rule, limited to the values at the foot of the path.

use crate::base::par;
use crate::raster::image::Plane;
use crate::simulate::grid::Velocity;

/// Rows that a thread takes at a time.
const BAND: usize = 16;

/// The velocity carried along itself for `step` frames. Beyond the picture it goes on as at the side.
pub fn advect(velocity: &Velocity, step: f32) -> Velocity {
    let Velocity { u, v } = velocity;
    // A side's own component there, and the other as the mean of the four sides around.
    let paths_u = paths(
        u,
        step,
        |x, y| {
            let (a, b) = (x as isize - 1, x as isize);
            let mean = (v.clamped(a, y as isize) + v.clamped(b, y as isize))
                + (v.clamped(a, y as isize + 1) + v.clamped(b, y as isize + 1));
            [u.at(x, y), 0.25 * mean]
        },
        |x, y, d| [sample(u, x, y, d), sample(v, x, y, [d[0] - 0.5, d[1] + 0.5])],
    );
    let paths_v = paths(
        v,
        step,
        |x, y| {
            let (a, b) = (y as isize - 1, y as isize);
            let mean = (u.clamped(x as isize, a) + u.clamped(x as isize + 1, a))
                + (u.clamped(x as isize, b) + u.clamped(x as isize + 1, b));
            [0.25 * mean, v.at(x, y)]
        },
        |x, y, d| [sample(u, x, y, [d[0] + 0.5, d[1] - 0.5]), sample(v, x, y, d)],
    );
    Velocity { u: carry(u, &paths_u), v: carry(v, &paths_v) }
}

/// For each value of `plane`, the way back to where it comes from.
fn paths(
    plane: &Plane,
    step: f32,
    here: impl Fn(usize, usize) -> [f32; 2] + Sync + Send,
    there: impl Fn(usize, usize, [f32; 2]) -> [f32; 2] + Sync + Send,
) -> Vec<[f32; 2]> {
    let mut out = vec![[0.0; 2]; plane.data.len()];
    rows(&mut out, plane.width, |y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            let half = here(x, y).map(|speed| -0.5 * step * speed);
            *out = there(x, y, half).map(|speed| -step * speed);
        }
    });
    out
}

/// `plane` carried along `paths`, with half of the error of going there and back taken off.
fn carry(plane: &Plane, paths: &[[f32; 2]]) -> Plane {
    let (width, height) = (plane.width, plane.height);
    let mut there = Plane::zeros(width, height);
    rows(&mut there.data, width, |y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            *out = sample(plane, x, y, paths[y * width + x]);
        }
    });
    let mut out = Plane::zeros(width, height);
    rows(&mut out.data, width, |y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            let path = paths[y * width + x];
            let back = sample(&there, x, y, path.map(|d| -d));
            let [a, b, c, d] = corners(plane, x, y, path).0;
            let better = there.at(x, y) + 0.5 * (plane.at(x, y) - back);
            *out = better.clamp(a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        }
    });
    out
}

/// Bilinear value at `offset` from value `(x, y)`. Offsets, not places, are rounded: mirrored flows stay mirrored.
#[inline(always)]
fn sample(plane: &Plane, x: usize, y: usize, offset: [f32; 2]) -> f32 {
    let ([a, b, c, d], [fx, fy]) = corners(plane, x, y, offset);
    let (gx, gy) = (1.0 - fx, 1.0 - fy);
    gy * (gx * a + fx * b) + fy * (gx * c + fx * d)
}

/// The four values around a place, and how far it is from the first.
#[inline(always)]
fn corners(plane: &Plane, x: usize, y: usize, [dx, dy]: [f32; 2]) -> ([f32; 4], [f32; 2]) {
    let (whole_x, whole_y) = (floor(dx), floor(dy));
    let (right, low) = (plane.width as i32 - 1, plane.height as i32 - 1);
    let (x0, y0) = (x as i32 + whole_x, y as i32 + whole_y);
    let clamp = |at: i32, most: i32| at.clamp(0, most) as usize;
    let (xa, xb) = (clamp(x0, right), clamp(x0 + 1, right));
    let (ya, yb) = (clamp(y0, low) * plane.width, clamp(y0 + 1, low) * plane.width);
    let data = &plane.data;
    ([data[ya + xa], data[ya + xb], data[yb + xa], data[yb + xb]], [dx - whole_x as f32, dy - whole_y as f32])
}

/// Rounds down; without a call to the mathematics library.
#[inline(always)]
fn floor(value: f32) -> i32 {
    let whole = value as i32;
    whole - i32::from(whole as f32 > value)
}

fn rows<T: Send>(data: &mut [T], width: usize, f: impl Fn(usize, &mut [T]) + Sync + Send) {
    par::for_each_chunk(data, width * BAND, |band, rows| {
        rows.chunks_exact_mut(width).enumerate().for_each(|(y, row)| f(band * BAND + y, row));
    });
}
