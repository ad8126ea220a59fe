//! The inner loops: a tile of sums (rows x output channels) stays in registers.
//!
//! The loops iterate over the pairs of a tap, one for each output row that has an input row there (the gradient over copies of
//! these rows), so absent rows cost nothing. Every sum adds its products in one order (taps, then input channels; for the gradient
//! rows), independent of its tile's shape: the bits depend neither on the shapes nor on the threads.

use super::{
    Kernel, LINE, Lists, Operand, Rows, Simd,
    cover::{Tile, cover},
    list::Listed,
    load,
    operand::{multiply, step},
    store,
};
use crate::weights::{Panel, Weights};

/// `sums[pair.row] += input[pair.input] * weights of the tap`, for each listed pair; sums in i32 modulo 2^32.
///
/// `input`: rows of `cin`. `weights`: `[I::tap_rows(cin)][width]` for each listed tap. `sums`: rows of `width`. No two pairs of a tap have the same row.
#[inline(always)]
fn convolve_tiles<I: Operand, S: Simd>(
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
    // SAFETY: the table has a row for each pair and `width` columns; `check` has verified that every pair points to a whole
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
        // SAFETY: `convolve_tiles` has checked the pairs and the lengths; the caller gives rows and columns inside the table.
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
                // After the last tap the pointer may lie beyond the weights; nothing is read there.
                weights = weights.wrapping_add(I::tap_rows(self.cin) * self.width);
            }
            store_tile::<I, S, R, V>(sums, totals);
        }
    }
}

/// The products of a block and a panel.
pub struct Products<'a, 'b, I: Operand> {
    pub(crate) input: &'a [I],
    pub(crate) weights: &'a Weights<I>,
    pub(crate) panel: Panel,
    pub(crate) lists: &'a mut Lists<'b>,
    pub(crate) sums: &'a mut [I::Sum],
}

impl<I: Operand> Kernel for Products<'_, '_, I> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let (weights, panel) = (self.weights, self.panel);
        let (taps, cin, width) = (weights.taps, weights.cin, panel.width);
        let size = I::tap_rows(cin) * width;
        let mut tap = 0;
        while tap < taps && cin > 0 {
            let listed = self.lists.at_taps_from(simd, tap);
            let next = tap + listed.taps();
            let weights = &weights.panel(panel)[tap * size..next * size];
            convolve_tiles(simd, self.input, cin, listed, weights, width, self.sums);
            tap = next;
        }
    }
}

/// `gradient[i] += inputs[p][i] * outputs[p]`, summed over the listed pairs `p`, for each input channel `i`.
///
/// `gradient`: a row as wide as `outputs` for each input channel, `stride` values apart.
#[inline(always)]
pub(crate) fn gradient_tiles<I: Operand<Sum = f32>, S: Simd>(
    simd: S,
    inputs: &Rows<I>,
    outputs: &Rows<I>,
    gradient: &mut [f32],
    stride: usize,
) {
    let (cin, width) = (inputs.channels, outputs.width());
    assert_eq!(inputs.steps, outputs.steps, "steps of inputs and outputs");
    assert!(width <= stride && gradient.len() >= (cin - 1) * stride + width);
    let tile = Gradient { inputs, outputs, gradient: gradient.as_mut_ptr(), stride };
    // SAFETY: the table has a row for each input channel and `width` columns; `inputs` and `outputs` contain all values of
    // their steps, and `gradient` contains `cin` rows of `width` at `stride`.
    unsafe { cover(simd, cin, width, &tile) }
}

struct Gradient<'a, I: Operand> {
    inputs: &'a Rows<I>,
    outputs: &'a Rows<I>,
    gradient: *mut f32,
    stride: usize,
}

impl<I: Operand<Sum = f32>> Tile for Gradient<'_, I> {
    #[inline(always)]
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(&self, simd: S, at: [usize; 2]) {
        let [row, column] = at;
        // SAFETY: `gradient_tiles` has checked the lengths; the caller gives rows (input channels) and columns inside the table.
        unsafe {
            let mut sums = [self.gradient; R];
            for r in 0..R {
                sums[r] = self.gradient.add((row + r) * self.stride + column);
            }
            let mut totals = load_tile::<I, S, R, V>(sums);
            for k in 0..self.outputs.steps {
                let input = self.inputs.as_ptr().add(k * self.inputs.width() + row);
                let output = self.outputs.as_ptr().add(k * self.outputs.width() + column);
                step(simd, |r| input.add(r).cast::<I>(), output, &mut totals);
            }
            store_tile::<I, S, R, V>(sums, totals);
        }
    }
}

/// Loads the sums of a tile.
///
/// # Safety
/// Each of `rows` is valid for reads of V registers.
#[inline(always)]
unsafe fn load_tile<I: Operand, S: Simd, const R: usize, const V: usize>(
    rows: [*mut I::Sum; R],
) -> [[I::Total<S>; V]; R] {
    // SAFETY: the caller guarantees the rows.
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

/// Stores the sums of a tile; the inverse of [`load_tile`].
///
/// # Safety
/// Each of `rows` is valid for writes of V registers.
#[inline(always)]
pub(super) unsafe fn store_tile<I: Operand, S: Simd, const R: usize, const V: usize>(
    rows: [*mut I::Sum; R],
    totals: [[I::Total<S>; V]; R],
) {
    // SAFETY: the caller guarantees the rows.
    unsafe {
        for r in 0..R {
            for v in 0..V {
                store(rows[r].add(v * S::LANES), totals[r][v]);
            }
        }
    }
}
