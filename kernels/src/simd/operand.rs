//! What a convolution needs of the values of an input row: packed weights, registers and products.

use super::{Simd, load};
use std::fmt::Debug;

/// A value of an input row. One product takes [`Operand::STEP`] values at once.
pub trait Operand: Copy + Default {
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
