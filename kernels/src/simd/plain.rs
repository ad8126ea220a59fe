//! For any processor: arrays of four values, which the compiler may put in a register.

use super::Simd;

#[derive(Clone, Copy)]
pub(crate) struct Plain;

// SAFETY: the registers have LANES values of 32 bits.
unsafe impl Simd for Plain {
    type Vector = [f32; 4];
    type Bits = [u32; 4];
    const LANES: usize = 4;
    const REGISTERS: usize = 16;

    methods! {
        fn splat(value: f32) -> [f32; 4] = [value; 4];
        fn splat_bits(lane: u32) -> [u32; 4] = [lane; 4];
        fn add_bits(a: [u32; 4], b: [u32; 4]) -> [u32; 4] = std::array::from_fn(|lane| a[lane].wrapping_add(b[lane]));
        fn sub_bits(a: [u32; 4], b: [u32; 4]) -> [u32; 4] = std::array::from_fn(|lane| a[lane].wrapping_sub(b[lane]));
        fn add_shorts(a: [u32; 4], b: [u32; 4]) -> [u32; 4] = by_shorts(a, b, u16::wrapping_add);
        fn sub_shorts(a: [u32; 4], b: [u32; 4]) -> [u32; 4] = by_shorts(a, b, u16::wrapping_sub);
    }

    // Not `mul_add`: without the instruction it is a call of a slow function.
    #[inline(always)]
    fn fma(self, a: [f32; 4], b: [f32; 4], c: [f32; 4]) -> [f32; 4] {
        let sum = |lane| a[lane] * b[lane] + c[lane];
        [sum(0), sum(1), sum(2), sum(3)]
    }

    #[inline(always)]
    fn halves(self, pairs: [u32; 4]) -> ([f32; 4], [f32; 4]) {
        let low = pairs.map(|pair| f32::from_bits(pair << 16));
        (low, pairs.map(|pair| f32::from_bits(pair & 0xffff_0000)))
    }

    #[inline(always)]
    fn dot_quads(self, a: [u32; 4], b: [u32; 4], c: [u32; 4]) -> [u32; 4] {
        let product = |lane: usize, byte: usize| {
            let (a, b) = (a[lane].to_ne_bytes()[byte], b[lane].to_ne_bytes()[byte]);
            i32::from(a) * i32::from(b as i8)
        };
        let sum = |lane| {
            let four = product(lane, 0) + product(lane, 1) + product(lane, 2) + product(lane, 3);
            c[lane].wrapping_add_signed(four)
        };
        [sum(0), sum(1), sum(2), sum(3)]
    }

    #[inline(always)]
    fn dot_shorts(self, a: [u32; 4], b: [u32; 4], c: [u32; 4]) -> [u32; 4] {
        let product = |lane: usize, half: u32| {
            let (a, b) = (a[lane] >> half, b[lane] >> half);
            i32::from(a as i16) * i32::from(b as i16)
        };
        let pair = |lane| product(lane, 0).wrapping_add(product(lane, 16));
        std::array::from_fn(|lane| c[lane].wrapping_add_signed(pair(lane)))
    }
}

#[inline(always)]
fn by_shorts(a: [u32; 4], b: [u32; 4], work: impl Fn(u16, u16) -> u16) -> [u32; 4] {
    let half = |a: u32, b: u32, at: u32| u32::from(work((a >> at) as u16, (b >> at) as u16)) << at;
    std::array::from_fn(|lane| half(a[lane], b[lane], 0) | half(a[lane], b[lane], 16))
}
