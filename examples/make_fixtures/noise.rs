//! Gradient noise (Perlin 2002) and sums of it.

use super::numeric::mix;

fn hash(seed: u32, x: i32, y: i32, z: i32) -> u32 {
    let mut h = seed ^ (x as u32).wrapping_mul(0x8da6_b343) ^ (y as u32).wrapping_mul(0xd816_3841);
    h ^= (z as u32).wrapping_mul(0xcb1a_b31f);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    h ^ (h >> 15)
}

/// A value in [0, 1) that belongs to a lattice point.
pub fn cell(seed: u32, x: i32, y: i32) -> f32 {
    (hash(seed, x, y, 0) >> 8) as f32 / (1u32 << 24) as f32
}

fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

fn gradient2(h: u32, x: f32, y: f32) -> f32 {
    const DIAGONAL: f32 = 0.707_106_77;
    let (a, b) = match h & 7 {
        0 => (1.0, 0.0),
        1 => (-1.0, 0.0),
        2 => (0.0, 1.0),
        3 => (0.0, -1.0),
        4 => (DIAGONAL, DIAGONAL),
        5 => (-DIAGONAL, DIAGONAL),
        6 => (DIAGONAL, -DIAGONAL),
        _ => (-DIAGONAL, -DIAGONAL),
    };
    a * x + b * y
}

/// Noise at (x, y): zero mean, within about ±1, features of size 1.
pub fn noise2(seed: u32, x: f32, y: f32) -> f32 {
    let (fx, fy) = (x.floor(), y.floor());
    let (ix, iy) = (fx as i32, fy as i32);
    let (x, y) = (x - fx, y - fy);
    let corner = |dx: i32, dy: i32| gradient2(hash(seed, ix + dx, iy + dy, 0), x - dx as f32, y - dy as f32);
    let u = fade(x);
    1.5 * mix(mix(corner(0, 0), corner(1, 0), u), mix(corner(0, 1), corner(1, 1), u), fade(y))
}

fn gradient3(h: u32, x: f32, y: f32, z: f32) -> f32 {
    let sign = |bit: u32, v: f32| if h >> bit & 1 == 0 { v } else { -v };
    match (h >> 4) % 3 {
        0 => sign(0, x) + sign(1, y),
        1 => sign(0, x) + sign(1, z),
        _ => sign(0, y) + sign(1, z),
    }
}

/// Noise at (x, y, z): zero mean, within about ±1, features of size 1.
pub fn noise3(seed: u32, x: f32, y: f32, z: f32) -> f32 {
    let (fx, fy, fz) = (x.floor(), y.floor(), z.floor());
    let (ix, iy, iz) = (fx as i32, fy as i32, fz as i32);
    let (x, y, z) = (x - fx, y - fy, z - fz);
    let corner = |dx: i32, dy: i32, dz: i32| {
        gradient3(hash(seed, ix + dx, iy + dy, iz + dz), x - dx as f32, y - dy as f32, z - dz as f32)
    };
    let (u, v) = (fade(x), fade(y));
    let layer =
        |dz: i32| mix(mix(corner(0, 0, dz), corner(1, 0, dz), u), mix(corner(0, 1, dz), corner(1, 1, dz), u), v);
    mix(layer(0), layer(1), fade(z))
}

/// Sum of `octaves` noises, each half as large and half as strong; about ±1.
pub fn fbm2(seed: u32, x: f32, y: f32, octaves: u32) -> f32 {
    let mut sum = 0.0;
    let (mut scale, mut weight) = (1.0, 0.55);
    for octave in 0..octaves {
        sum += weight * noise2(seed.wrapping_add(octave * 101), x * scale, y * scale);
        scale *= 2.03;
        weight *= 0.5;
    }
    sum
}

/// As [`fbm2`], in three dimensions.
pub fn fbm3(seed: u32, x: f32, y: f32, z: f32, octaves: u32) -> f32 {
    let mut sum = 0.0;
    let (mut scale, mut weight) = (1.0, 0.55);
    for octave in 0..octaves {
        sum += weight * noise3(seed.wrapping_add(octave * 101), x * scale, y * scale, z * scale);
        scale *= 2.03;
        weight *= 0.5;
    }
    sum
}

/// Sharp crests (ridged noise), 0 to about 1.
pub fn ridged2(seed: u32, x: f32, y: f32, octaves: u32) -> f32 {
    let mut sum = 0.0;
    let (mut scale, mut weight) = (1.0, 0.5);
    for octave in 0..octaves {
        let crest = 1.0 - noise2(seed.wrapping_add(octave * 131), x * scale, y * scale).abs();
        sum += weight * crest * crest;
        scale *= 2.1;
        weight *= 0.5;
    }
    sum
}

/// Nearest of randomly placed points, one per unit cell: (distance, distance to the second, identity, offset to it).
pub struct Nearest {
    /// Distance to the nearest point.
    pub first: f32,
    /// Distance to the second nearest.
    pub second: f32,
    /// Identity of the nearest point's cell.
    pub id: (i32, i32),
    /// Vector from the nearest point.
    pub offset: (f32, f32),
}

/// Cellular noise (Worley 1996).
pub fn cellular(seed: u32, x: f32, y: f32) -> Nearest {
    let (ix, iy) = (x.floor() as i32, y.floor() as i32);
    let mut best = Nearest { first: f32::MAX, second: f32::MAX, id: (0, 0), offset: (0.0, 0.0) };
    for cy in iy - 1..=iy + 1 {
        for cx in ix - 1..=ix + 1 {
            let (dx, dy) = (x - cx as f32 - cell(seed, cx, cy), y - cy as f32 - cell(seed ^ 0x5bd1, cx, cy));
            let d = (dx * dx + dy * dy).sqrt();
            if d < best.first {
                best = Nearest { first: d, second: best.first, id: (cx, cy), offset: (dx, dy) };
            } else if d < best.second {
                best.second = d;
            }
        }
    }
    best
}
