//! What a row may hold: f32; bf16 for half the memory and twice the products a cycle; u8 for a quarter and four times.

use crate::{Bf16, simd::Operand};

/// A value of a row: [`f32`], [`Bf16`], or [`u8`], which counts units that whoever reads it knows.
pub trait Element: Copy + Default + Send + Sync + Operand {
    /// From a sum in f32.
    fn from_f32(value: f32) -> Self;

    /// The same value as f32.
    fn to_f32(self) -> f32;
}

impl Element for f32 {
    #[inline(always)]
    fn from_f32(value: f32) -> f32 {
        value
    }

    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }
}

impl Element for Bf16 {
    #[inline(always)]
    fn from_f32(value: f32) -> Bf16 {
        Bf16::from_f32(value)
    }

    #[inline(always)]
    fn to_f32(self) -> f32 {
        Bf16::to_f32(self)
    }
}

impl Element for u8 {
    /// To the nearest, ties to even; 0 below 0 and for NaN, 255 above 255.
    #[inline(always)]
    fn from_f32(value: f32) -> u8 {
        let positive = if value > 0.0 { value } else { 0.0 };
        let bounded = if positive < 255.0 { positive } else { 255.0 };
        // 1.5 * 2^23: from there on the last bits of an f32 count ones.
        (bounded + 12_582_912.0).to_bits() as u8
    }

    #[inline(always)]
    fn to_f32(self) -> f32 {
        f32::from(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
