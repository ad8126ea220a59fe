//! AVX-512 with its bf16 products: two a lane and a cycle. All else is as in [`Avx512`].

use std::arch::x86_64::*;

use super::{Kernel, Lists, Simd, avx512::Avx512, list_avx512};

/// Made in [`run`] only, so whoever holds one runs on a processor that has these registers and products.
#[derive(Clone, Copy)]
pub(crate) struct Avx512Bf16(Avx512);

/// Runs `kernel` compiled for these registers and products.
///
/// # Safety
/// The processor has the features named below.
#[target_feature(enable = "avx512f,avx512bf16,avx2,fma,popcnt")]
pub(crate) unsafe fn run<K: Kernel>(kernel: K) -> K::Output {
    kernel.run(Avx512Bf16(Avx512::new()))
}

impl Simd for Avx512Bf16 {
    type Vector = __m512;
    type Pairs = __m512bh;
    const LANES: usize = Avx512::LANES;
    const REGISTERS: usize = Avx512::REGISTERS;

    #[inline(always)]
    fn splat(self, value: f32) -> __m512 {
        self.0.splat(value)
    }

    #[inline(always)]
    fn fma(self, a: __m512, b: __m512, c: __m512) -> __m512 {
        self.0.fma(a, b, c)
    }

    #[inline(always)]
    unsafe fn load(self, from: *const f32) -> __m512 {
        // SAFETY: the caller vouches for `from`.
        unsafe { self.0.load(from) }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32, value: __m512) {
        // SAFETY: the caller vouches for `to`.
        unsafe { self.0.store(to, value) }
    }

    #[inline(always)]
    fn splat_pair(self, pair: u32) -> __m512bh {
        // SAFETY: both are 64 bytes of which every pattern is valid.
        unsafe { std::mem::transmute::<__m512i, __m512bh>(self.0.splat_pair(pair)) }
    }

    #[inline(always)]
    fn dot(self, a: __m512bh, b: __m512bh, c: __m512) -> __m512 {
        // SAFETY: self is the proof of the features.
        unsafe { _mm512_dpbf16_ps(c, a, b) }
    }

    #[inline(always)]
    unsafe fn load_pairs(self, from: *const u32) -> __m512bh {
        // SAFETY: the caller vouches for `from`; both types are 64 bytes of which every pattern is valid.
        unsafe { std::mem::transmute::<__m512i, __m512bh>(self.0.load_pairs(from)) }
    }

    #[inline(always)]
    fn list(self, index: &[u32], taps: usize, first: usize, lists: &mut Lists) {
        list_avx512::list(self.0, index, taps, first, lists);
    }
}
