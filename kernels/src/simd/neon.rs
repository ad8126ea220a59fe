//! NEON: 32 registers of 4 f32. With `DOT` also its products of bytes.

use std::arch::aarch64::*;

use super::{Kernel, Simd};

/// Made in the functions below only, so whoever holds one runs on a processor that has these registers and products.
#[derive(Clone, Copy)]
pub(crate) struct Neon<const DOT: bool>(());

/// Runs `kernel` compiled for these registers.
///
/// # Safety
/// The processor has the features named below.
#[target_feature(enable = "neon")]
pub(crate) unsafe fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Neon::<false>(()))
}

/// Runs `kernel` compiled for these registers and their products of bytes.
///
/// # Safety
/// The processor has the features named below.
#[target_feature(enable = "neon,dotprod")]
pub(crate) unsafe fn run_dot<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Neon::<true>(()))
}

impl<const DOT: bool> Neon<DOT> {
    /// Byte products by way of 16 bits. Two of them fit: at most 2 * 128 * 127.
    #[inline(always)]
    fn dot_widened(self, a: int8x16_t, b: int8x16_t, c: int32x4_t) -> int32x4_t {
        // SAFETY: self is the proof of the features.
        unsafe {
            let low = vmull_s8(vget_low_s8(a), vget_low_s8(b));
            let high = vmull_high_s8(a, b);
            vpadalq_s16(c, vpaddq_s16(low, high))
        }
    }

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

impl<const DOT: bool> Simd for Neon<DOT> {
    type Vector = float32x4_t;
    type Pairs = uint32x4_t;
    type Integers = int32x4_t;
    type Quads = int8x16_t;
    const LANES: usize = 4;
    const REGISTERS: usize = 32;
    // There are products of two signed bytes, and of two unsigned ones; of both only in later processors.
    const SIGNED_QUADS: bool = true;

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

    #[inline(always)]
    fn splat_quad(self, quad: u32) -> int8x16_t {
        // SAFETY: self is the proof of the features. Turning the upper bit takes 128 from each byte.
        unsafe { vreinterpretq_s8_u32(vdupq_n_u32(quad ^ 0x8080_8080)) }
    }

    #[inline(always)]
    fn dot_quads(self, a: int8x16_t, b: int8x16_t, c: int32x4_t) -> int32x4_t {
        if DOT {
            let mut sum = c;
            // SAFETY: self is the proof of the features; registers alone. (The intrinsic is not stable.)
            unsafe {
                std::arch::asm!(
                    "sdot {sum:v}.4s, {a:v}.16b, {b:v}.16b",
                    sum = inout(vreg) sum, a = in(vreg) a, b = in(vreg) b,
                    options(pure, nomem, nostack, preserves_flags)
                );
            }
            sum
        } else {
            self.dot_widened(a, b, c)
        }
    }

    #[inline(always)]
    fn add_integers(self, a: int32x4_t, b: int32x4_t) -> int32x4_t {
        // SAFETY: self is the proof of the features.
        unsafe { vaddq_s32(a, b) }
    }

    #[inline(always)]
    unsafe fn load_quads(self, from: *const u32) -> int8x16_t {
        // SAFETY: the caller vouches for `from`, self for the features.
        unsafe { vreinterpretq_s8_u32(vld1q_u32(from)) }
    }

    #[inline(always)]
    unsafe fn load_integers(self, from: *const i32) -> int32x4_t {
        // SAFETY: the caller vouches for `from`, self for the features.
        unsafe { vld1q_s32(from) }
    }

    #[inline(always)]
    unsafe fn store_integers(self, to: *mut i32, value: int32x4_t) {
        // SAFETY: the caller vouches for `to`, self for the features.
        unsafe { vst1q_s32(to, value) }
    }
}
