//! The one matrix product of the crate, over `gemm` with AVX-512 where the machine has it.

use gemm_common::Parallelism;

/// `c = a · bᵀ` for row-major `a` (m × k), `b` (n × k), `c` (m × n), on the calling thread.
///
/// # Panics
/// When the slices do not have those lengths.
pub fn a_bt(m: usize, n: usize, k: usize, a: &[f32], b: &[f32], c: &mut [f32]) {
    assert_eq!((a.len(), b.len(), c.len()), (m * k, n * k, m * n));
    if m == 0 || n == 0 {
        return;
    }
    if k == 0 {
        c.fill(0.0);
        return;
    }
    // The kernel fills columns, so it is asked for the transpose: `cᵀ = b · aᵀ`.
    // SAFETY: the asserts above give the pointers the extents that the strides below stay within; `c` is exclusive
    // and does not overlap `a` or `b`, which are shared borrows.
    unsafe {
        gemm_f32::gemm::f32::get_gemm_fn()(
            n,
            m,
            k,
            c.as_mut_ptr(),
            n as isize,
            1,
            false,
            b.as_ptr(),
            1,
            k as isize,
            a.as_ptr(),
            k as isize,
            1,
            0.0,
            1.0,
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_schoolbook() {
        for (m, n, k) in [(1, 1, 1), (3, 5, 7), (17, 33, 64), (100, 100, 1600), (2, 0, 3), (2, 3, 0)] {
            let a: Vec<f32> = (0..m * k).map(|i| (i % 13) as f32 - 6.0).collect();
            let b: Vec<f32> = (0..n * k).map(|i| (i % 7) as f32 - 3.0).collect();
            let mut c = vec![f32::NAN; m * n];
            a_bt(m, n, k, &a, &b, &mut c);
            for i in 0..m {
                for j in 0..n {
                    let expected: f32 = (0..k).map(|l| a[i * k + l] * b[j * k + l]).sum();
                    assert_eq!(c[i * n + j], expected, "{m}x{n}x{k} at {i},{j}");
                }
            }
        }
    }
}
