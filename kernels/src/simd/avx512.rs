//! AVX-512: 32 registers of 16 f32. With `BF16` and `VNNI` also products of bf16 (two per lane and cycle) and of bytes (four).

use super::{Lists, Simd};
use std::{arch::x86_64::*, mem::transmute};

mod list;

/// Constructed only where the features are known, so a value proves that the processor has these registers and products.
#[derive(Clone, Copy)]
pub(crate) struct Avx512<const BF16: bool, const VNNI: bool>(());

entries! {
    /// Runs `kernel` compiled for these registers.
    run("avx512f,avx512bw,avx2,fma,popcnt") = Avx512::<false, false>(());
    /// [`run`], with products of bytes.
    run_vnni("avx512f,avx512bw,avx512vnni,avx2,fma,popcnt") = Avx512::<false, true>(());
    /// [`run`], with products of bytes and of bf16.
    run_bf16("avx512f,avx512bw,avx512vnni,avx512bf16,avx2,fma,popcnt") = Avx512::<true, true>(());
}

// SAFETY (all below): self is the proof of the features; the registers have LANES values of 32 bits.
unsafe impl<const BF16: bool, const VNNI: bool> Simd for Avx512<BF16, VNNI> {
    type Vector = __m512;
    type Bits = __m512i;
    const LANES: usize = 16;
    const REGISTERS: usize = 32;

    methods! {
        fn splat(value: f32) -> __m512 = _mm512_set1_ps(value);
        fn fma(a: __m512, b: __m512, c: __m512) -> __m512 = _mm512_fmadd_ps(a, b, c);
        fn splat_bits(lane: u32) -> __m512i = _mm512_set1_epi32(lane as i32);
        fn dot_shorts(a: __m512i, b: __m512i, c: __m512i) -> __m512i = _mm512_add_epi32(_mm512_madd_epi16(a, b), c);
        fn add_bits(a: __m512i, b: __m512i) -> __m512i = _mm512_add_epi32(a, b);
        fn sub_bits(a: __m512i, b: __m512i) -> __m512i = _mm512_sub_epi32(a, b);
        fn add_shorts(a: __m512i, b: __m512i) -> __m512i = _mm512_add_epi16(a, b);
        fn sub_shorts(a: __m512i, b: __m512i) -> __m512i = _mm512_sub_epi16(a, b);
    }

    #[inline(always)]
    fn halves(self, pairs: __m512i) -> (__m512, __m512) {
        unsafe {
            let low = _mm512_slli_epi32::<16>(pairs);
            let high = _mm512_and_si512(pairs, _mm512_set1_epi32(0xffff_0000_u32 as i32));
            (_mm512_castsi512_ps(low), _mm512_castsi512_ps(high))
        }
    }

    #[inline(always)]
    fn dot_pairs(self, a: __m512i, b: __m512i, c: __m512) -> __m512 {
        if BF16 {
            // SAFETY: also, both types are 64 bytes of which every pattern is valid.
            return unsafe {
                let a = transmute::<__m512i, __m512bh>(a);
                _mm512_dpbf16_ps(c, a, transmute::<__m512i, __m512bh>(b))
            };
        }
        let (a, b) = (self.halves(a), self.halves(b));
        self.fma(a.1, b.1, self.fma(a.0, b.0, c))
    }

    /// Without VNNI, products of 16 bits: `_mm512_maddubs_epi16` would saturate.
    #[inline(always)]
    fn dot_quads(self, a: __m512i, b: __m512i, c: __m512i) -> __m512i {
        unsafe {
            if VNNI {
                return _mm512_dpbusd_epi32(c, a, b);
            }
            let a_even = _mm512_and_si512(a, _mm512_set1_epi16(0xff));
            let b_even = _mm512_srai_epi16::<8>(_mm512_slli_epi16::<8>(b));
            let (a_odd, b_odd) = (_mm512_srli_epi16::<8>(a), _mm512_srai_epi16::<8>(b));
            self.dot_shorts(a_odd, b_odd, self.dot_shorts(a_even, b_even, c))
        }
    }

    #[inline(always)]
    fn list(self, lists: &mut Lists, first: usize) {
        list::list(self, lists, first);
    }
}
