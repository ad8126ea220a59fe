//! The format of 16 bits.

/// A bfloat16: the upper half of an f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct Bf16(pub u16);

impl Bf16 {
    /// Rounds to the nearest, ties to even; NaN stays NaN, and what is beyond the largest bf16 becomes infinite.
    #[inline(always)]
    pub fn from_f32(value: f32) -> Bf16 {
        let bits = value.to_bits();
        let rounded = bits.wrapping_add(0x7fff + ((bits >> 16) & 1)) >> 16;
        let quiet = (bits >> 16) | 0x40;
        Bf16(if value.is_nan() { quiet } else { rounded } as u16)
    }

    /// The same value as f32.
    #[inline(always)]
    pub fn to_f32(self) -> f32 {
        f32::from_bits(u32::from(self.0) << 16)
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
            let same = value.is_nan() || Bf16::from_f32(value) == Bf16(bits);
            assert!(same, "{bits:x}");
        }
    }
}
