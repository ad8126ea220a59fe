//! The forward inner loop on bytes: u8 inputs, i8 weights, four input channels a step, exact sums in i32.

use super::{
    LINE, Listed, Simd,
    cover::{Tile, cover},
};

/// `sums[pair.row] += input[pair.input] * weights of the tap`, for each listed pair, modulo 2^32.
///
/// `input`: rows of `cin`. `weights`, for each listed tap: `[cin / 4, rounded up][width]` quads of i8, zero beyond `cin`; then a row of 128
/// times the sum of each column (see [`Simd::SIGNED_QUADS`]). `sums`: rows of `width`. No two pairs of a call have the
/// same row.
#[inline(always)]
pub(crate) fn convolve_tiles_int8<S: Simd>(
    simd: S,
    input: &[u8],
    cin: usize,
    listed: Listed,
    weights: &[u32],
    width: usize,
    sums: &mut [i32],
) {
    assert!(width.is_multiple_of(LINE), "rows of {width}");
    listed.check(input.len() / cin, sums.len() / width);
    assert_eq!(weights.len(), listed.taps() * (cin.div_ceil(4) + 1) * width);
    let tile = Convolve {
        input: input.as_ptr(),
        cin,
        listed,
        weights: weights.as_ptr(),
        width,
        sums: sums.as_mut_ptr(),
    };
    // SAFETY: the table has a row for each pair and `width` columns; `check` has seen that every pair points to a whole
    // row inside `input` and inside `sums`, and `weights` has a row of `width` for each four channels and one more, for
    // each tap.
    unsafe { cover(simd, listed.pairs().len(), width, &tile) }
}

struct Convolve<'a> {
    input: *const u8,
    cin: usize,
    listed: Listed<'a>,
    weights: *const u32,
    width: usize,
    sums: *mut i32,
}

impl Tile for Convolve<'_> {
    const NEEDS_SPARE: bool = true;

    #[inline(always)]
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(
        &self,
        simd: S,
        row: usize,
        column: usize,
    ) {
        // SAFETY: `convolve_tiles_int8` has checked the pairs and the lengths, the caller gives rows and columns inside;
        // four bytes are read as one u32, unaligned, and the last ones of a row by themselves where they are fewer.
        unsafe {
            let mut weights = self.weights.add(column);
            let mut inputs = [self.input; R];
            let mut sums = [self.sums; R];
            let zero = simd.load_integers([0; 16].as_ptr());
            let mut totals = [[zero; V]; R];
            for r in 0..R {
                let pair = self.listed.first().add(row + r).read();
                sums[r] = self.sums.add(pair.row as usize * self.width + column);
                for v in 0..V {
                    totals[r][v] = simd.load_integers(sums[r].add(v * S::LANES));
                }
            }
            for tap in 0..self.listed.taps() {
                let pairs = self.listed.first().add(tap * Listed::TAP_STRIDE + row);
                for r in 0..R {
                    inputs[r] = self.input.add((*pairs.add(r)).input as usize * self.cin);
                }
                for c in 0..self.cin / 4 {
                    let quad = |r: usize| inputs[r].cast::<u32>().add(c).read_unaligned();
                    step(simd, weights, quad, &mut totals);
                    weights = weights.add(self.width);
                }
                let rest = self.cin % 4;
                if rest > 0 {
                    let quad = |r: usize| {
                        let mut bytes = [0; 4];
                        let from = inputs[r].add(self.cin - rest);
                        (0..rest).for_each(|c| bytes[c] = *from.add(c));
                        u32::from_ne_bytes(bytes)
                    };
                    step(simd, weights, quad, &mut totals);
                    weights = weights.add(self.width);
                }
                if S::SIGNED_QUADS {
                    for v in 0..V {
                        let lacking = simd.load_integers(weights.add(v * S::LANES).cast());
                        for r in 0..R {
                            totals[r][v] = simd.add_integers(totals[r][v], lacking);
                        }
                    }
                }
                weights = weights.add(self.width);
            }
            for r in 0..R {
                for v in 0..V {
                    simd.store_integers(sums[r].add(v * S::LANES), totals[r][v]);
                }
            }
        }
    }
}

/// Four input channels of each row.
///
/// # Safety
/// `weights` is valid for reads of `V` registers.
#[inline(always)]
unsafe fn step<S: Simd, const R: usize, const V: usize>(
    simd: S,
    weights: *const u32,
    quad: impl Fn(usize) -> u32,
    totals: &mut [[S::Integers; V]; R],
) {
    // SAFETY: the caller vouches for `weights`.
    unsafe {
        let mut w = [simd.splat_quad(0); V];
        for v in 0..V {
            w[v] = simd.load_quads(weights.add(v * S::LANES));
        }
        for r in 0..R {
            let x = simd.splat_quad(quad(r));
            for v in 0..V {
                totals[r][v] = simd.dot_quads(x, w[v], totals[r][v]);
            }
        }
    }
}
