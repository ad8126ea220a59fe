//! Any processor: four f32 that the compiler may or may not put in a register.

use super::Simd;

#[derive(Clone, Copy)]
pub(crate) struct Plain;

impl Simd for Plain {
    type Vector = [f32; 4];
    type Pairs = [u32; 4];
    const LANES: usize = 4;
    const REGISTERS: usize = 16;

    #[inline(always)]
    fn splat(self, value: f32) -> [f32; 4] {
        [value; 4]
    }

    // Not `mul_add`: without the instruction it is a call of a slow function.
    #[inline(always)]
    fn fma(self, a: [f32; 4], b: [f32; 4], c: [f32; 4]) -> [f32; 4] {
        [
            a[0] * b[0] + c[0],
            a[1] * b[1] + c[1],
            a[2] * b[2] + c[2],
            a[3] * b[3] + c[3],
        ]
    }

    #[inline(always)]
    unsafe fn load(self, from: *const f32) -> [f32; 4] {
        // SAFETY: the caller vouches for `from`; alignment is not assumed.
        unsafe { from.cast::<[f32; 4]>().read_unaligned() }
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32, value: [f32; 4]) {
        // SAFETY: the caller vouches for `to`; alignment is not assumed.
        unsafe { to.cast::<[f32; 4]>().write_unaligned(value) }
    }

    #[inline(always)]
    fn splat_pair(self, pair: u32) -> [u32; 4] {
        [pair; 4]
    }

    #[inline(always)]
    fn dot(self, a: [u32; 4], b: [u32; 4], c: [f32; 4]) -> [f32; 4] {
        let low = |pairs: [u32; 4]| pairs.map(|pair| f32::from_bits(pair << 16));
        let high = |pairs: [u32; 4]| pairs.map(|pair| f32::from_bits(pair & 0xffff_0000));
        self.fma(high(a), high(b), self.fma(low(a), low(b), c))
    }

    #[inline(always)]
    unsafe fn load_pairs(self, from: *const u32) -> [u32; 4] {
        // SAFETY: the caller vouches for `from`; alignment is not assumed.
        unsafe { from.cast::<[u32; 4]>().read_unaligned() }
    }
}
