//! Covers a table of rows x columns with register tiles.

use super::{LINE, Simd};

/// Work on one tile of a table.
pub(super) trait Tile {
    /// Whether a product needs a few registers besides its operands on a processor without an instruction for it.
    const NEEDS_SPARE: bool = false;

    /// Works on rows `row..row + R` and columns `column..column + V * S::LANES`, where `at` is `[row, column]`. Implement it `#[inline(always)]`.
    ///
    /// # Safety
    /// These rows and columns lie inside the table that the implementing type was made for.
    unsafe fn tile<S: Simd, const R: usize, const V: usize>(&self, simd: S, at: [usize; 2]);
}

/// Works on every row and column exactly once.
///
/// The tile shapes leave registers for a row of weights and a broadcast value: 24 accumulators of 32 registers, 12 or 8 of 16.
///
/// # Safety
/// The table of `tile` has `rows` rows and `columns` columns; `columns` is a multiple of 16.
#[inline(always)]
pub(super) unsafe fn cover<S: Simd, T: Tile>(simd: S, rows: usize, columns: usize, tile: &T) {
    // SAFETY (all): the columns passed on are inside 0..columns, and the rows inside 0..rows by `down`.
    match (S::LANES, columns) {
        (16, 16) => unsafe { down::<S, 12, 1>(simd, rows, 0, tile) },
        (16, 32) => unsafe { down::<S, 12, 2>(simd, rows, 0, tile) },
        (16, 48) => unsafe { down::<S, 8, 3>(simd, rows, 0, tile) },
        (16, 64) => unsafe { down::<S, 6, 4>(simd, rows, 0, tile) },
        _ => {
            for column in (0..columns).step_by(LINE) {
                match (S::LANES, S::REGISTERS) {
                    (16, _) => unsafe { down::<S, 12, 1>(simd, rows, column, tile) },
                    (8, _) if T::NEEDS_SPARE => unsafe {
                        down::<S, 4, 2>(simd, rows, column, tile)
                    },
                    (8, _) => unsafe { down::<S, 6, 2>(simd, rows, column, tile) },
                    (_, 32) => unsafe { down::<S, 6, 4>(simd, rows, column, tile) },
                    _ => unsafe { down::<S, 2, 4>(simd, rows, column, tile) },
                }
            }
        }
    }
}

/// Works on all rows of a strip of columns: first the tallest tiles, then lower ones.
#[inline(always)]
unsafe fn down<S: Simd, const R: usize, const V: usize>(
    simd: S,
    rows: usize,
    column: usize,
    tile: &impl Tile,
) {
    let mut row = 0;
    // SAFETY (all): each tile ends at or before `rows`; the caller guarantees the columns.
    while row + R <= rows {
        unsafe { tile.tile::<S, R, V>(simd, [row, column]) };
        row += R;
    }
    if R > 8 && row + 8 <= rows {
        unsafe { tile.tile::<S, 8, V>(simd, [row, column]) };
        row += 8;
    }
    if R > 4 && row + 4 <= rows {
        unsafe { tile.tile::<S, 4, V>(simd, [row, column]) };
        row += 4;
    }
    if R > 2 && row + 2 <= rows {
        unsafe { tile.tile::<S, 2, V>(simd, [row, column]) };
        row += 2;
    }
    if row < rows {
        unsafe { tile.tile::<S, 1, V>(simd, [row, column]) };
    }
}
