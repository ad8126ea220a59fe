//! The types of a row's values: f32; bf16 with half the memory and twice the products per cycle; u8 with a quarter of the memory
//! and four times the products per cycle; i16 with the values of u8, where the processor has no products of bytes.

use super::{Level, Operand, Products, Simd, load};

/// A bfloat16: the upper half of an f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct Bf16(pub u16);

/// A value of a row: [`f32`], [`Bf16`], [`u8`] (a multiple of a unit that the caller knows), or [`i16`] (the same values as [`u8`]).
pub trait Element: Copy + Default + Send + Sync + Operand + Into<f32> {
    /// Adds the products of a block to its sums.
    fn accumulate(level: Level, products: Products<Self>);

    /// Converts a sum in f32 to this type.
    fn from_f32(value: f32) -> Self;

    /// The same value as f32.
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self.into()
    }
}

impl Element for f32 {
    compiled_here!(accumulate(Products));

    #[inline(always)]
    fn from_f32(value: f32) -> f32 {
        value
    }
}

impl Element for Bf16 {
    compiled_here!(accumulate(Products));

    /// Rounds to the nearest, ties to even; NaN stays NaN, and a value beyond the largest bf16 becomes infinite.
    #[inline(always)]
    fn from_f32(value: f32) -> Bf16 {
        let bits = value.to_bits();
        let rounded = bits.wrapping_add(0x7fff + ((bits >> 16) & 1)) >> 16;
        let quiet = (bits >> 16) | 0x40;
        Bf16(if value.is_nan() { quiet } else { rounded } as u16)
    }
}

impl From<Bf16> for f32 {
    #[inline(always)]
    fn from(value: Bf16) -> f32 {
        f32::from_bits(u32::from(value.0) << 16)
    }
}

impl Element for u8 {
    compiled_here!(accumulate(Products));

    /// Rounds to the nearest, ties to even; 0 below 0 and for NaN, 255 above 255.
    #[inline(always)]
    fn from_f32(value: f32) -> u8 {
        let positive = if value > 0.0 { value } else { 0.0 };
        let bounded = if positive < 255.0 { positive } else { 255.0 };
        // 1.5 * 2^23: at this size the low bits of an f32 are its integer value.
        (bounded + 12_582_912.0).to_bits() as u8
    }
}

impl Element for i16 {
    compiled_here!(accumulate(Products));

    /// Rounds as [`u8`] does.
    #[inline(always)]
    fn from_f32(value: f32) -> i16 {
        i16::from(<u8 as Element>::from_f32(value))
    }
}

// SAFETY (all below): the caller guarantees the pointers.
impl Operand for f32 {
    type Weight = f32;
    type Sum = f32;
    type Factor<S: Simd> = S::Vector;
    type Total<S: Simd> = S::Vector;
    const STEP: usize = 1;

    #[inline(always)]
    fn pack(row: usize, _: usize, _: f32, weight: impl Fn(usize) -> f32) -> f32 {
        weight(row)
    }

    #[inline(always)]
    unsafe fn splat<S: Simd>(simd: S, from: *const f32) -> S::Vector {
        simd.splat(unsafe { *from })
    }

    #[inline(always)]
    fn multiply<S: Simd>(simd: S, x: S::Vector, w: S::Vector, sums: S::Vector) -> S::Vector {
        simd.fma(x, w, sums)
    }
}

impl Operand for Bf16 {
    type Weight = u32;
    type Sum = f32;
    type Factor<S: Simd> = S::Bits;
    type Total<S: Simd> = S::Vector;
    const STEP: usize = 2;

    #[inline(always)]
    fn pack(row: usize, cin: usize, _: f32, weight: impl Fn(usize) -> f32) -> u32 {
        pair(row, cin, |channel| Bf16::from_f32(weight(channel)).0)
    }

    #[inline(always)]
    unsafe fn splat<S: Simd>(simd: S, from: *const Bf16) -> S::Bits {
        simd.splat_bits(unsafe { from.cast::<u32>().read_unaligned() })
    }

    #[inline(always)]
    fn multiply<S: Simd>(simd: S, x: S::Bits, w: S::Bits, sums: S::Vector) -> S::Vector {
        simd.dot_pairs(x, w, sums)
    }
}

/// The largest weight in i8; -128 is left out, so that the range is symmetric.
const LARGEST: f32 = 127.0;
/// The sum of this many products of an input (at most 255) and a weight fits an i32.
const INPUTS_MAX: usize = i32::MAX as usize / (255 * 127);

/// Weights are i8; the largest of an output channel is 127. The last row of a tap is 128 times each column's sum, for [`Simd::SIGNED_BYTES`].
impl Operand for u8 {
    type Weight = u32;
    type Sum = i32;
    type Factor<S: Simd> = S::Bits;
    type Total<S: Simd> = S::Bits;
    const STEP: usize = 4;
    const NEEDS_SPARE: bool = true;

    /// The scale of a channel is 0 when all its weights are 0.
    fn scales([taps, cin, cout]: [usize; 3], weight: impl Fn([usize; 3]) -> f32) -> Vec<f32> {
        assert!(taps * cin <= INPUTS_MAX, "{taps} x {cin} inputs of a value");
        let mut largest = vec![0.0_f32; cout];
        for row in 0..taps * cin {
            for (o, largest) in largest.iter_mut().enumerate() {
                *largest = largest.max(weight([row / cin, row % cin, o]).abs());
            }
        }
        largest.iter().map(|largest| largest / LARGEST).collect()
    }

