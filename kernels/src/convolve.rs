//! The forward convolution; with transposed weights and gather, also the gradient of its input.

use std::ops::Range;

use crate::{
    Epilogue, Gather, Weights,
    pairs::{BLOCK, Pairs},
    simd::{AlignedArray, Kernel, Level, Simd, convolve_tiles},
    weights::{PANEL_MAX, Panel, panels},
};

/// `output[o] = epilogue(sum over taps t, channels c of input[gather(o, t)][c] * weights[t][c])`.
///
/// `input`: rows of `weights.cin`. `output`: rows of `weights.cout`. `output_rows`: where output row `o` of the gather
/// is written (`None`: at `o`); rows that are not named keep what they hold. Rows in ascending order, the natural one,
/// are written in place; any other order costs one more pass over the result.
///
/// Runs over rayon's ambient pool; the bits of the result do not depend on the number of threads. Allocates nothing
/// when the rows ascend.
///
/// # Panics
/// When lengths or row numbers contradict each other (a broken invariant, not data).
pub fn convolve(
    input: &[f32],
    gather: &Gather,
    weights: &Weights,
    epilogue: Epilogue,
    output_rows: Option<&[u32]>,
    output: &mut [f32],
) {
    convolve_at(
        Level::best(),
        input,
        gather,
        weights,
        epilogue,
        output_rows,
        output,
    );
}

/// [`convolve`] with the registers of `level`, for tests and measurements.
pub fn convolve_at(
    level: Level,
    input: &[f32],
    gather: &Gather,
    weights: &Weights,
    epilogue: Epilogue,
    output_rows: Option<&[u32]>,
    output: &mut [f32],
) {
    let (outputs, cout) = (gather.outputs(), weights.cout);
    if outputs == 0 || cout == 0 {
        return;
    }
    assert_eq!(gather.taps, weights.taps, "taps of gather and weights");
    assert_eq!(
        gather.index.len(),
        outputs * gather.taps,
        "gather rows are whole"
    );
    assert!(
        input.len().is_multiple_of(weights.cin.max(1)),
        "{} inputs in rows of {}",
        input.len(),
        weights.cin
    );
    assert!(
        epilogue.bias.is_none_or(|bias| bias.len() == cout),
        "one bias for each of {cout} channels"
    );
    let job = Job {
        level,
        input,
        gather,
        weights,
        epilogue,
    };
    let Some(rows) = output_rows else {
        return job.range(0..outputs, None, 0, &mut output[..outputs * cout]);
    };
    assert_eq!(rows.len(), outputs, "a place for each output row");
    if rows.is_sorted_by(|a, b| a < b) {
        return job.range(0..outputs, Some(rows), 0, output);
    }
    let mut ordered = vec![0.0; outputs * cout];
    job.range(0..outputs, None, 0, &mut ordered);
    for (row, from) in rows.iter().zip(ordered.chunks_exact(cout)) {
        output[*row as usize * cout..][..cout].copy_from_slice(from);
    }
}

#[derive(Clone, Copy)]
struct Job<'a> {
    level: Level,
    input: &'a [f32],
    gather: &'a Gather,
    weights: &'a Weights,
    epilogue: Epilogue<'a>,
}

impl Job<'_> {
    /// Halves the rows, at a multiple of [`BLOCK`], down to one block each. `output` begins at row `first`.
    fn range(
        self,
        rows: Range<usize>,
        output_rows: Option<&[u32]>,
        first: usize,
        output: &mut [f32],
    ) {
        if rows.len() <= BLOCK {
            return self.level.run(Block {
                job: self,
                rows,
                output_rows,
                first,
                output,
            });
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
struct Block<'a> {
    job: Job<'a>,
    rows: Range<usize>,
    output_rows: Option<&'a [u32]>,
    first: usize,
    output: &'a mut [f32],
}

impl Kernel for Block<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        let mut sums = AlignedArray([0.0; BLOCK * PANEL_MAX]);
        for panel in panels(self.job.weights.cout) {
            let sums = &mut sums.0[..self.rows.len() * panel.width];
            self.begin(panel, sums);
            self.accumulate(simd, panel, sums);
            self.finish(panel, sums);
        }
    }
}

impl Block<'_> {
    #[inline(always)]
    fn begin(&self, panel: Panel, sums: &mut [f32]) {
        sums.fill(0.0);
        if let Some(bias) = self.job.epilogue.bias {
            let bias = &bias[panel.first..][..panel.used];
            sums.chunks_exact_mut(panel.width)
                .for_each(|row| row[..panel.used].copy_from_slice(bias));
        }
    }

    #[inline(always)]
    fn accumulate<S: Simd>(&self, simd: S, panel: Panel, sums: &mut [f32]) {
        let Job {
            input,
            gather,
            weights,
            ..
        } = self.job;
        let (taps, cin) = (gather.taps, weights.cin);
        let index = &gather.index[self.rows.start * taps..self.rows.end * taps];
        let mut pairs = Pairs::new();
        if cin == 0 {
            return;
        }
        for (tap, weights) in weights
            .panel(panel)
            .chunks_exact(cin * panel.width)
            .enumerate()
        {
            convolve_tiles(
                simd,
                input,
                cin,
                pairs.at_tap(index, taps, tap),
                weights,
                panel.width,
                sums,
            );
        }
    }

    #[inline(always)]
    fn finish(&mut self, panel: Panel, sums: &[f32]) {
        let Job {
            weights: Weights { cout, .. },
            epilogue,
            ..
        } = self.job;
        for (row, sums) in self.rows.clone().zip(sums.chunks_exact(panel.width)) {
            let row = self.output_rows.map_or(row, |rows| rows[row] as usize) - self.first;
            let output = &mut self.output[row * cout + panel.first..][..panel.used];
            let sums = &sums[..panel.used];
            if epilogue.relu {
                output
                    .iter_mut()
                    .zip(sums)
                    .for_each(|(y, &sum)| *y = if sum < 0.0 { 0.0 } else { sum });
            } else {
                output.copy_from_slice(sums);
            }
        }
    }
}
