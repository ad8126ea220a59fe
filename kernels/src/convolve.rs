//! The forward convolution in blocks of rows. With transposed weights and gather it also computes the gradient of its input.

use crate::{
    Element, Epilogue, Gather, Level, Weights,
    simd::{BLOCK, Kernel, Lists, Products, Room, Simd, Sum, clamp},
    weights::{PANEL_MAX, Panel, panels},
};
use std::ops::Range;

/// `output[o] = epilogue(sum over taps t, channels c of input[gather(o, t)][c] * weights[t][c])`.
///
/// `input`: rows of `weights.cin`. `output`: rows of `weights.cout`. `output_rows`: the row of `output` that gets output row
/// `o` of the gather, ascending (`None`: row `o`); other rows keep their values.
///
/// Sums of f32 and bf16 are f32. Sums of bytes are exact integers; each is converted to f32 and multiplied by its channel's
/// scale, then the bias is added. The output is rounded to its type `O`.
///
/// Runs on rayon's current thread pool; the bits of the result do not depend on the number of threads. The bits of bf16
/// results depend on the processor: some processors round twice where others round once. Allocates nothing.
///
/// # Panics
/// When lengths or row numbers contradict each other (a broken invariant, not data).
pub fn convolve<I: Element, O: Element>(
    input: &[I],
    gather: &Gather,
    weights: &Weights<I>,
    epilogue: Epilogue,
    output_rows: Option<&[u32]>,
    output: &mut [O],
) {
    let level = Level::best();
    convolve_at(level, input, gather, weights, epilogue, output_rows, output);
}

/// [`convolve`] with the registers of `level`, for tests and measurements.
pub fn convolve_at<I: Element, O: Element>(
    level: Level,
    input: &[I],
    gather: &Gather,
    weights: &Weights<I>,
    epilogue: Epilogue,
    output_rows: Option<&[u32]>,
    output: &mut [O],
) {
    let (taps, cin, cout) = (weights.taps, weights.cin, weights.cout);
    let outputs = gather.outputs();
    if outputs == 0 || cout == 0 {
        return;
    }
    assert_eq!(gather.taps, taps, "taps of gather and weights");
    assert_eq!(gather.index.len(), outputs * taps, "gather rows are whole");
    assert!(input.len().is_multiple_of(cin.max(1)), "{} inputs in rows of {cin}", input.len());
    epilogue.check(cout);
    let job = Job { level, input, gather, weights, epilogue };
    let Some(rows) = output_rows else {
        return job.range(0..outputs, None, 0, &mut output[..outputs * cout]);
    };
    assert_eq!(rows.len(), outputs, "a place for each output row");
    assert!(rows.is_sorted_by(|a, b| a < b), "output rows that ascend");
    job.range(0..outputs, Some(rows), 0, output);
}

/// One convolution; its lengths have been checked.
struct Job<'a, I: Element> {
    level: Level,
    input: &'a [I],
    gather: &'a Gather,
    weights: &'a Weights<I>,
    epilogue: Epilogue<'a>,
}

impl<I: Element> Job<'_, I> {
    /// Splits the rows recursively, at multiples of [`BLOCK`], down to one block each. `output` begins at row `first`; `output_rows` ascend.
    fn range<O: Element>(
        &self,
        rows: Range<usize>,
        output_rows: Option<&[u32]>,
        first: usize,
        output: &mut [O],
    ) {
        if rows.len() <= BLOCK {
            return self.level.run(Block { job: self, rows, output_rows, first, output });
        }
        let middle = rows.start + (rows.len().div_ceil(BLOCK) / 2) * BLOCK;
        let middle_row = output_rows.map_or(middle, |places| places[middle] as usize);
        let (low, high) = output.split_at_mut((middle_row - first) * self.weights.cout);
        rayon::join(
            || self.range(rows.start..middle, output_rows, first, low),
            || self.range(middle..rows.end, output_rows, middle_row, high),
        );
    }
}

/// At most [`BLOCK`] output rows.
struct Block<'a, I: Element, O> {
    job: &'a Job<'a, I>,
    rows: Range<usize>,
    output_rows: Option<&'a [u32]>,
    first: usize,
    output: &'a mut [O],
}

impl<I: Element, O: Element> Kernel for Block<'_, I, O> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, _: S) {
        let mut room = Room::<I::Sum, { BLOCK * PANEL_MAX }>::new();
        let (taps, rows) = (self.job.weights.taps, &self.rows);
        let index = &self.job.gather.index[rows.start * taps..rows.end * taps];
        let mut lists = Lists::new(index, taps);
        for panel in panels(self.job.weights.cout) {
            let mut bias = [0.0; PANEL_MAX];
            if let Some(values) = self.job.epilogue.bias {
                bias[..panel.used].copy_from_slice(&values[panel.first..][..panel.used]);
            }
            let mut first = [I::Sum::default(); PANEL_MAX];
            first.iter_mut().zip(&bias).for_each(|(first, bias)| *first = I::Sum::begin(*bias));
            let sums = room.rows(self.rows.len(), &first[..panel.width]);
            let products = Products {
                input: self.job.input,
                weights: self.job.weights,
                panel,
                lists: &mut lists,
                sums: &mut *sums,
            };
            I::accumulate(self.job.level, products);
            self.finish(panel, &bias[..panel.used], sums);
        }
    }
}

impl<I: Element, O: Element> Block<'_, I, O> {
    #[inline(always)]
    fn finish(&mut self, panel: Panel, bias: &[f32], sums: &[I::Sum]) {
        let weights = self.job.weights;
        let scale = &weights.scale()[panel.first..][..panel.used];
        let floor = self.job.epilogue.floor();
        for (row, sums) in self.rows.clone().zip(sums.chunks_exact(panel.width)) {
            let row = self.output_rows.map_or(row, |rows| rows[row] as usize) - self.first;
            let output = &mut self.output[row * weights.cout + panel.first..][..panel.used];
            let channels = sums.iter().zip(scale).zip(bias);
            for (y, ((&sum, &scale), &bias)) in output.iter_mut().zip(channels) {
                *y = O::from_f32(clamp(sum.finish(scale, bias), floor));
            }
        }
    }
}
