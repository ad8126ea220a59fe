//! The forward convolution cut into blocks of rows, in any precision.

use std::ops::Range;

use crate::{
    Element, Epilogue, Gather,
    packed::Packed,
    simd::{BLOCK, Kernel, Level, Lists, Room, Simd},
    weights::{PANEL_MAX, Panel, panels},
};

/// One convolution; its lengths have been checked.
pub(crate) struct Job<'a, W: Packed> {
    pub(crate) level: Level,
    pub(crate) input: &'a [W::Input],
    pub(crate) gather: &'a Gather,
    pub(crate) weights: &'a W,
    pub(crate) epilogue: Epilogue<'a>,
}

impl<W: Packed> Job<'_, W> {
    /// Halves the rows, at a multiple of [`BLOCK`], down to one block each. `output` begins at row `first`; the rows
    /// that `output_rows` names ascend.
    pub(crate) fn range<O: Element>(
        &self,
        rows: Range<usize>,
        output_rows: Option<&[u32]>,
        first: usize,
        output: &mut [O],
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
        let (_, _, cout) = self.weights.shape();
        let middle = rows.start + (rows.len().div_ceil(BLOCK) / 2) * BLOCK;
        let middle_row = output_rows.map_or(middle, |places| places[middle] as usize);
        let (low, high) = output.split_at_mut((middle_row - first) * cout);
        rayon::join(
            || self.range(rows.start..middle, output_rows, first, low),
            || self.range(middle..rows.end, output_rows, middle_row, high),
        );
    }
}

/// At most [`BLOCK`] output rows.
struct Block<'a, W: Packed, O> {
    job: &'a Job<'a, W>,
    rows: Range<usize>,
    output_rows: Option<&'a [u32]>,
    first: usize,
    output: &'a mut [O],
}

impl<W: Packed, O: Element> Kernel for Block<'_, W, O> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        let (_, _, cout) = self.job.weights.shape();
        let mut room = Room::<W::Sum, { BLOCK * PANEL_MAX }>::new();
        let mut lists = Lists::new();
        for panel in panels(cout) {
            let bias = self.job.epilogue.bias;
            let bias = bias.map(|bias| &bias[panel.first..][..panel.used]);
            let mut first = [W::Sum::default(); PANEL_MAX];
            self.job.weights.begin(bias, &mut first);
            let sums = room.rows(self.rows.len(), &first[..panel.width]);
            self.accumulate(simd, panel, &mut lists, sums);
            self.finish(panel, bias, sums);
        }
    }
}

impl<W: Packed, O: Element> Block<'_, W, O> {
    #[inline(always)]
    fn accumulate<S: Simd>(&self, simd: S, panel: Panel, lists: &mut Lists, sums: &mut [W::Sum]) {
        let Job {
            input,
            gather,
            weights,
            ..
        } = self.job;
        let (taps, cin, _) = weights.shape();
        let index = &gather.index[self.rows.start * taps..self.rows.end * taps];
        let mut tap = 0;
        while tap < taps && cin > 0 {
            let listed = lists.at_taps_from(simd, index, taps, tap);
            let next = tap + listed.taps();
            weights.tap(simd, input, panel, tap, listed, sums);
            tap = next;
        }
    }

    #[inline(always)]
    fn finish(&mut self, panel: Panel, bias: Option<&[f32]>, sums: &[W::Sum]) {
        let (_, _, cout) = self.job.weights.shape();
        let floor = self.job.epilogue.floor();
        for (row, sums) in self.rows.clone().zip(sums.chunks_exact(panel.width)) {
            let row = self.output_rows.map_or(row, |rows| rows[row] as usize) - self.first;
            let output = &mut self.output[row * cout + panel.first..][..panel.used];
            self.job.weights.finish(panel, bias, sums, floor, output);
        }
    }
}
