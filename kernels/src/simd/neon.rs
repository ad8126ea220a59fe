//! NEON: 32 registers of 4 f32.

use std::arch::aarch64::*;

use super::{Kernel, Simd};

/// Made in [`run`] only, so whoever holds one runs on a processor that has these registers.
#[derive(Clone, Copy)]
pub(crate) struct Neon(());

/// Runs `kernel` compiled for these registers.
///
/// # Safety
/// The processor has the features named below.
#[target_feature(enable = "neon")]
pub(crate) unsafe fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Neon(()))
}

impl Simd for Neon {
    type Vector = float32x4_t;
    const LANES: usize = 4;
    const REGISTERS: usize = 32;

    #[inline(always)]
    fn splat(self, value: f32) -> float32x4_t {
        // SAFETY: self is the proof of the features.
        unsafe { vdupq_n_f32(value) }
    }

    #[inline(always)]
    fn fma(self, a: float32x4_t, b: float32x4_t, c: float32x4_t) -> float32x4_t {
        // SAFETY: self is the proof of the features.
        unsafe { vfmaq_f32(c, a, b) }
    }

    #[inline(always)]
    unsafe fn load(self, from: *const f32) -> float32x4_t {
        // SAFETY: the caller vouches for `from`, self for the features.
        unsafe { vld1q_f32(from) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32, value: float32x4_t) {
        // SAFETY: the caller vouches for `to`, self for the features.
        unsafe { vst1q_f32(to, value) }
    }
}
