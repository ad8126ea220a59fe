//! The gradient of the weights.

use crate::{
    Bf16, Element, Gather,
    simd::{Aligned, BLOCK, Kernel, LINE, Level, Lists, Rows, Simd, compiled_here, gradient_tiles},
    weights::{PANEL_MAX, Panel, check, panels},
};
use rayon::prelude::*;

/// Maximum number of partial sums per call: enough to keep many cores evenly busy, few enough to add up quickly.
const PARTS_MAX: usize = 16;
/// Minimum number of row blocks per part; in a smaller part, adding up the partial sums would take most of the time.
const PART_BLOCKS_MIN: usize = 4;

/// `gradient[t][i][o] += sum over output rows r of input[gather(r, t)][i] * output_gradient[r][o]`.
///
/// `level`: the registers to use, mostly [`Level::best`]. `input`: rows of `cin`; `output_gradient`: rows of `cout`; `gradient`: `taps * cin * cout`.
///
/// Sums are f32. Runs on rayon's current thread pool. The number of rows alone decides the parts, and the parts are added in order,
/// so the bits of the result do not depend on the number of threads.
///
/// # Panics
/// When lengths or row numbers contradict each other (a broken invariant, not data).
pub fn weight_gradient<I: Trainable>(
    level: Level,
    input: &[I],
    cin: usize,
    gather: &Gather,
    output_gradient: &[I],
    cout: usize,
    gradient: &mut [f32],
) {
    let (outputs, taps) = (gather.outputs(), gather.taps);
    if outputs == 0 || cin == 0 || cout == 0 {
        return;
    }
    assert_eq!(gather.index.len(), outputs * taps, "gather rows are whole");
    let rows = output_gradient.len();
    assert_eq!(rows, outputs * cout, "{outputs} output rows of {cout}");
    check(gradient, [taps, cin, cout]);
    assert!(input.len().is_multiple_of(cin), "{} inputs in rows of {cin}", input.len());
    let part_rows = outputs.div_ceil(BLOCK).div_ceil(PARTS_MAX).max(PART_BLOCKS_MIN) * BLOCK;
    let parts: Vec<Aligned<f32>> = gather
        .index
        .par_chunks(part_rows * taps)
        .zip(output_gradient.par_chunks(part_rows * cout))
        .map(|(index, output_gradient)| {
            let part = Part { input, cin, index, taps, output_gradient, cout };
            I::add_up(level, part)
        })
        .collect();
    let padded = cout.next_multiple_of(LINE);
    gradient.par_chunks_exact_mut(cout).with_min_len(64).enumerate().for_each(|(row, gradient)| {
        for part in &parts {
            let part = &part.as_slice()[row * padded..][..cout];
            gradient.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
    });
}

/// A run of output rows; its result is `[tap][cin][cout padded to whole lines]`.
pub struct Part<'a, I> {
    input: &'a [I],
    cin: usize,
    index: &'a [u32],
    taps: usize,
    output_gradient: &'a [I],
    cout: usize,
}

/// A value of the rows in training.
pub trait Trainable: Element<Sum = f32> {
    /// The partial sums of a run of rows.
    fn add_up(level: Level, part: Part<Self>) -> Aligned<f32>;
}

impl Trainable for f32 {
    compiled_here!(add_up(Part) -> Aligned<f32>);
}

impl Trainable for Bf16 {
    compiled_here!(add_up(Part) -> Aligned<f32>);
}

impl<I: Trainable> Kernel for Part<'_, I> {
    type Output = Aligned<f32>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Aligned<f32> {
        let padded = self.cout.next_multiple_of(LINE);
        let mut sums = Aligned::zeros(self.taps * self.cin * padded);
        let [mut inputs, mut outputs] = [self.cin, PANEL_MAX].map(Rows::new);
        let indices = self.index.chunks(BLOCK * self.taps);
        let blocks = indices.zip(self.output_gradient.chunks(BLOCK * self.cout));
        for (index, block) in blocks {
            let mut lists = Lists::new(index, self.taps);
            let sums = sums.as_mut_slice().chunks_exact_mut(self.cin * padded);
            for (tap, sums) in sums.enumerate() {
                let listed = lists.at_tap(simd, tap);
                inputs.fill::<true>(self.input, self.cin, 0..self.cin, listed);
                for Panel { first, used, .. } in panels(self.cout) {
                    outputs.fill::<false>(block, self.cout, first..first + used, listed);
                    gradient_tiles(simd, &inputs, &outputs, &mut sums[first..], padded);
                }
            }
        }
        sums
    }
}
