//! The operands of a convolution: f32, pairs of bf16 or of i16, quads of bytes; and the packing of weights.

use super::{Level, Simd, load};
use crate::{Bf16, Element, convolve::Products};
use std::fmt::Debug;

/// A value of an input row. One product takes [`Operand::STEP`] values at once.
pub trait Operand: Copy + Default {
    /// Adds the products of a block to its sums.
    fn accumulate(level: Level, products: Products<Self>);

    /// Packed weights of a step.
    type Weight: Copy + Default + Debug + PartialEq + Send + Sync;
    /// The type in which products are added.
    type Sum: Sum;
    /// A register of inputs or of weights.
    type Factor<S: Simd>: Copy;
    /// A register of sums.
    type Total<S: Simd>: Copy;
    /// Input channels of a step.
    const STEP: usize;
    /// Whether a product needs a few registers besides its operands on a processor without an instruction for it.
    const NEEDS_SPARE: bool = false;

    /// The value of a packed weight of 1 in each output channel. Arguments: taps, input and output channels; the weight at each of them.
    ///
    /// # Panics
    /// When the sums over so many channels could overflow.
    fn scales([_, _, cout]: [usize; 3], _: impl Fn([usize; 3]) -> f32) -> Vec<f32> {
        vec![1.0; cout]
    }

    /// A weight as it is packed, in units of its output channel's scale.
    fn rounded(weight: f32, _scale: f32) -> f32 {
        weight
    }

    /// Number of rows of packed weights per tap.
    #[inline(always)]
    fn tap_rows(cin: usize) -> usize {
        cin.div_ceil(Self::STEP)
    }

    /// Packs row `row` of a tap for an output channel of this scale. `weight`: the weight of an input channel below `cin`.
    fn pack(row: usize, cin: usize, scale: f32, weight: impl Fn(usize) -> f32) -> Self::Weight;

    /// The channels of one step, repeated in all lanes.
    ///
    /// # Safety
    /// `from` is valid for reads of a step's channels.
    unsafe fn splat<S: Simd>(simd: S, from: *const Self) -> Self::Factor<S>;

    /// `inputs * weights + sums`.
    fn multiply<S: Simd>(
        simd: S,
        inputs: Self::Factor<S>,
        weights: Self::Factor<S>,
        sums: Self::Total<S>,
    ) -> Self::Total<S>;

    /// Adds the rows of a tap that belong to no step. `weights`: the tap's rows after the rows of the steps.
    ///
    /// # Safety
    /// `weights` is valid for reads of the rows that [`Operand::tap_rows`] counts beyond the steps, each of `V` registers.
    #[inline(always)]
    unsafe fn end_tap<S: Simd, const R: usize, const V: usize>(
        _: S,
        _weights: *const Self::Weight,
        _: &mut [[Self::Total<S>; V]; R],
    ) {
    }
}

/// The type in which products are added.
pub trait Sum: Copy + Default {
    /// The initial value of a sum in a channel with this bias.
    fn begin(bias: f32) -> Self;

    /// The output value of a sum in a channel with this scale and bias.
    fn finish(self, scale: f32, bias: f32) -> f32;
}

impl Sum for f32 {
    #[inline(always)]
    fn begin(bias: f32) -> f32 {
        bias
    }

    #[inline(always)]
    fn finish(self, _: f32, _: f32) -> f32 {
        self
    }
}

impl Sum for i32 {
    #[inline(always)]
    fn begin(_: f32) -> i32 {
        0
    }

    /// Sums are exact. Only this function rounds: once the product with the scale, once the sum with the bias.
    #[inline(always)]
    fn finish(self, scale: f32, bias: f32) -> f32 {
        self as f32 * scale + bias
    }
}

// SAFETY (all below): the caller guarantees the pointers.
impl Operand for f32 {
    compiled_here!(accumulate(Products));
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
    compiled_here!(accumulate(Products));
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
    compiled_here!(accumulate(Products));
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
    compiled_here!(accumulate(Products));
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

/// `totals += inputs * weights`: rows of `cin` times the packed rows of a tap, of which V registers are used.
///
/// # Safety
/// Each of `inputs` is valid for reads of `cin` values, and each of the tap's rows from `weights` on, `width` apart, for reads of V registers.
#[inline(always)]
pub(super) unsafe fn multiply<I: Operand, S: Simd, const R: usize, const V: usize>(
    simd: S,
    inputs: [*const I; R],
    cin: usize,
    mut weights: *const I::Weight,
    width: usize,
    totals: &mut [[I::Total<S>; V]; R],
) {
    // SAFETY: the caller guarantees both.
    unsafe {
        for c in 0..cin / I::STEP {
            step(simd, |r| inputs[r].add(c * I::STEP), weights, totals);
            // After the last row the pointer may lie beyond the weights; nothing is read there.
            weights = weights.wrapping_add(width);
        }
        let rest = cin % I::STEP;
        if rest > 0 {
            let mut last = [[I::default(); 4]; R];
            for r in 0..R {
                for c in 0..rest {
                    last[r][c] = *inputs[r].add(cin - rest + c);
                }
            }
            step(simd, |r| last[r].as_ptr(), weights, totals);
            weights = weights.wrapping_add(width);
        }
        I::end_tap(simd, weights, totals);
    }
}

/// Multiplies one step of input channels. `input(r)`: the channels of row `r`.
///
/// # Safety
/// `input(r)` for `r` below R is valid for reads of a step, `weights` for reads of V registers.
#[inline(always)]
pub(super) unsafe fn step<I: Operand, S: Simd, const R: usize, const V: usize>(
    simd: S,
    input: impl Fn(usize) -> *const I,
    weights: *const I::Weight,
    totals: &mut [[I::Total<S>; V]; R],
) {
    // SAFETY: the caller guarantees both.
    unsafe {
        let mut w: [I::Factor<S>; V] = [load(weights); V];
        for v in 1..V {
            w[v] = load(weights.add(v * S::LANES));
        }
        for r in 0..R {
            let x = I::splat(simd, input(r));
            for v in 0..V {
                totals[r][v] = I::multiply(simd, x, w[v], totals[r][v]);
            }
        }
    }
}
