//! What the inner loops go through: a list of [`Pair`]s, one for each output row that has an input row at the tap in
//! question, so absent rows cost nothing.
//!
//! Every sum adds its products in one order (taps, then input channels; rows for the gradient), whatever the shape of
//! its tile: the bits depend neither on the shapes nor on the threads.

/// An input row and the row of the block that it meets at a tap.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub(crate) struct Pair {
    /// Row of the input.
    pub(crate) input: u32,
    /// Row of the block: of its sums (forward) or of its output gradients.
    pub(crate) row: u32,
}
