//! The one matrix product of the crate, over the kernels of `gemm` for the instruction set in use.
//!
//! `gemm` itself takes the best set that the machine has and offers no choice; its parts do.

use gemm_common::Parallelism;
use gemm_common::gemm::gemm_basic_generic;
use gemm_common::simd::MixedSimd;

#[cfg(target_arch = "x86_64")]
use super::instructions::InstructionSet;

/// The product by the kernels of one module of `gemm_f32`, with the proof that the machine has its instructions.
macro_rules! product {
    ($module:ident, $proof:ident, ($m:expr, $n:expr, $k:expr), ($a:expr, $b:expr, $c:expr)) => {{
        use gemm_f32::microkernel::$module::f32::{H_M, H_N, H_UKR, MR_DIV_N, NR, UKR};
        const N: usize = lanes(stringify!($module));
        let proof = <gemm_common::simd::$proof as MixedSimd<f32, f32, f32, f32>>::try_new();
        // Every machine that has the set has what goes with it there.
        let Some(proof) = proof else { unreachable!("no {}", stringify!($module)) };
        // SAFETY: the caller's asserts give the pointers the extents that the strides stay within; `c` is exclusive and
        // does not overlap `a` or `b`, which are shared borrows.
        unsafe {
            gemm_basic_generic::<_, f32, N, { MR_DIV_N * N }, NR, MR_DIV_N, H_M, H_N>(
                proof,
                $m,
                $n,
                $k,
                $c.as_mut_ptr(),
                1,
                $n as isize,
                false,
                $a.as_ptr(),
                1,
                $k as isize,
                $b.as_ptr(),
                $k as isize,
                1,
                0.0,
                1.0,
                false,
                false,
                false,
                |a, b, c| a * b + c,
                &UKR,
                &H_UKR,
                false,
                Parallelism::None,
            );
        }
    }};
}

/// Numbers in a register of a module's kernels.
const fn lanes(module: &str) -> usize {
    match module.as_bytes() {
        b"avx512f" => 16,
        b"fma" => 8,
        b"neon" => 4,
        _ => 1,
    }
}

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
    #[cfg(target_arch = "x86_64")]
    match InstructionSet::chosen() {
        InstructionSet::Avx512 => product!(avx512f, V4, (m, n, k), (a, b, c)),
        InstructionSet::Avx2 => product!(fma, V3, (m, n, k), (a, b, c)),
        InstructionSet::Portable => product!(scalar, Scalar, (m, n, k), (a, b, c)),
    }
    #[cfg(target_arch = "aarch64")]
    product!(neon, Scalar, (m, n, k), (a, b, c));
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
    product!(scalar, Scalar, (m, n, k), (a, b, c));
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
