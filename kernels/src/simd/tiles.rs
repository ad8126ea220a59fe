//! The inner loops: a tile of sums (rows x output channels) held in registers.
//!
//! They go through lists of pairs, one for each output row that has an input row at the tap in question, so absent rows
//! cost nothing. Every sum adds its products in one order (taps, then input channels; rows for the gradient), whatever
//! the shape of its tile: the bits depend neither on the shapes nor on the threads.

use super::{
    LINE, Operand, Simd,
    cover::{Tile, cover},
    list::{Listed, Pair},
    load,
    operand::{multiply, step},
    store,
};

/// `sums[pair.row] += input[pair.input] * weights of the tap`, for each listed pair; sums in i32 modulo 2^32.
///
/// `input`: rows of `cin`. `weights`: `[I::tap_rows(cin)][width]` for each listed tap. `sums`: rows of `width`. No two pairs of a tap have the same row.
#[inline(always)]
pub(crate) fn convolve_tiles<I: Operand, S: Simd>(
    simd: S,
    input: &[I],
    cin: usize,
    listed: Listed,
    weights: &[I::Weight],
    width: usize,
    sums: &mut [I::Sum],
) {
    assert!(width.is_multiple_of(LINE), "rows of {width}");
    listed.check(input.len() / cin, sums.len() / width);
    assert_eq!(weights.len(), listed.taps() * I::tap_rows(cin) * width);
    let tile = Convolve {
        input: input.as_ptr(),
        cin,
        listed,
        weights: weights.as_ptr(),
        width,
        sums: sums.as_mut_ptr(),
    };
    // SAFETY: the table has a row for each pair and `width` columns; `check` has seen that every pair points to a whole
    // row inside `input` and inside `sums`, and `weights` has its rows of `width` for each tap.
    unsafe { cover(simd, listed.pairs().len(), width, &tile) }
}

struct Convolve<'a, I: Operand> {
    input: *const I,
    cin: usize,
    listed: Listed<'a>,
    weights: *const I::Weight,
    width: usize,
    sums: *mut I::Sum,
}

impl<I: Operand> Tile for Convolve<'_, I> {
    const NEEDS_SPARE: bool = I::NEEDS_SPARE;

    #[inline(always)]
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(&self, simd: S, at: [usize; 2]) {
        let [row, column] = at;
        // SAFETY: `convolve_tiles` has checked the pairs and the lengths, the caller gives rows and columns inside.
        unsafe {
            let mut inputs = [self.input; R];
            let mut sums = [self.sums; R];
            for r in 0..R {
                let pair = self.listed.first.add(row + r).read();
                sums[r] = self.sums.add(pair.row as usize * self.width + column);
            }
            let mut totals = load_tile::<I, S, R, V>(sums);
            let mut weights = self.weights.add(column);
            for tap in 0..self.listed.taps() {
                let pairs = self.listed.first.add(tap * Listed::TAP_STRIDE + row);
                for r in 0..R {
                    inputs[r] = self.input.add((*pairs.add(r)).input as usize * self.cin);
                }
                multiply(simd, inputs, self.cin, weights, self.width, &mut totals);
                weights = weights.add(I::tap_rows(self.cin) * self.width);
            }
            store_tile::<I, S, R, V>(sums, totals);
        }
    }
}

/// `gradient[i] += input[pair.input][i] * output_gradient[pair.row]`, summed over the pairs, for each input channel `i`.
///
/// `input`: rows of `cin`. `output_gradient`: rows of `width`. `gradient`: `cin` rows of `width`, `stride` values apart.
#[inline(always)]
pub(crate) fn gradient_tiles<S: Simd>(
    simd: S,
    input: &[f32],
    cin: usize,
    listed: Listed,
    output_gradient: &[f32],
    width: usize,
    gradient: &mut [f32],
    stride: usize,
) {
    assert!(width.is_multiple_of(LINE), "rows of {width}");
    listed.check(input.len() / cin, output_gradient.len() / width);
    assert!(width <= stride && gradient.len() >= (cin - 1) * stride + width);
    let tile = Gradient {
        input: input.as_ptr(),
        cin,
        pairs: listed.pairs(),
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
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(&self, simd: S, at: [usize; 2]) {
        let [row, column] = at;
        // SAFETY: `gradient_tiles` has checked the pairs and the lengths, the caller gives rows (input channels) and columns inside.
        unsafe {
            let mut sums = [self.gradient; R];
            for r in 0..R {
                sums[r] = self.gradient.add((row + r) * self.stride + column);
            }
            let mut totals = load_tile::<f32, S, R, V>(sums);
            for pair in self.pairs {
                let input = self.input.add(pair.input as usize * self.cin + row);
                let from = pair.row as usize * self.width + column;
                let input = |r: usize| input.add(r);
                step(simd, input, self.output_gradient.add(from), &mut totals);
            }
            store_tile::<f32, S, R, V>(sums, totals);
        }
    }
}

/// The sums of a tile.
///
/// # Safety
/// Each of `rows` is valid for reads of V registers.
#[inline(always)]
unsafe fn load_tile<I: Operand, S: Simd, const R: usize, const V: usize>(
    rows: [*mut I::Sum; R],
) -> [[I::Total<S>; V]; R] {
    // SAFETY: the caller vouches for the rows.
    unsafe {
        let mut totals = [[load(rows[0]); V]; R];
        for r in 0..R {
            for v in 0..V {
                totals[r][v] = load(rows[r].add(v * S::LANES));
            }
        }
        totals
    }
}

/// [`load_tile`] back.
///
/// # Safety
/// Each of `rows` is valid for writes of V registers.
#[inline(always)]
pub(super) unsafe fn store_tile<I: Operand, S: Simd, const R: usize, const V: usize>(
    rows: [*mut I::Sum; R],
    totals: [[I::Total<S>; V]; R],
) {
    // SAFETY: the caller vouches for the rows.
    unsafe {
        for r in 0..R {
            for v in 0..V {
                store(rows[r].add(v * S::LANES), totals[r][v]);
            }
        }
    }
}
