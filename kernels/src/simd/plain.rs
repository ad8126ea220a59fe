//! Any processor: four values that the compiler may or may not put in a register.

use super::Simd;

#[derive(Clone, Copy)]
pub(crate) struct Plain;

impl Simd for Plain {
    type Vector = [f32; 4];
    type Pairs = [u32; 4];
    type Integers = [i32; 4];
    type Quads = [u32; 4];
    const LANES: usize = 4;
    const REGISTERS: usize = 16;
    const SIGNED_QUADS: bool = false;

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

    #[inline(always)]
    fn splat_quad(self, quad: u32) -> [u32; 4] {
        [quad; 4]
    }

    #[inline(always)]
    fn dot_quads(self, a: [u32; 4], b: [u32; 4], c: [i32; 4]) -> [i32; 4] {
        let product = |lane: usize, byte: usize| {
            let (a, b) = (a[lane].to_ne_bytes()[byte], b[lane].to_ne_bytes()[byte]);
            i32::from(a) * i32::from(b as i8)
        };
        let sum = |lane| {
            let four = product(lane, 0) + product(lane, 1) + product(lane, 2) + product(lane, 3);
            c[lane].wrapping_add(four)
        };
        [sum(0), sum(1), sum(2), sum(3)]
    }

    #[inline(always)]
    fn add_integers(self, a: [i32; 4], b: [i32; 4]) -> [i32; 4] {
        std::array::from_fn(|lane| a[lane].wrapping_add(b[lane]))
    }

    #[inline(always)]
    unsafe fn load_quads(self, from: *const u32) -> [u32; 4] {
        // SAFETY: the caller vouches for `from`; alignment is not assumed.
        unsafe { from.cast::<[u32; 4]>().read_unaligned() }
    }

    #[inline(always)]
    unsafe fn load_integers(self, from: *const i32) -> [i32; 4] {
        // SAFETY: the caller vouches for `from`; alignment is not assumed.
        unsafe { from.cast::<[i32; 4]>().read_unaligned() }
    }

    #[inline(always)]
    unsafe fn store_integers(self, to: *mut i32, value: [i32; 4]) {
        // SAFETY: the caller vouches for `to`; alignment is not assumed.
        unsafe { to.cast::<[i32; 4]>().write_unaligned(value) }
    }
}
