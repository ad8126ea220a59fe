//! AVX2 with FMA: 16 registers of 8 f32. With `VNNI` also products of bytes (AVX-VNNI).

use super::Simd;
use std::arch::x86_64::*;

/// Only the functions below construct it, so a value proves that the processor has these registers and products.
#[derive(Clone, Copy)]
pub(crate) struct Avx2<const VNNI: bool>(());

entries! {
    /// Runs `kernel` compiled for these registers.
    run("avx2,fma,popcnt") = Avx2::<false>(());
    /// [`run`], with products of bytes.
    run_vnni("avx2,fma,popcnt,avxvnni") = Avx2::<true>(());
}

// SAFETY (all below): self is the proof of the features; the registers have LANES values of 32 bits.
unsafe impl<const VNNI: bool> Simd for Avx2<VNNI> {
    type Vector = __m256;
    type Bits = __m256i;
    const LANES: usize = 8;
    const REGISTERS: usize = 16;

    methods! {
        fn splat(value: f32) -> __m256 = _mm256_set1_ps(value);
        fn fma(a: __m256, b: __m256, c: __m256) -> __m256 = _mm256_fmadd_ps(a, b, c);
        fn splat_bits(lane: u32) -> __m256i = _mm256_set1_epi32(lane as i32);
        fn dot_shorts(a: __m256i, b: __m256i, c: __m256i) -> __m256i = _mm256_add_epi32(_mm256_madd_epi16(a, b), c);
        fn add_bits(a: __m256i, b: __m256i) -> __m256i = _mm256_add_epi32(a, b);
        fn sub_bits(a: __m256i, b: __m256i) -> __m256i = _mm256_sub_epi32(a, b);
        fn add_shorts(a: __m256i, b: __m256i) -> __m256i = _mm256_add_epi16(a, b);
        fn sub_shorts(a: __m256i, b: __m256i) -> __m256i = _mm256_sub_epi16(a, b);
    }

    #[inline(always)]
    fn halves(self, pairs: __m256i) -> (__m256, __m256) {
        unsafe {
            let low = _mm256_slli_epi32::<16>(pairs);
            let high = _mm256_and_si256(pairs, _mm256_set1_epi32(0xffff_0000_u32 as i32));
            (_mm256_castsi256_ps(low), _mm256_castsi256_ps(high))
        }
    }

    /// Without VNNI, products of 16 bits: `_mm256_maddubs_epi16` would saturate.
    #[inline(always)]
    fn dot_quads(self, a: __m256i, b: __m256i, c: __m256i) -> __m256i {
        unsafe {
            if VNNI {
                return _mm256_dpbusd_avx_epi32(c, a, b);
            }
            let a_even = _mm256_and_si256(a, _mm256_set1_epi16(0xff));
            let b_even = _mm256_srai_epi16::<8>(_mm256_slli_epi16::<8>(b));
            let (a_odd, b_odd) = (_mm256_srli_epi16::<8>(a), _mm256_srai_epi16::<8>(b));
            self.dot_shorts(a_odd, b_odd, self.dot_shorts(a_even, b_even, c))
        }
    }
}
