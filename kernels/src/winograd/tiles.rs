//! The rows that the tiles of 2x2 outputs read and write.

use super::PLACES;
use crate::ABSENT;

/// Tiles that cover every requested cell of a map once. They begin at even rows and columns, so a cell's tile does not depend on the other cells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WinogradTiles {
    /// 16 per tile: the input rows of its 4x4 window, row by row; [`ABSENT`] beyond the map.
    pub(super) inputs: Vec<u32>,
    /// 4 per tile: the output rows that it writes, row by row; [`ABSENT`] where an output is not requested.
    pub(super) outputs: Vec<u32>,
    /// Runs of tiles, in order.
    pub(super) strips: Vec<Strip>,
}

/// The tiles of two rows of a map. They write only rows before `rows_end`; later strips write only rows from `rows_end` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Strip {
    /// The first tile after the strip.
    pub(super) tiles_end: usize,
    /// The first output row after the strip.
    pub(super) rows_end: usize,
}

impl WinogradTiles {
    /// No tiles, with room for every cell of a map of rows (y) x columns (x).
    pub fn new([rows, columns]: [usize; 2]) -> WinogradTiles {
        let (strips, tiles) = (rows.div_ceil(2), rows.div_ceil(2) * columns.div_ceil(2));
        WinogradTiles {
            inputs: Vec::with_capacity(tiles * PLACES),
            outputs: Vec::with_capacity(tiles * 4),
            strips: Vec::with_capacity(strips),
        }
    }

    /// Sets the tiles to the tiles of `cells` (row * columns + column, ascending) of a map of this shape.
    ///
    /// # Panics
    /// When the cells do not ascend or lie beyond the map (a broken invariant, not data).
    pub fn assign(&mut self, cells: &[u32], [rows, columns]: [usize; 2]) {
        assert!(cells.is_sorted_by(|a, b| a < b), "cells that ascend");
        let last = cells.last();
        let inside = last.is_none_or(|cell| (*cell as usize) < rows * columns);
        assert!(inside, "cell {last:?} of {rows} x {columns}");
        self.inputs.clear();
        self.outputs.clear();
        self.strips.clear();
        let mut rest = cells;
        for top in (0..rows).step_by(2) {
            let mut row = |y: usize| {
                let (row, after) = rest
                    .split_at(rest.partition_point(|cell| (*cell as usize) < (y + 1) * columns));
                rest = after;
                row.iter().map(move |cell| *cell as usize - y * columns)
            };
            let (mut upper, mut lower) = (row(top).peekable(), row(top + 1).peekable());
            while let Some(x) = [upper.peek(), lower.peek()].into_iter().flatten().min() {
                let left = x / 2 * 2;
                let outputs = self.outputs.len();
                self.outputs.extend([ABSENT; 4]);
                for (y, row) in [&mut upper, &mut lower].into_iter().enumerate() {
                    while let Some(x) = row.next_if(|x| *x < left + 2) {
                        self.outputs[outputs + 2 * y + x - left] = ((top + y) * columns + x) as u32;
                    }
                }
                self.window([top, left], [rows, columns]);
            }
            self.strips
                .push(Strip { tiles_end: self.count(), rows_end: (top + 2).min(rows) * columns });
        }
    }

    /// Number of tiles.
    pub fn count(&self) -> usize {
        self.outputs.len() / 4
    }

    /// Number of products of a row of a transformed window with the weights of its place: 16 per tile.
    pub fn products(&self) -> usize {
        self.inputs.len()
    }

    /// Number of tiles in the strips before this one.
    pub(super) fn before(&self, strip: usize) -> usize {
        strip.checked_sub(1).map(|last| self.strips[last].tiles_end).unwrap_or(0)
    }

    /// The input rows of the tile at `top`, `left`.
    fn window(&mut self, [top, left]: [usize; 2], [rows, columns]: [usize; 2]) {
        if top > 0 && left > 0 && top + 2 < rows && left + 2 < columns {
            let first = ((top - 1) * columns + left - 1) as u32;
            for y in 0..4 {
                let row = first + y * columns as u32;
                self.inputs.extend([row, row + 1, row + 2, row + 3]);
            }
            return;
        }
        for y in top..top + 4 {
            for x in left..left + 4 {
                // One more than the coordinates, so that they do not go below 0.
                let inside = (1..=rows).contains(&y) && (1..=columns).contains(&x);
                let row = inside.then(|| ((y - 1) * columns + x - 1) as u32);
                self.inputs.push(row.unwrap_or(ABSENT));
            }
        }
    }
}
