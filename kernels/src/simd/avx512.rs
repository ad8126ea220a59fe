//! AVX-512: 32 registers of 16 f32.

use std::arch::x86_64::*;

use super::{Kernel, Lists, Simd, list_avx512};

/// Made where the features are known only, so whoever holds one runs on a processor that has these registers.
#[derive(Clone, Copy)]
pub(crate) struct Avx512(());

/// Runs `kernel` compiled for these registers.
///
/// # Safety
/// The processor has the features named below.
#[target_feature(enable = "avx512f,avx2,fma,popcnt")]
pub(crate) unsafe fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx512::new())
}

impl Avx512 {
    /// The proof, where the features are known: safe to call from code compiled for them only.
    #[target_feature(enable = "avx512f,avx2,fma,popcnt")]
    #[inline]
    pub(super) fn new() -> Avx512 {
        Avx512(())
    }

    /// The two bf16 of each lane as f32.
    #[inline(always)]
    fn halves(self, pairs: __m512i) -> (__m512, __m512) {
        // SAFETY: self is the proof of the features.
        unsafe {
            let high = _mm512_set1_epi32(0xffff_0000_u32 as i32);
            (
                _mm512_castsi512_ps(_mm512_slli_epi32::<16>(pairs)),
                _mm512_castsi512_ps(_mm512_and_si512(pairs, high)),
            )
        }
    }
}

impl Simd for Avx512 {
    type Vector = __m512;
    type Pairs = __m512i;
    const LANES: usize = 16;
    const REGISTERS: usize = 32;

    #[inline(always)]
    fn splat(self, value: f32) -> __m512 {
        // SAFETY: self is the proof of the features.
        unsafe { _mm512_set1_ps(value) }
    }

    #[inline(always)]
    fn fma(self, a: __m512, b: __m512, c: __m512) -> __m512 {
        // SAFETY: self is the proof of the features.
        unsafe { _mm512_fmadd_ps(a, b, c) }
    }

    #[inline(always)]
    unsafe fn load(self, from: *const f32) -> __m512 {
        // SAFETY: the caller vouches for `from`, self for the features.
        unsafe { _mm512_loadu_ps(from) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32, value: __m512) {
        // SAFETY: the caller vouches for `to`, self for the features.
        unsafe { _mm512_storeu_ps(to, value) }
    }

    #[inline(always)]
    fn splat_pair(self, pair: u32) -> __m512i {
        // SAFETY: self is the proof of the features.
        unsafe { _mm512_set1_epi32(pair as i32) }
    }

    #[inline(always)]
    fn dot(self, a: __m512i, b: __m512i, c: __m512) -> __m512 {
        let (a, b) = (self.halves(a), self.halves(b));
        self.fma(a.1, b.1, self.fma(a.0, b.0, c))
    }

    #[inline(always)]
    unsafe fn load_pairs(self, from: *const u32) -> __m512i {
        // SAFETY: the caller vouches for `from`, self for the features.
        unsafe { _mm512_loadu_si512(from.cast()) }
    }

    #[inline(always)]
    fn list(self, index: &[u32], taps: usize, first: usize, lists: &mut Lists) {
        list_avx512::list(self, index, taps, first, lists);
    }
}
