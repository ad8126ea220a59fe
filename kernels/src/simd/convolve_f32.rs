//! The forward inner loop: a tile of sums (rows x output channels) held in registers.

use super::{
    LINE, Listed, Simd,
    cover::{Tile, cover},
};

/// `sums[pair.row] += input[pair.input] * weights of the tap`, for each listed pair.
///
/// `input`: rows of `cin`. `weights`: `[cin][width]` for each listed tap. `sums`: rows of `width`. No two pairs
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
    assert_eq!(weights.len(), listed.taps() * cin * width);
    let tile = Convolve {
        input: input.as_ptr(),
        cin,
        listed,
        weights: weights.as_ptr(),
        width,
        sums: sums.as_mut_ptr(),
    };
    // SAFETY: the table has a row for each pair and `width` columns; `check` has seen that every pair points to a whole
    // row inside `input` and inside `sums`, and `weights` has `cin` rows of `width` for each tap.
    unsafe { cover(simd, listed.pairs().len(), width, &tile) }
}

struct Convolve<'a> {
    input: *const f32,
    cin: usize,
    listed: Listed<'a>,
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
                let pair = self.listed.first().add(row + r).read();
                sums[r] = self.sums.add(pair.row as usize * self.width + column);
                for v in 0..V {
                    totals[r][v] = simd.load(sums[r].add(v * S::LANES));
                }
            }
            let mut weights = self.weights.add(column);
            for tap in 0..self.listed.taps() {
                let pairs = self.listed.first().add(tap * Listed::TAP_STRIDE + row);
                for r in 0..R {
                    inputs[r] = self.input.add((*pairs.add(r)).input as usize * self.cin);
                }
                multiply(simd, inputs, self.cin, weights, self.width, &mut totals);
                weights = weights.add(self.cin * self.width);
            }
            for r in 0..R {
                for v in 0..V {
                    simd.store(sums[r].add(v * S::LANES), totals[r][v]);
                }
            }
        }
    }
}

/// `totals += inputs * weights`: rows of `cin` times `cin` rows of a matrix, of which V registers are used.
///
/// # Safety
/// Each of `inputs` is valid for reads of `cin` values, and each of `cin` rows from `weights` on, `width` apart, for
/// reads of V registers.
#[inline(always)]
pub(super) unsafe fn multiply<S: Simd, const R: usize, const V: usize>(
    simd: S,
    inputs: [*const f32; R],
    cin: usize,
    mut weights: *const f32,
    width: usize,
    totals: &mut [[S::Vector; V]; R],
) {
    // SAFETY: the caller vouches for both.
    unsafe {
        for c in 0..cin {
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
            weights = weights.add(width);
        }
    }
}
