//! The two inner loops: a tile of accumulators (rows x channels) held in registers.
//!
//! Both take a list of [`Pair`]s, one for each output row that has an input row at the tap in question, so absent rows
//! cost nothing. Tiles are taken from the list from the tallest shape down to a single row. Every sum adds its products
//! in one order (taps, then input channels; rows for the gradient), whatever the shape of its tile: the bits depend
//! neither on the shapes nor on the threads.

use super::{LINE, Simd};

/// An input row and the row of the block that it meets at a tap.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pair {
    /// Row of the input.
    pub(crate) input: u32,
    /// Row of the block: of its sums (forward) or of its output gradients.
    pub(crate) row: u32,
}

/// Calls `$tile::<S, R, V>(...)` for the tallest shapes first: `$rows` rows at `$at`.
macro_rules! by_height {
    ($height:expr, $count:expr, |$rows:ident, $at:ident| $call:expr) => {{
        let mut $at = 0;
        by_height!(@step $height, $height, $count, $rows, $at, $call);
        by_height!(@step $height, 8, $count, $rows, $at, $call);
        by_height!(@step $height, 4, $count, $rows, $at, $call);
        by_height!(@step $height, 2, $count, $rows, $at, $call);
        by_height!(@step $height, 1, $count, $rows, $at, $call);
    }};
    (@step $height:expr, $this:expr, $count:expr, $rows:ident, $at:ident, $call:expr) => {
        if $this <= $height {
            const { assert!($this > 0) };
            while $at + $this <= $count {
                const $rows: usize = $this;
                $call;
                $at += $this;
            }
        }
    };
}
