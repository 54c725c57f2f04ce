//! Catmull & Rom's cubic: through the samples, with slopes that are half the difference of their neighbours.

use super::image::Plane;

/// The kernel at a distance from its middle, in samples.
#[inline(always)]
pub fn kernel(x: f64) -> f64 {
    let x = x.abs();
    if x < 1.0 {
        (1.5 * x - 2.5) * x * x + 1.0
    } else if x < 2.0 {
        ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0
    } else {
        0.0
    }
}

/// [`kernel`] rounded to single precision at every step.
#[inline(always)]
pub fn kernel_f32(x: f32) -> f32 {
    let x = x.abs();
    if x < 1.0 {
        (1.5 * x - 2.5) * x * x + 1.0
    } else if x < 2.0 {
        ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0
    } else {
        0.0
    }
}

/// Weights of the four samples around a position `t` in [0, 1) past the second.
#[inline(always)]
pub fn weights(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (2.0 * t2 - t3 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (4.0 * t2 - 3.0 * t3 + t), 0.5 * (t3 - t2)]
}

/// [`weights`] by Horner's rule, which rounds otherwise, and their derivatives.
#[inline(always)]
pub fn weights_and_slopes(t: f32) -> ([f32; 4], [f32; 4]) {
    let weights = [
        (((-0.5 * t + 1.0) * t) - 0.5) * t,
        ((1.5 * t - 2.5) * t) * t + 1.0,
        (((-1.5 * t + 2.0) * t) + 0.5) * t,
        ((0.5 * t - 0.5) * t) * t,
    ];
    let slopes = [(-1.5 * t + 2.0) * t - 0.5, (4.5 * t - 5.0) * t, (-4.5 * t + 4.0) * t + 0.5, (1.5 * t - 1.0) * t];
    (weights, slopes)
}

/// Value of a plane at `(x, y)`, centres at ½, borders clamped: bilinear reading would dull the finest band.
#[inline(always)]
pub fn sample(plane: &Plane, x: f32, y: f32) -> f32 {
    let (fx, fy) = (x - 0.5, y - 0.5);
    let (x0, y0) = (fx.floor(), fy.floor());
    let (wx, wy) = (weights(fx - x0), weights(fy - y0));
    let (x0, y0) = (x0 as isize - 1, y0 as isize - 1);
    let inside = x0 >= 0 && y0 >= 0 && x0 + 4 <= plane.width as isize && y0 + 4 <= plane.height as isize;
    let mut sum = 0.0;
    for (j, wy) in wy.iter().enumerate() {
        let row: [f32; 4] = if inside {
            let start = (y0 as usize + j) * plane.width + x0 as usize;
            let row = &plane.data[start..start + 4];
            [row[0], row[1], row[2], row[3]]
        } else {
            std::array::from_fn(|i| plane.clamped(x0 + i as isize, y0 + j as isize))
        };
        sum += wy * (row[0] * wx[0] + row[1] * wx[1] + row[2] * wx[2] + row[3] * wx[3]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_the_kernel_and_their_slopes_sum_to_nothing() {
        for t in [0.0f32, 0.1, 0.25, 0.5, 0.9] {
            let (horner, slopes) = weights_and_slopes(t);
            for (i, (a, b)) in weights(t).into_iter().zip(horner).enumerate() {
                let exact = kernel(f64::from(t) + 1.0 - i as f64);
                assert!((f64::from(a) - exact).abs() < 1e-6 && (a - b).abs() < 1e-6, "{t} {i}: {a} {b} {exact}");
                assert!((f64::from(kernel_f32(t + 1.0 - i as f32)) - exact).abs() < 1e-6);
            }
            assert!(slopes.iter().sum::<f32>().abs() < 1e-5);
        }
    }

    #[test]
    fn a_slope_is_read_exactly_and_samples_are_kept() {
        let plane = Plane::from_fn(8, 6, |x, y| 0.25 * x as f32 + 0.5 * y as f32);
        assert_eq!(sample(&plane, 3.5, 2.5), plane.at(3, 2));
        assert!((sample(&plane, 4.0, 3.25) - (0.25 * 3.5 + 0.5 * 2.75)).abs() < 1e-5);
    }
}
