//! Points of a neighbourhood in square buckets seen from above, for neighbour search.

use super::Neighbourhood;
use crate::fit::spans;
use mluc_kernels::at_best;

/// A bucket grid over a square around the origin, from which points can be removed one by one; buffers are reused.
#[derive(Debug, Default)]
pub(crate) struct Buckets {
    side: usize,
    half_m: f32,
    per_m: f32,
    /// First entry of each cell, and one past its last remaining entry.
    cells: Vec<[u32; 2]>,
    items: Vec<u32>,
    cell_of: Vec<u32>,
}

const NO_CELL: u32 = u32::MAX;
/// Maximum number of cells along a side; if more are needed, the cells become larger than requested.
const SIDE_MAX: usize = 512;

impl Buckets {
    /// Sorts the points that `keep` accepts into cells of at least `cell_m`; within a cell they stay in order.
    pub(crate) fn fill(&mut self, near: &Neighbourhood, cell_m: f32, keep: impl Fn(usize) -> bool) {
        let (x_m, y_m) = (&near.x_m[..], &near.y_m[..]);
        let [x, y] = at_best!(spans(x_m, y_m, [1.0, 0.0]));
        self.half_m = (-x[0]).max(x[1]).max(-y[0]).max(y[1]).max(0.0) + cell_m;
        let cell_m = cell_m.max(2.0 * self.half_m / SIDE_MAX as f32);
        self.per_m = 1.0 / cell_m;
        self.side = (2.0 * self.half_m * self.per_m) as usize + 1;
        self.cells.clear();
        self.cells.resize(self.side * self.side, [0; 2]);
        self.cell_of.clear();
        for (i, (&x, &y)) in x_m.iter().zip(y_m).enumerate() {
            let cell = if keep(i) { self.cell_at(x, y) as u32 } else { NO_CELL };
            if let Some([_, count]) = self.cells.get_mut(cell as usize) {
                *count += 1;
            }
            self.cell_of.push(cell);
        }
        let mut next = 0;
        for [first, end] in &mut self.cells {
            let count = *end;
            (*first, *end) = (next, next);
            next += count;
        }
        // Every entry is overwritten.
        self.items.resize(next as usize, 0);
        for (i, &cell) in self.cell_of.iter().enumerate() {
            if let Some([_, end]) = self.cells.get_mut(cell as usize) {
                self.items[*end as usize] = i as u32;
                *end += 1;
            }
        }
    }

    fn cell_at(&self, x_m: f32, y_m: f32) -> usize {
        let along = |v: f32| (((v + self.half_m) * self.per_m) as usize).min(self.side - 1);
        along(y_m) * self.side + along(x_m)
    }

    /// The cell of a place and the cells around it, at most nine.
    fn block(&self, [x_m, y_m]: [f32; 2]) -> impl Iterator<Item = usize> + use<> {
        let (side, cell) = (self.side, self.cell_at(x_m, y_m));
        let (column, row) = (cell % side, cell / side);
        let near = move |at: usize| at.saturating_sub(1)..(at + 2).min(side);
        near(row).flat_map(move |row| near(column).map(move |column| row * side + column))
    }

    /// Removes the points around a place for which `take` returns true; the others keep their order.
    pub(crate) fn take_around(&mut self, place_m: [f32; 2], mut take: impl FnMut(u32) -> bool) {
        for cell in self.block(place_m) {
            let [first, end] = self.cells[cell];
            let mut kept = first;
            for i in first..end {
                let point = self.items[i as usize];
                if !take(point) {
                    self.items[kept as usize] = point;
                    kept += 1;
                }
            }
            self.cells[cell][1] = kept;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lie_around_their_neighbours_until_they_are_taken() {
        let mut around = Neighbourhood::default();
        around.x_m = (0..300).map(|i| (i as f32 * 0.37) % 7.0 - 3.5).collect();
        around.y_m = (0..300).map(|i| (i as f32 * 0.73) % 5.0 - 2.5).collect();
        let mut grid = Buckets::default();
        grid.fill(&around, 0.5, |i| i % 7 != 0);
        let place = |i: usize| [around.x_m[i], around.y_m[i]];
        let near = |i: usize, j: usize| {
            let ([x, y], [ox, oy]) = (place(i), place(j));
            (x - ox).hypot(y - oy) <= 0.5
        };
        let mut taken = |i: usize, takes: fn(u32) -> bool| {
            let mut found = vec![];
            grid.take_around(place(i), |p| {
                found.push(p);
                takes(p)
            });
            found
        };
        for i in (0..300).filter(|i| i % 7 != 0) {
            let found = taken(i, |_| false);
            assert!(found.iter().all(|p| p % 7 != 0));
            assert!((0..300).all(|j| !near(i, j) || j % 7 == 0 || found.contains(&(j as u32))));
        }
        let odd: Vec<u32> = taken(1, |p| p % 2 == 0).into_iter().filter(|p| p % 2 == 1).collect();
        assert_eq!(taken(1, |_| true), odd);
        assert!(taken(1, |_| true).is_empty());
    }
}
