//! The rows of a block that have an input row at a tap.

use crate::{ABSENT, simd::Pair};

/// Rows of a block: its sums (at most 64 channels) fill three quarters of a first-level cache of 32 KiB. A multiple of
/// all tile heights (6, 8, 12), so that a block without absent rows is covered by tall tiles.
pub(crate) const BLOCK: usize = 96;

/// Storage for the pairs of one block and one tap.
pub(crate) struct Pairs([Pair; BLOCK]);

impl Pairs {
    #[inline(always)]
    pub(crate) fn new() -> Pairs {
        Pairs([Pair::default(); BLOCK])
    }

    /// Lists the rows present at `tap`. `index`: at most [`BLOCK`] rows of `taps`.
    #[inline(always)]
    pub(crate) fn at_tap(&mut self, index: &[u32], taps: usize, tap: usize) -> &[Pair] {
        let mut count = 0;
        for (row, inputs) in index.chunks_exact(taps).enumerate() {
            // Always written, kept when present: no branch to mispredict.
            self.0[count] = Pair {
                input: inputs[tap],
                row: row as u32,
            };
            count += usize::from(inputs[tap] != ABSENT);
        }
        &self.0[..count]
    }
}