    #[inline(always)]
    fn tap_rows(cin: usize) -> usize {
        cin.div_ceil(4) + 1
    }

    fn rounded(weight: f32, scale: f32) -> f32 {
        if scale > 0.0 { (weight / scale).round_ties_even() } else { 0.0 }
    }

    fn pack(row: usize, cin: usize, scale: f32, weight: impl Fn(usize) -> f32) -> u32 {
        let rounded = |channel: usize| match channel {
            channel if channel < cin => u8::rounded(weight(channel), scale) as i8,
            _ => 0,
        };
        if row == cin.div_ceil(4) {
            let sum: i32 = (0..cin).map(|channel| i32::from(rounded(channel))).sum();
            return (128 * sum) as u32;
        }
        u32::from_ne_bytes([0, 1, 2, 3].map(|i| rounded(4 * row + i) as u8))
    }

    #[inline(always)]
    unsafe fn splat<S: Simd>(simd: S, from: *const u8) -> S::Bits {
        let quad = unsafe { from.cast::<u32>().read_unaligned() };
        // Inverting the upper bit subtracts 128 from a byte.
        let turned = if S::SIGNED_BYTES { 0x8080_8080 } else { 0 };
        simd.splat_bits(quad ^ turned)
    }

    #[inline(always)]
    fn multiply<S: Simd>(simd: S, x: S::Bits, w: S::Bits, sums: S::Bits) -> S::Bits {
        simd.dot_quads(x, w, sums)
    }

    #[inline(always)]
    unsafe fn end_tap<S: Simd, const R: usize, const V: usize>(
        simd: S,
        weights: *const u32,
        totals: &mut [[S::Bits; V]; R],
    ) {
        if S::SIGNED_BYTES {
            for v in 0..V {
                let lacking = unsafe { load(weights.add(v * S::LANES)) };
                for r in 0..R {
                    totals[r][v] = simd.add_bits(totals[r][v], lacking);
                }
            }
        }
    }
}

/// Values of 0 to 255 with the same sums and weights as u8, but in i16: faster on a processor without products of bytes.
impl Operand for i16 {
    type Weight = u32;
    type Sum = i32;
    type Factor<S: Simd> = S::Bits;
    type Total<S: Simd> = S::Bits;
    const STEP: usize = 2;

    fn scales(shape: [usize; 3], weight: impl Fn([usize; 3]) -> f32) -> Vec<f32> {
        u8::scales(shape, weight)
    }

    fn rounded(weight: f32, scale: f32) -> f32 {
        u8::rounded(weight, scale)
    }

    fn pack(row: usize, cin: usize, scale: f32, weight: impl Fn(usize) -> f32) -> u32 {
        pair(row, cin, |channel| i16::rounded(weight(channel), scale) as i16 as u16)
    }

    #[inline(always)]
    unsafe fn splat<S: Simd>(simd: S, from: *const i16) -> S::Bits {
        simd.splat_bits(unsafe { from.cast::<u32>().read_unaligned() })
    }

    #[inline(always)]
    fn multiply<S: Simd>(simd: S, x: S::Bits, w: S::Bits, sums: S::Bits) -> S::Bits {
        simd.dot_shorts(x, w, sums)
    }
}

/// The bits of channels `2 * row` and `2 * row + 1`; 0 from `cin` on.
fn pair(row: usize, cin: usize, bits: impl Fn(usize) -> u16) -> u32 {
    let bits = |channel| if channel < cin { bits(channel) } else { 0 };
    u32::from(bits(2 * row)) | u32::from(bits(2 * row + 1)) << 16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bf16_rounds_to_the_nearest_even_and_every_value_comes_back() {
        let one = 0x3f80_0000;
        for (bits, expected) in [
            (one, 0x3f80),
            (one + 0x7fff, 0x3f80),
            (one + 0x8000, 0x3f80),
            (one + 0x8001, 0x3f81),
            (one + 0x1_8000, 0x3f82),
            (0x7f7f_ffff, 0x7f80),
            (0xff80_0000, 0xff80),
            (0x8000_0000, 0x8000),
        ] {
            let found = Bf16::from_f32(f32::from_bits(bits));
            assert_eq!(found, Bf16(expected), "{bits:x}");
        }
        let found = Bf16::from_f32(f32::from_bits(0x7f80_0001));
        assert!(found.to_f32().is_nan());
        for bits in 0..=u16::MAX {
            let value = Bf16(bits).to_f32();
            assert!(value.is_nan() || Bf16::from_f32(value) == Bf16(bits), "{bits:x}");
        }
    }

    #[test]
    fn bytes_round_and_stay_in_their_range() {
        for (value, expected) in [
            (0.5, 0),
            (0.51, 1),
            (1.5, 2),
            (2.5, 2),
            (254.4, 254),
            (254.6, 255),
            (1e9, 255),
            (f32::INFINITY, 255),
            (-0.6, 0),
            (f32::NEG_INFINITY, 0),
            (f32::NAN, 0),
        ] {
            assert_eq!(<u8 as Element>::from_f32(value), expected, "{value}");
        }
        assert!((0..=255).all(|byte: u8| <u8 as Element>::from_f32(byte.to_f32()) == byte));
    }
}
