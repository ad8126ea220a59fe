//! The two inner loops: a tile of accumulators (rows x channels) held in registers.
//!
//! Both take a list of [`Pair`]s, one for each output row that has an input row at the tap in question, so absent rows
//! cost nothing. Every sum adds its products in one order (taps, then input channels; rows for the gradient), whatever
//! the shape of its tile: the bits depend neither on the shapes nor on the threads.

use super::{
    LINE, Simd,
    cover::{Tile, cover},
};

/// An input row and the row of the block that it meets at a tap.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pair {
    /// Row of the input.
    pub(crate) input: u32,
    /// Row of the block: of its sums (forward) or of its output gradients.
    pub(crate) row: u32,
}

/// Panics when a pair names a row that is not there, or a row is not whole lines.
#[inline(always)]
pub(super) fn check(pairs: &[Pair], inputs: usize, rows: usize, width: usize) {
    assert!(width.is_multiple_of(LINE), "rows of {width}");
    let (input, row) = pairs.iter().fold((0, 0), |(input, row), pair| {
        (pair.input.max(input), pair.row.max(row))
    });
    assert!(
        pairs.is_empty() || (input as usize) < inputs,
        "input row {input} of {inputs}"
    );
    assert!(
        pairs.is_empty() || (row as usize) < rows,
        "row {row} of a block of {rows}"
    );
}

/// `sums[pair.row] += input[pair.input] * weights`, for each pair.
///
/// `input`: rows of `cin`. `weights`: `[cin][width]`. `sums`: rows of `width`. No two pairs
/// of a call have the same row.
#[inline(always)]
pub(crate) fn convolve_tiles<S: Simd>(
    simd: S,
    input: &[f32],
    cin: usize,
    pairs: &[Pair],
    weights: &[f32],
    width: usize,
    sums: &mut [f32],
) {
    check(pairs, input.len() / cin, sums.len() / width, width);
    assert_eq!(weights.len(), cin * width);
    let tile = Convolve {
        input: input.as_ptr(),
        cin,
        pairs,
        weights: weights.as_ptr(),
        width,
        sums: sums.as_mut_ptr(),
    };
    // SAFETY: the table has a row for each pair and `width` columns; `check` has seen that every pair points to a whole
    // row inside `input` and inside `sums`, and `weights` has `cin` rows of `width`.
    unsafe { cover(simd, pairs.len(), width, &tile) }
}

struct Convolve<'a> {
    input: *const f32,
    cin: usize,
    pairs: &'a [Pair],
    weights: *const f32,
    width: usize,
    sums: *mut f32,
}

impl Tile for Convolve<'_> {
    #[inline(always)]
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(
        &self,
        simd: S,
        row: usize,
        column: usize,
    ) {
        // SAFETY: `convolve_tiles` has checked the pairs and the lengths, the caller gives rows and columns inside.
        unsafe {
            let mut inputs = [self.input; R];
            let mut sums = [self.sums; R];
            let mut totals = [[simd.splat(0.0); V]; R];
            for r in 0..R {
                let pair = self.pairs.get_unchecked(row + r);
                inputs[r] = self.input.add(pair.input as usize * self.cin);
                sums[r] = self.sums.add(pair.row as usize * self.width + column);
                for v in 0..V {
                    totals[r][v] = simd.load(sums[r].add(v * S::LANES));
                }
            }
            let mut weights = self.weights.add(column);
            for c in 0..self.cin {
                let mut w = [simd.splat(0.0); V];
                for v in 0..V {
                    w[v] = simd.load(weights.add(v * S::LANES));
                }
                for r in 0..R {
                    let x = simd.splat(*inputs[r].add(c));
                    for v in 0..V {
                        totals[r][v] = simd.fma(x, w[v], totals[r][v]);
                    }
                }
                weights = weights.add(self.width);
            }
            for r in 0..R {
                for v in 0..V {
                    simd.store(sums[r].add(v * S::LANES), totals[r][v]);
                }
            }
        }
    }
}

/// `gradient[i] += input[pair.input][i] * output_gradient[pair.row]`, summed over the pairs, for each input channel `i`.
///
/// `input`: rows of `cin`. `output_gradient`: rows of `width`. `gradient`: `cin` rows of
/// `width`, `stride` values apart.
#[inline(always)]
pub(crate) fn gradient_tiles<S: Simd>(
    simd: S,
    input: &[f32],
    cin: usize,
    pairs: &[Pair],
    output_gradient: &[f32],
    width: usize,
    gradient: &mut [f32],
    stride: usize,
) {
    check(
        pairs,
        input.len() / cin,
        output_gradient.len() / width,
        width,
    );
    assert!(width <= stride && gradient.len() >= (cin - 1) * stride + width);
    let tile = Gradient {
        input: input.as_ptr(),
        cin,
        pairs,
        output_gradient: output_gradient.as_ptr(),
        width,
        gradient: gradient.as_mut_ptr(),
        stride,
    };
    // SAFETY: the table has a row for each input channel and `width` columns; `check` has seen that every pair points to
    // whole rows of `input` and `output_gradient`, and `gradient` holds `cin` rows of `width` at `stride`.
    unsafe { cover(simd, cin, width, &tile) }
}

struct Gradient<'a> {
    input: *const f32,
    cin: usize,
    pairs: &'a [Pair],
    output_gradient: *const f32,
    width: usize,
    gradient: *mut f32,
    stride: usize,
}

impl Tile for Gradient<'_> {
    #[inline(always)]
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(
        &self,
        simd: S,
        row: usize,
        column: usize,
    ) {
        // SAFETY: `gradient_tiles` has checked the pairs and the lengths, the caller gives rows (input channels) and
        // columns inside.
        unsafe {
            let gradient = self.gradient.add(row * self.stride + column);
            let mut totals = [[simd.splat(0.0); V]; R];
            for r in 0..R {
                for v in 0..V {
                    totals[r][v] = simd.load(gradient.add(r * self.stride + v * S::LANES));
                }
            }
            for pair in self.pairs {
                let input = self.input.add(pair.input as usize * self.cin + row);
                let dy = self
                    .output_gradient
                    .add(pair.row as usize * self.width + column);
                let mut g = [simd.splat(0.0); V];
                for v in 0..V {
                    g[v] = simd.load(dy.add(v * S::LANES));
                }
                for r in 0..R {
                    let x = simd.splat(*input.add(r));
                    for v in 0..V {
                        totals[r][v] = simd.fma(x, g[v], totals[r][v]);
                    }
                }
            }
            for r in 0..R {
                for v in 0..V {
                    simd.store(gradient.add(r * self.stride + v * S::LANES), totals[r][v]);
                }
            }
        }
    }
}
