//! NEON: 32 registers of 4 f32. With `DOT` also products of bytes.

use super::Simd;
use std::{arch::aarch64::*, mem::transmute};

/// Only the functions below construct it, so a value proves that the processor has these registers and products.
#[derive(Clone, Copy)]
pub(crate) struct Neon<const DOT: bool>(());

entries! {
    /// Runs `kernel` compiled for these registers.
    run("neon") = Neon::<false>(());
    /// [`run`], with products of bytes.
    run_dot("neon,dotprod") = Neon::<true>(());
}

// SAFETY (all below): self is the proof of the features; the registers have LANES values of 32 bits.
unsafe impl<const DOT: bool> Simd for Neon<DOT> {
    type Vector = float32x4_t;
    type Bits = uint32x4_t;
    const LANES: usize = 4;
    const REGISTERS: usize = 32;
    // NEON multiplies two signed or two unsigned bytes; only later processors multiply a signed by an unsigned byte.
    const SIGNED_BYTES: bool = true;

    methods! {
        fn splat(value: f32) -> float32x4_t = vdupq_n_f32(value);
        fn fma(a: float32x4_t, b: float32x4_t, c: float32x4_t) -> float32x4_t = vfmaq_f32(c, a, b);
        fn splat_bits(lane: u32) -> uint32x4_t = vdupq_n_u32(lane);
        fn add_bits(a: uint32x4_t, b: uint32x4_t) -> uint32x4_t = vaddq_u32(a, b);
        fn sub_bits(a: uint32x4_t, b: uint32x4_t) -> uint32x4_t = vsubq_u32(a, b);
        fn add_shorts(a: uint32x4_t, b: uint32x4_t) -> uint32x4_t = transmute(vaddq_u16(transmute(a), transmute(b)));
        fn sub_shorts(a: uint32x4_t, b: uint32x4_t) -> uint32x4_t = transmute(vsubq_u16(transmute(a), transmute(b)));
    }

    #[inline(always)]
    fn halves(self, pairs: uint32x4_t) -> (float32x4_t, float32x4_t) {
        unsafe {
            let (low, high) = (vshlq_n_u32::<16>(pairs), vdupq_n_u32(0xffff_0000));
            let high = vandq_u32(pairs, high);
            (vreinterpretq_f32_u32(low), vreinterpretq_f32_u32(high))
        }
    }

    #[inline(always)]
    fn dot_quads(self, a: uint32x4_t, b: uint32x4_t, c: uint32x4_t) -> uint32x4_t {
        unsafe {
            let (a, b) = (vreinterpretq_s8_u32(a), vreinterpretq_s8_u32(b));
            let mut sum = vreinterpretq_s32_u32(c);
            if DOT {
                // The instruction uses registers alone. The intrinsic is not stable.
                std::arch::asm!(
                    "sdot {sum:v}.4s, {a:v}.16b, {b:v}.16b",
                    sum = inout(vreg) sum, a = in(vreg) a, b = in(vreg) b,
                    options(pure, nomem, nostack, preserves_flags)
                );
            } else {
                // Products of 16 bits. The sum of two products fits: at most 2 * 128 * 127.
                let low = vmull_s8(vget_low_s8(a), vget_low_s8(b));
                sum = vpadalq_s16(sum, vpaddq_s16(low, vmull_high_s8(a, b)));
            }
            vreinterpretq_u32_s32(sum)
        }
    }

    #[inline(always)]
    fn dot_shorts(self, a: uint32x4_t, b: uint32x4_t, c: uint32x4_t) -> uint32x4_t {
        unsafe {
            let (a, b) = (vreinterpretq_s16_u32(a), vreinterpretq_s16_u32(b));
            let low = vmull_s16(vget_low_s16(a), vget_low_s16(b));
            let pairs = vpaddq_s32(low, vmull_high_s16(a, b));
            vaddq_u32(c, vreinterpretq_u32_s32(pairs))
        }
    }
}
