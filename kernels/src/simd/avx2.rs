//! AVX2 with FMA: 16 registers of 8 f32. With `VNNI` also its products of bytes (AVX-VNNI).

use std::arch::x86_64::*;

use super::{Kernel, Simd};

/// Made in the functions below only, so whoever holds one runs on a processor that has these registers and products.
#[derive(Clone, Copy)]
pub(crate) struct Avx2<const VNNI: bool>(());

/// Runs `kernel` compiled for these registers.
///
/// # Safety
/// The processor has the features named below.
#[target_feature(enable = "avx2,fma")]
pub(crate) unsafe fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx2::<false>(()))
}

/// Runs `kernel` compiled for these registers and their products of bytes.
///
/// # Safety
/// The processor has the features named below.
#[target_feature(enable = "avx2,fma,avxvnni")]
pub(crate) unsafe fn run_vnni<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx2::<true>(()))
}

impl<const VNNI: bool> Avx2<VNNI> {
    /// The two bf16 of each lane as f32.
    #[inline(always)]
    fn halves(self, pairs: __m256i) -> (__m256, __m256) {
        // SAFETY: self is the proof of the features.
        unsafe {
            let high = _mm256_set1_epi32(0xffff_0000_u32 as i32);
            (
                _mm256_castsi256_ps(_mm256_slli_epi32::<16>(pairs)),
                _mm256_castsi256_ps(_mm256_and_si256(pairs, high)),
            )
        }
    }

    /// Byte products by way of 16 bits: `_mm256_maddubs_epi16` would saturate.
    #[inline(always)]
    fn dot_widened(self, a: __m256i, b: __m256i, c: __m256i) -> __m256i {
        // SAFETY: self is the proof of the features.
        unsafe {
            let a_even = _mm256_and_si256(a, _mm256_set1_epi16(0xff));
            let b_even = _mm256_srai_epi16::<8>(_mm256_slli_epi16::<8>(b));
            let even = _mm256_madd_epi16(a_even, b_even);
            let odd = _mm256_madd_epi16(_mm256_srli_epi16::<8>(a), _mm256_srai_epi16::<8>(b));
            _mm256_add_epi32(c, _mm256_add_epi32(even, odd))
        }
    }
}

impl<const VNNI: bool> Simd for Avx2<VNNI> {
    type Vector = __m256;
    type Pairs = __m256i;
    type Integers = __m256i;
    type Quads = __m256i;
    const LANES: usize = 8;
    const REGISTERS: usize = 16;
    const SIGNED_QUADS: bool = false;

    #[inline(always)]
    fn splat(self, value: f32) -> __m256 {
        // SAFETY: self is the proof of the features.
        unsafe { _mm256_set1_ps(value) }
    }

    #[inline(always)]
    fn fma(self, a: __m256, b: __m256, c: __m256) -> __m256 {
        // SAFETY: self is the proof of the features.
        unsafe { _mm256_fmadd_ps(a, b, c) }
    }

    #[inline(always)]
    unsafe fn load(self, from: *const f32) -> __m256 {
        // SAFETY: the caller vouches for `from`, self for the features.
        unsafe { _mm256_loadu_ps(from) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32, value: __m256) {
        // SAFETY: the caller vouches for `to`, self for the features.
        unsafe { _mm256_storeu_ps(to, value) }
    }

    #[inline(always)]
    fn splat_pair(self, pair: u32) -> __m256i {
        // SAFETY: self is the proof of the features.
        unsafe { _mm256_set1_epi32(pair as i32) }
    }

    #[inline(always)]
    fn dot(self, a: __m256i, b: __m256i, c: __m256) -> __m256 {
        let (a, b) = (self.halves(a), self.halves(b));
        self.fma(a.1, b.1, self.fma(a.0, b.0, c))
    }

    #[inline(always)]
    unsafe fn load_pairs(self, from: *const u32) -> __m256i {
        // SAFETY: the caller vouches for `from`, self for the features.
        unsafe { _mm256_loadu_si256(from.cast()) }
    }

    #[inline(always)]
    fn splat_quad(self, quad: u32) -> __m256i {
        // SAFETY: self is the proof of the features.
        unsafe { _mm256_set1_epi32(quad as i32) }
    }

    #[inline(always)]
    fn dot_quads(self, a: __m256i, b: __m256i, c: __m256i) -> __m256i {
        if VNNI {
            // SAFETY: self is the proof of the features.
            unsafe { _mm256_dpbusd_avx_epi32(c, a, b) }
        } else {
            self.dot_widened(a, b, c)
        }
    }

    #[inline(always)]
    fn add_integers(self, a: __m256i, b: __m256i) -> __m256i {
        // SAFETY: self is the proof of the features.
        unsafe { _mm256_add_epi32(a, b) }
    }

    #[inline(always)]
    unsafe fn load_quads(self, from: *const u32) -> __m256i {
        // SAFETY: the caller vouches for `from`, self for the features.
        unsafe { _mm256_loadu_si256(from.cast()) }
    }

    #[inline(always)]
    unsafe fn load_integers(self, from: *const i32) -> __m256i {
        // SAFETY: the caller vouches for `from`, self for the features.
        unsafe { _mm256_loadu_si256(from.cast()) }
    }

    #[inline(always)]
    unsafe fn store_integers(self, to: *mut i32, value: __m256i) {
        // SAFETY: the caller vouches for `to`, self for the features.
        unsafe { _mm256_storeu_si256(to.cast(), value) }
    }
}
