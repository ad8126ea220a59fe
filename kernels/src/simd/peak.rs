//! A loop of multiply-adds on registers alone: what the processor can do at most.

use super::{Kernel, Level, Simd};

/// Independent sums: more than the latency of a multiply-add times the units that do them.
const SUMS: usize = 12;

/// Multiplies and adds on registers alone, `steps` times; returns the floating point operations done and a value
/// that depends on all of them. Timed by the caller, it gives the peak that a kernel can be compared with.
pub fn spin(level: Level, steps: usize) -> (f64, f32) {
    level.run(Spin { steps })
}

/// As [`spin`], with products of bf16.
pub fn spin_bf16(level: Level, steps: usize) -> (f64, f32) {
    level.run(SpinBf16 { steps })
}

/// As [`spin`], with products of bytes and sums in i32; in f64 the integer operations.
pub fn spin_int8(level: Level, steps: usize) -> (f64, i32) {
    level.run(SpinInt8 { steps })
}

struct Spin {
    steps: usize,
}

struct SpinBf16 {
    steps: usize,
}

struct SpinInt8 {
    steps: usize,
}

impl Kernel for Spin {
    type Output = (f64, f32);

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> (f64, f32) {
        let mut sums = [simd.splat(1.0); SUMS];
        let (scale, shift) = (
            simd.splat(std::hint::black_box(0.999)),
            simd.splat(std::hint::black_box(0.001)),
        );
        for _ in 0..self.steps {
            for sum in &mut sums {
                *sum = simd.fma(*sum, scale, shift);
            }
        }
        let mut values = [0.0; 16];
        for sum in sums {
            // SAFETY: a register has at most 16 lanes, `values` has 16.
            unsafe {
                simd.store(
                    values.as_mut_ptr(),
                    simd.fma(sum, scale, simd.load(values.as_ptr())),
                )
            };
        }
        ((self.steps * SUMS * S::LANES * 2) as f64, values[0])
    }
}

impl Kernel for SpinBf16 {
    type Output = (f64, f32);

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> (f64, f32) {
        let mut sums = [simd.splat(1.0); SUMS];
        // 0.5 and 0.25 in both halves.
        let (a, b) = (
            simd.splat_pair(std::hint::black_box(0x3f00_3f00)),
            simd.splat_pair(std::hint::black_box(0x3e80_3e80)),
        );
        for _ in 0..self.steps {
            for sum in &mut sums {
                *sum = simd.dot(a, b, *sum);
            }
        }
        let mut values = [0.0; 16];
        let one = simd.splat(1.0);
        for sum in sums {
            // SAFETY: a register has at most 16 lanes, `values` has 16.
            unsafe {
                simd.store(
                    values.as_mut_ptr(),
                    simd.fma(sum, one, simd.load(values.as_ptr())),
                )
            };
        }
        ((self.steps * SUMS * S::LANES * 4) as f64, values[0])
    }
}

impl Kernel for SpinInt8 {
    type Output = (f64, i32);

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> (f64, i32) {
        let mut values = [0_i32; 16];
        let from = [0x0101_0201_u32; 16];
        // SAFETY: a register has at most 16 lanes, `values` and `from` have 16.
        unsafe {
            let mut sums = [simd.load_integers(values.as_ptr()); SUMS];
            // Different ones, read anew at each step: products that stay the same would be computed once.
            let mut inputs = [simd.splat_quad(0); SUMS];
            for (input, number) in inputs.iter_mut().zip(1..) {
                *input = simd.splat_quad(std::hint::black_box(number));
            }
            for _ in 0..self.steps {
                let weights = simd.load_quads(std::hint::black_box(from.as_ptr()));
                for (sum, input) in sums.iter_mut().zip(inputs) {
                    *sum = simd.dot_quads(input, weights, *sum);
                }
            }
            for sum in sums {
                let before = simd.load_integers(values.as_ptr());
                simd.store_integers(values.as_mut_ptr(), simd.add_integers(sum, before));
            }
        }
        ((self.steps * SUMS * S::LANES * 8) as f64, values[0])
    }
}
