//! Elementary functions from additions and multiplications only, so that every machine makes the same pictures.

use std::f32::consts::{LN_2, LOG2_E, PI, SQRT_2};

/// `e^x`, to about six digits.
pub fn exp(x: f32) -> f32 {
    let scaled = x.clamp(-80.0, 80.0) * LOG2_E;
    let whole = (scaled + 0.5).floor();
    let r = (scaled - whole) * LN_2;
    let series = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r / 720.0)))));
    series * f32::from_bits(((whole as i32 + 127) as u32) << 23)
}

/// Natural logarithm of `x > 0`, to about six digits.
pub fn ln(x: f32) -> f32 {
    let bits = x.max(1e-30).to_bits();
    let exponent = (bits >> 23) as i32 - 127;
    let mantissa = f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000);
    let z = (mantissa - SQRT_2) / (mantissa + SQRT_2);
    let z2 = z * z;
    let series = 2.0 * z * (1.0 + z2 * (1.0 / 3.0 + z2 * (0.2 + z2 * (1.0 / 7.0 + z2 / 9.0))));
    series + (exponent as f32 + 0.5) * LN_2
}

/// `x^y` for `x ≥ 0`.
pub fn pow(x: f32, y: f32) -> f32 {
    if x <= 0.0 { 0.0 } else { exp(y * ln(x)) }
}

/// Sine of an angle in radians.
pub fn sin(x: f32) -> f32 {
    let turn = x / (2.0 * PI);
    let folded = turn - (turn + 0.5).floor();
    let r = if folded.abs() > 0.25 { folded.signum() * 0.5 - folded } else { folded } * 2.0 * PI;
    let r2 = r * r;
    r * (1.0 - r2 / 6.0 * (1.0 - r2 / 20.0 * (1.0 - r2 / 42.0 * (1.0 - r2 / 72.0))))
}

/// Cosine of an angle in radians.
pub fn cos(x: f32) -> f32 {
    sin(x + 0.5 * PI)
}

/// Hermite step from 0 at `low` to 1 at `high` (`low > high` steps down).
pub fn step(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Between `a` at 0 and `b` at 1.
pub fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}
