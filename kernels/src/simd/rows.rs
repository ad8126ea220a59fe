//! Rows side by side, as many as a step of products takes: what a sum over rows reads.

use std::ops::Range;

use super::{Aligned, BLOCK, LINE, Operand, list::Listed};

/// Channels of a block's listed rows: `[step][width][Operand::STEP]`, with zeros for what a last step and a last line lack.
pub(crate) struct Rows<I: Operand> {
    values: Aligned<I::Weight>,
    pub(super) channels: usize,
    pub(super) steps: usize,
}

impl<I: Operand> Rows<I> {
    /// Room for so many channels.
    pub(crate) fn new(channels: usize) -> Rows<I> {
        Rows {
            values: Aligned::zeros(BLOCK * channels.next_multiple_of(LINE)),
            channels: 0,
            steps: 0,
        }
    }

    /// Channels of the rows that the pairs name: of the input, or of the block. `from`: rows of `stride`.
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
        // SAFETY: a packed weight is the bits of STEP values, every pattern of which is one.
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
                // A line at a time: the compiler knows how long that is.
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

    /// Values of a step, with the padding.
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
