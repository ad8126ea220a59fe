//! The forward inner loop: a tile of sums (rows x output channels) held in registers.

use super::{
    LINE, Listed, Pair, Simd,
    cover::{Tile, cover},
};

/// `sums[pair.row] += input[pair.input] * weights`, for each listed pair.
///
/// `input`: rows of `cin`. `weights`: `[cin][width]`. `sums`: rows of `width`. No two pairs
/// of a call have the same row.
#[inline(always)]
pub(crate) fn convolve_tiles<S: Simd>(
    simd: S,
    input: &[f32],
    cin: usize,
    listed: Listed,
    weights: &[f32],
    width: usize,
    sums: &mut [f32],
) {
    assert!(width.is_multiple_of(LINE), "rows of {width}");
    listed.check(input.len() / cin, sums.len() / width);
    assert_eq!(weights.len(), cin * width);
    let tile = Convolve {
        input: input.as_ptr(),
        cin,
        pairs: listed.pairs,
        weights: weights.as_ptr(),
        width,
        sums: sums.as_mut_ptr(),
    };
    // SAFETY: the table has a row for each pair and `width` columns; `check` has seen that every pair points to a whole
    // row inside `input` and inside `sums`, and `weights` has `cin` rows of `width`.
    unsafe { cover(simd, listed.pairs.len(), width, &tile) }
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
