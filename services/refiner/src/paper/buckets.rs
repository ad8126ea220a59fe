//! Points of a neighbourhood in square buckets seen from above, for neighbour search.

use mluc_kernels::at_best;

use crate::frame::whole;

/// A bucket grid over a square around the origin; buffers are reused.
#[derive(Debug, Default)]
pub(crate) struct Buckets {
    side: usize,
    half_m: f32,
    per_m: f32,
    /// First entry of each cell, and one past the last.
    first: Vec<u32>,
    items: Vec<u32>,
    cell_of: Vec<u32>,
}

const NO_CELL: u32 = u32::MAX;
/// Cells along a side at most; cells grow beyond the wished size before there are more.
const SIDE_MAX: usize = 512;

impl Buckets {
    /// Sorts the points that `keep` lets through into cells of at least `cell_m`; within a cell they stay in order.
    pub(crate) fn fill(
        &mut self,
        x_m: &[f32],
        y_m: &[f32],
        cell_m: f32,
        keep: impl Fn(usize) -> bool,
    ) {
        self.half_m = at_best(
            #[inline(always)]
            || farthest(x_m).max(farthest(y_m)),
        ) + cell_m;
        let cell_m = cell_m.max(2.0 * self.half_m / SIDE_MAX as f32);
        self.per_m = 1.0 / cell_m;
        self.side = (2.0 * self.half_m * self.per_m) as usize + 1;
        self.first.clear();
        self.first.resize(self.side * self.side + 1, 0);
        let mut cell_of = std::mem::take(&mut self.cell_of);
        cell_of.resize(x_m.len(), NO_CELL);
        at_best(
            #[inline(always)]
            || {
                for ((cell, &x), &y) in cell_of.iter_mut().zip(x_m).zip(y_m) {
                    *cell = self.cell_at(x, y) as u32;
                }
            },
        );
        for (i, cell) in cell_of.iter_mut().enumerate() {
            if keep(i) {
                self.first[*cell as usize + 1] += 1;
            } else {
                *cell = NO_CELL;
            }
        }
        self.cell_of = cell_of;
        let mut sum = 0;
        for first in &mut self.first {
            sum += *first;
            *first = sum;
        }
        // Every entry is overwritten.
        self.items.resize(sum as usize, 0);
        for (i, &cell) in self.cell_of.iter().enumerate() {
            if cell != NO_CELL {
                let cursor = &mut self.first[cell as usize];
                self.items[*cursor as usize] = i as u32;
                *cursor += 1;
            }
        }
        let cells = self.side * self.side;
        self.first.copy_within(0..cells, 1);
        self.first[0] = 0;
    }

    /// Cell of a place.
    #[inline(always)]
    pub(crate) fn cell_at(&self, x_m: f32, y_m: f32) -> usize {
        let side = self.side as u32;
        let along = |v: f32| whole((v + self.half_m) * self.per_m).min(side - 1);
        (along(y_m) * side + along(x_m)) as usize
    }

    /// Points of a cell.
    pub(crate) fn points(&self, cell: usize) -> &[u32] {
        &self.items[self.first[cell] as usize..self.first[cell + 1] as usize]
    }

    /// The cell `dx`, `dy` cells away, if there is one.
    pub(crate) fn shifted(&self, cell: usize, dx: isize, dy: isize) -> Option<usize> {
        let x = (cell % self.side).checked_add_signed(dx)?;
        let y = (cell / self.side).checked_add_signed(dy)?;
        (x < self.side && y < self.side).then(|| y * self.side + x)
    }

    /// The up to nine cells around and with a cell.
    pub(crate) fn block(&self, cell: usize) -> impl Iterator<Item = usize> + '_ {
        (-1..=1).flat_map(move |dy| (-1..=1).filter_map(move |dx| self.shifted(cell, dx, dy)))
    }
}

/// The largest absolute value; 0 without any.
#[inline(always)]
fn farthest(values: &[f32]) -> f32 {
    const LANES: usize = 16;
    let more = |most: f32, v: f32| if v.abs() > most { v.abs() } else { most };
    let mut most = [0.0; LANES];
    let blocks = values.chunks_exact(LANES);
    let rest = blocks.remainder();
    for block in blocks {
        for lane in 0..LANES {
            most[lane] = more(most[lane], block[lane]);
        }
    }
    most.into_iter().chain(rest.iter().copied()).fold(0.0, more)
}

/// Buckets from which points are taken out one by one.
#[derive(Debug, Default)]
pub(crate) struct ShrinkingBuckets {
    pub(crate) grid: Buckets,
    left: Vec<u32>,
}

impl ShrinkingBuckets {
    /// As [`Buckets::fill`].
    pub(crate) fn fill(
        &mut self,
        x_m: &[f32],
        y_m: &[f32],
        cell_m: f32,
        keep: impl Fn(usize) -> bool,
    ) {
        self.grid.fill(x_m, y_m, cell_m, keep);
        self.left.clear();
        self.left
            .extend(self.grid.first.windows(2).map(|pair| pair[1] - pair[0]));
    }

    /// Takes out the points of one cell for which `take` says so; the others keep their order.
    pub(crate) fn take(&mut self, cell: usize, mut take: impl FnMut(u32) -> bool) {
        let first = self.grid.first[cell] as usize;
        let count = self.left[cell] as usize;
        let mut kept = 0;
        for i in first..first + count {
            let point = self.grid.items[i];
            if !take(point) {
                self.grid.items[first + kept] = point;
                kept += 1;
            }
        }
        self.left[cell] = kept as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lie_in_the_block_around_their_neighbours() {
        let x: Vec<f32> = (0..300).map(|i| (i as f32 * 0.37) % 7.0 - 3.5).collect();
        let y: Vec<f32> = (0..300).map(|i| (i as f32 * 0.73) % 5.0 - 2.5).collect();
        let mut grid = Buckets::default();
        grid.fill(&x, &y, 0.5, |i| i % 7 != 0);
        for i in (0..300).filter(|i| i % 7 != 0) {
            let cell = grid.cell_at(x[i], y[i]);
            let found: Vec<u32> = grid
                .block(cell)
                .flat_map(|c| grid.points(c).to_vec())
                .collect();
            for j in 0..300 {
                let near = (x[i] - x[j]).hypot(y[i] - y[j]) <= 0.5;
                assert!(!near || j % 7 == 0 || found.contains(&(j as u32)));
            }
        }
        assert!((0..grid.side * grid.side).all(|c| grid.points(c).iter().all(|p| p % 7 != 0)));
    }

    #[test]
    fn taken_points_are_gone() {
        let mut buckets = ShrinkingBuckets::default();
        buckets.fill(&[0.0; 5], &[0.0; 5], 1.0, |_| true);
        let cell = buckets.grid.cell_at(0.0, 0.0);
        let mut seen = Vec::new();
        buckets.take(cell, |p| p % 2 == 0);
        buckets.take(cell, |p| {
            seen.push(p);
            false
        });
        assert_eq!(seen, [1, 3]);
    }
}
