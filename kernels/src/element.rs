//! The types of a row's values: f32; bf16 with half the memory and twice the products per cycle; u8 with a quarter of the memory
//! and four times the products per cycle; i16 with the values of u8, where the processor has no products of bytes.

use crate::simd::Operand;

/// A bfloat16: the upper half of an f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct Bf16(pub u16);

/// A value of a row: [`f32`], [`Bf16`], [`u8`] (a multiple of a unit that the caller knows), or [`i16`] (the same values as [`u8`]).
pub trait Element: Copy + Default + Send + Sync + Operand + Into<f32> {
    /// Converts a sum in f32 to this type.
    fn from_f32(value: f32) -> Self;

    /// The same value as f32.
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self.into()
    }
}

impl Element for f32 {
    #[inline(always)]
    fn from_f32(value: f32) -> f32 {
        value
    }
}

impl Element for Bf16 {
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
    /// Rounds as [`u8`] does.
    #[inline(always)]
    fn from_f32(value: f32) -> i16 {
        i16::from(<u8 as Element>::from_f32(value))
    }
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
