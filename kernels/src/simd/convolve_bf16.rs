//! The forward inner loop on bf16: as in f32, two input channels a step, sums in f32.

use super::{
    LINE, Listed, Simd,
    cover::{Tile, cover},
};
use crate::Bf16;

/// `sums[pair.row] += input[pair.input] * weights of the tap`, for each listed pair.
///
/// `input`: rows of `cin`, which is even. `weights`: `[cin / 2][width]` pairs for each listed tap. `sums`: rows of `width`. No two pairs of a
/// call have the same row.
#[inline(always)]
pub(crate) fn convolve_tiles_bf16<S: Simd>(
    simd: S,
    input: &[Bf16],
    cin: usize,
    listed: Listed,
    weights: &[u32],
    width: usize,
    sums: &mut [f32],
) {
    assert!(width.is_multiple_of(LINE), "rows of {width}");
    listed.check(input.len() / cin, sums.len() / width);
    assert_eq!(weights.len(), listed.taps() * (cin / 2) * width);
    let tile = Convolve {
        input: input.as_ptr(),
        cin,
        listed,
        weights: weights.as_ptr(),
        width,
        sums: sums.as_mut_ptr(),
    };
    // SAFETY: the table has a row for each pair and `width` columns; `check` has seen that every pair points to a whole
    // row inside `input` and inside `sums`, and `weights` has `cin / 2` rows of `width` for each tap.
    unsafe { cover(simd, listed.pairs().len(), width, &tile) }
}

struct Convolve<'a> {
    input: *const Bf16,
    cin: usize,
    listed: Listed<'a>,
    weights: *const u32,
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
        // SAFETY: `convolve_tiles_bf16` has checked the pairs and the lengths, the caller gives rows and columns inside;
        // a pair of bf16 is read as one u32 (Bf16 is a transparent u16), unaligned.
        unsafe {
            let mut inputs = [self.input.cast::<u32>(); R];
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
                    let input = (*pairs.add(r)).input as usize;
                    inputs[r] = self.input.add(input * self.cin).cast();
                }
                for c in 0..self.cin / 2 {
                    let mut w = [simd.splat_pair(0); V];
                    for v in 0..V {
                        w[v] = simd.load_pairs(weights.add(v * S::LANES));
                    }
                    for r in 0..R {
                        let pair = inputs[r].add(c).read_unaligned();
                        let big_endian = cfg!(target_endian = "big");
                        let x = simd.splat_pair(if big_endian {
                            pair.rotate_left(16)
                        } else {
                            pair
                        });
                        for v in 0..V {
                            totals[r][v] = simd.dot(x, w[v], totals[r][v]);
                        }
                    }
                    weights = weights.add(self.width);
                }
            }
            for r in 0..R {
                for v in 0..V {
                    simd.store(sums[r].add(v * S::LANES), totals[r][v]);
                }
            }
        }
    }
}
