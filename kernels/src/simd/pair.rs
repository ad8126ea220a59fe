//! What the inner loops go through: a list of [`Pair`]s, one for each output row that has an input row at the tap in
//! question, so absent rows cost nothing.
//!
//! Every sum adds its products in one order (taps, then input channels; rows for the gradient), whatever the shape of
//! its tile: the bits depend neither on the shapes nor on the threads.

use super::LINE;

/// An input row and the row of the block that it meets at a tap.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pair {
    /// Row of the input.
    pub(crate) input: u32,
    /// Row of the block: of its sums (forward) or of its output gradients.
    pub(crate) row: u32,
}

/// Panics when a pair names a row that is not there, or a row is not whole lines.
#[inline(always)]
pub(super) fn check(pairs: &[Pair], inputs: usize, rows: usize, width: usize) {
    assert!(width.is_multiple_of(LINE), "rows of {width}");
    let (input, row) = pairs.iter().fold((0, 0), |(input, row), pair| {
        (pair.input.max(input), pair.row.max(row))
    });
    assert!(
        pairs.is_empty() || (input as usize) < inputs,
        "input row {input} of {inputs}"
    );
    assert!(
        pairs.is_empty() || (row as usize) < rows,
        "row {row} of a block of {rows}"
    );
}
