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

impl Neon {
    /// The two bf16 of each lane as f32.
    #[inline(always)]
    fn halves(self, pairs: uint32x4_t) -> (float32x4_t, float32x4_t) {
        // SAFETY: self is the proof of the features.
        unsafe {
            let high = vdupq_n_u32(0xffff_0000);
            (
                vreinterpretq_f32_u32(vshlq_n_u32::<16>(pairs)),
                vreinterpretq_f32_u32(vandq_u32(pairs, high)),
            )
        }
    }
}

impl Simd for Neon {
    type Vector = float32x4_t;
    type Pairs = uint32x4_t;
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

    #[inline(always)]
    fn splat_pair(self, pair: u32) -> uint32x4_t {
        // SAFETY: self is the proof of the features.
        unsafe { vdupq_n_u32(pair) }
    }

    #[inline(always)]
    fn dot(self, a: uint32x4_t, b: uint32x4_t, c: float32x4_t) -> float32x4_t {
        let (a, b) = (self.halves(a), self.halves(b));
        self.fma(a.1, b.1, self.fma(a.0, b.0, c))
    }

    #[inline(always)]
    unsafe fn load_pairs(self, from: *const u32) -> uint32x4_t {
        // SAFETY: the caller vouches for `from`, self for the features.
        unsafe { vld1q_u32(from) }
    }
}
