//! Interleaved rows, as many as a step of products takes: the operands of a sum over rows.

use super::{Aligned, BLOCK, LINE, Operand, list::Listed};
use std::ops::Range;

/// Channels of a block's listed rows: `[step][width][Operand::STEP]`; the last step and the last line are padded with zeros.
pub(crate) struct Rows<I: Operand> {
    values: Aligned<I::Weight>,
    pub(super) channels: usize,
    pub(super) steps: usize,
}

impl<I: Operand> Rows<I> {
    /// Room for `channels` channels.
    pub(crate) fn new(channels: usize) -> Rows<I> {
        Rows {
            values: Aligned::zeros(BLOCK * channels.next_multiple_of(LINE)),
            channels: 0,
            steps: 0,
        }
    }

    /// Copies the channels of the rows that the pairs name: with `INPUT` rows of the input, else of the block. `from`: rows of `stride`.
    #[inline(always)]
    pub(crate) fn fill<const INPUT: bool>(
        &mut self,
        from: &[I],
        stride: usize,
        channels: Range<usize>,
        listed: Listed,
    ) {
        if INPUT {
            listed.check(from.len() / stride, BLOCK);
        }
        let pairs = listed.pairs();
        (self.channels, self.steps) = (channels.len(), pairs.len().div_ceil(I::STEP));
        let width = self.width();
        let values = &mut self.values.as_mut_slice()[..self.steps * width];
        let len = values.len() * I::STEP;
        // SAFETY: a packed weight is the bits of STEP values, and every bit pattern is valid.
        let values = unsafe { std::slice::from_raw_parts_mut(values.as_mut_ptr().cast(), len) };
        let steps = values.chunks_exact_mut(width * I::STEP);
        for (to, pairs) in steps.zip(pairs.chunks(I::STEP)) {
            let row = |k: usize| match pairs.get(k) {
                Some(pair) => {
                    let row = if INPUT { pair.input } else { pair.row };
                    &from[row as usize * stride..][channels.clone()]
                }
                None => &[],
            };
            let rows = [row(0).as_chunks::<LINE>(), row(1).as_chunks()];
            for (line, to) in to.chunks_exact_mut(LINE * I::STEP).enumerate() {
                // One line at a time: the compiler knows its length.
                let lines = rows.map(|(lines, rest)| {
                    lines.get(line).copied().unwrap_or_else(|| {
                        let mut last = [I::default(); LINE];
                        last[..rest.len()].copy_from_slice(rest);
                        last
                    })
                });
                for (c, to) in to.chunks_exact_mut(I::STEP).enumerate() {
                    for (to, line) in to.iter_mut().zip(&lines) {
                        *to = line[c];
                    }
                }
            }
        }
    }

    /// Number of values of a step, padding included.
    #[inline(always)]
    pub(super) fn width(&self) -> usize {
        self.channels.next_multiple_of(LINE)
    }

    /// The steps' values.
    #[inline(always)]
    pub(super) fn as_ptr(&self) -> *const I::Weight {
        self.values.as_slice().as_ptr()
    }
}
