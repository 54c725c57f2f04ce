//! Separable smoothing.

use super::image::Plane;

/// Sampled Gaussian of standard deviation `sigma` pixels, normalised, radius `⌈3σ⌉`; one tap when `sigma` is 0.
pub fn gaussian_kernel(sigma: f32) -> Vec<f32> {
    if sigma <= 0.0 {
        return vec![1.0];
    }
    let radius = (3.0 * sigma).ceil() as i32;
    let taps: Vec<f32> = (-radius..=radius).map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp()).collect();
    let sum: f32 = taps.iter().sum();
    taps.into_iter().map(|t| t / sum).collect()
}

/// Correlation with `kernel` (odd length) along rows and columns, borders clamped.
pub fn separable(plane: &Plane, kernel: &[f32]) -> Plane {
    columns(&rows(plane, kernel), kernel)
}

/// Gaussian blur, borders clamped.
pub fn gaussian(plane: &Plane, sigma: f32) -> Plane {
    separable(plane, &gaussian_kernel(sigma))
}

/// Correlation with `kernel` (odd length) along rows, borders clamped.
pub fn rows(plane: &Plane, kernel: &[f32]) -> Plane {
    let radius = kernel.len() / 2;
    let mut out = Plane::zeros(plane.width, plane.height);
    let mut padded = vec![0.0; plane.width + 2 * radius];
    for y in 0..plane.height {
        let row = plane.row(y);
        padded[..radius].fill(row[0]);
        padded[radius..radius + plane.width].copy_from_slice(row);
        padded[radius + plane.width..].fill(row[plane.width - 1]);
        let out_row = out.row_mut(y);
        for (k, &tap) in kernel.iter().enumerate() {
            out_row.iter_mut().zip(&padded[k..]).for_each(|(o, &p)| *o += tap * p);
        }
    }
    out
}

/// Correlation with `kernel` (odd length) along columns, borders clamped.
pub fn columns(plane: &Plane, kernel: &[f32]) -> Plane {
    let radius = kernel.len() as isize / 2;
    let mut out = Plane::zeros(plane.width, plane.height);
    for y in 0..plane.height {
        for (k, &tap) in kernel.iter().enumerate() {
            let source = (y as isize + k as isize - radius).clamp(0, plane.height as isize - 1) as usize;
            out.row_mut(y).iter_mut().zip(plane.row(source)).for_each(|(o, &p)| *o += tap * p);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_stays_and_an_impulse_keeps_its_mass() {
        let flat = gaussian(&Plane::filled(9, 7, 0.25), 1.5);
        assert!(flat.data.iter().all(|v| (v - 0.25).abs() < 1e-6));
        let mut impulse = Plane::zeros(21, 21);
        *impulse.at_mut(10, 10) = 1.0;
        let blurred = gaussian(&impulse, 1.5);
        assert!((blurred.data.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        let variance: f32 = (0..21).map(|x| blurred.row(10)[x] * (x as f32 - 10.0).powi(2)).sum::<f32>()
            / blurred.row(10).iter().sum::<f32>();
        assert!((variance - 2.25).abs() < 0.05, "variance {variance}");
    }
}
