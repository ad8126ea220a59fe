//! What stands on the ground, in cells of 25 cm seen from above; cells near each other are united.
//!
//! Points of one cell belong together. Two cells belong together when any pair of their points is within the join
//! distance of their mean range: so the result depends on no order of points or cells.

use std::ops::Range;

use super::places::{Places, SIDE};
use crate::ascending::Ascending;
use crate::fit::{higher, lower};
use crate::frame::{HALF_EXTENT_M, IndexedPoint};

/// Side of a cell, m: its diagonal is below the shortest full join distance (0.4 m).
const CELL_M: f32 = 0.25;
const _: () = assert!(SIDE == (2.0 * HALF_EXTENT_M / CELL_M as f64) as usize);
const EMPTY: u32 = u32::MAX;
/// Cells that any reach spans at most: join distances up to 3.5 m; beyond it a reach is cut short.
const REACH_MAX: u32 = 15;

/// More than what rounding takes from a distance, m.
const ROUNDING_M: f32 = 0.001;

/// One cell with points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// Place in the grid: row by row.
    place: u32,
    /// First of its points, and how many.
    first: u32,
    pub(super) count: u32,
    /// Lowest x, y and highest x, y of its points, m.
    pub(super) extent_m: [f32; 4],
    /// Lowest and highest z of its points, m.
    pub(super) z_m: [f32; 2],
    /// From the sensor's axis to its middle, m.
    pub(super) range_m: f32,
}

/// The cells of one frame; buffers are reused.
#[derive(Debug)]
pub(super) struct Cells {
    /// Number of each place's cell.
    number_at: Vec<u32>,
    pub(super) cells: Vec<Cell>,
    /// As they were added, with their cells' numbers.
    added: Vec<(IndexedPoint, u32)>,
    /// Cell by cell.
    pub(super) places_m: Vec<[f32; 2]>,
    pub(super) indices: Vec<u32>,
    /// First cell of those that each is united with.
    root: Vec<u32>,
    /// Places of the cells that are not reached yet, and the cells that are.
    left: Places,
    reached: Vec<u32>,
    /// For sorting: places, the cells as they were, and their new numbers.
    by_place: Vec<u32>,
    pub(super) ascending: Ascending,
    unsorted: Vec<Cell>,
    new_number: Vec<u32>,
}

impl Default for Cells {
    fn default() -> Cells {
        Cells {
            number_at: vec![EMPTY; SIDE * SIDE],
            cells: Vec::new(),
            added: Vec::new(),
            places_m: Vec::new(),
            indices: Vec::new(),
            root: Vec::new(),
            left: Places::default(),
            reached: Vec::new(),
            by_place: Vec::new(),
            ascending: Ascending::default(),
            unsorted: Vec::new(),
            new_number: Vec::new(),
        }
    }
}

impl Cells {
    /// Forgets the last frame, touching only the places that it used.
    pub(super) fn clear(&mut self) {
        for cell in &self.cells {
            self.number_at[cell.place as usize] = EMPTY;
        }
        self.cells.clear();
        self.added.clear();
    }

    /// One more point, within the frame's square.
    pub(super) fn add(&mut self, point: &IndexedPoint) {
        let [x, y, z] = point.at_m;
        let place = along(y) * SIDE + along(x);
        let mut number = self.number_at[place];
        if number == EMPTY {
            number = self.cells.len() as u32;
            self.number_at[place] = number;
            self.cells.push(Cell {
                place: place as u32,
                first: 0,
                count: 0,
                extent_m: [x, y, x, y],
                z_m: [z, z],
                range_m: middle_m(place).map(|v| v * v).iter().sum::<f32>().sqrt(),
            });
        }
        let cell = &mut self.cells[number as usize];
        cell.count += 1;
        let [x0, y0, x1, y1] = cell.extent_m;
        cell.extent_m = [lower(x0, x), lower(y0, y), higher(x1, x), higher(y1, y)];
        cell.z_m = [lower(cell.z_m[0], z), higher(cell.z_m[1], z)];
        self.added.push((*point, number));
    }

    /// Numbers the cells row by row and sorts the points by cell, once all are there.
    pub(super) fn sort(&mut self) {
        self.by_place.clear();
        self.by_place
            .extend(self.cells.iter().map(|cell| cell.place));
        self.ascending.sort(&mut self.by_place);
        self.new_number.resize(self.cells.len(), 0);
        self.unsorted.clear();
        self.unsorted.extend_from_slice(&self.cells);
        let mut first = 0;
        for (new, &place) in self.by_place.iter().enumerate() {
            let old = self.number_at[place as usize];
            let cell = &mut self.cells[new];
            *cell = self.unsorted[old as usize];
            cell.first = first;
            first += cell.count;
            // Serves as the cursor below and comes out as it was.
            cell.count = 0;
            self.new_number[old as usize] = new as u32;
            self.number_at[place as usize] = new as u32;
        }
        self.places_m.clear();
        self.places_m.resize(self.added.len(), [0.0; 2]);
        self.indices.clear();
        self.indices.resize(self.added.len(), 0);
        for (point, old) in &self.added {
            let cell = &mut self.cells[self.new_number[*old as usize] as usize];
            let slot = (cell.first + cell.count) as usize;
            cell.count += 1;
            self.places_m[slot] = [point.at_m[0], point.at_m[1]];
            self.indices[slot] = point.index;
        }
        self.root.resize(self.cells.len(), 0);
    }

    /// Points of a cell.
    pub(super) fn points(&self, cell: u32) -> Range<usize> {
        self.cells[cell as usize].points()
    }

    /// Points of many cells.
    pub(super) fn count(&self, cells: &[u32]) -> usize {
        cells
            .iter()
            .map(|&cell| self.cells[cell as usize].count as usize)
            .sum()
    }

    /// The cells whose places lie in a square, row by row.
    pub(super) fn around(&self, center_m: [f32; 2], half_side_m: f32) -> impl Iterator<Item = u32> {
        let [columns, rows] = center_m.map(|v| along(v - half_side_m)..along(v + half_side_m) + 1);
        rows.flat_map(move |row| {
            let first = (row * SIDE + columns.start) as u32;
            let end = (row * SIDE + columns.end) as u32;
            let from = self.cells.partition_point(|cell| cell.place < first);
            let own = self.cells[from..].iter().take_while(move |c| c.place < end);
            from as u32..(from + own.count()) as u32
        })
    }

    /// Lowest x, y and highest x, y of many cells' points, m.
    pub(super) fn extent_m(&self, cells: &[u32]) -> [f32; 4] {
        let far = f32::INFINITY;
        cells.iter().fold([far, far, -far, -far], |e, &cell| {
            let [x0, y0, x1, y1] = self.cells[cell as usize].extent_m;
            [e[0].min(x0), e[1].min(y0), e[2].max(x1), e[3].max(y1)]
        })
    }

    /// Unites those of `own`, ascending, that are within the join distance of each other. [`Cells::root`] tells the
    /// result. `join_m` grows with the range, or stays.
    ///
    /// A flood from every cell that none before has reached. Only cells that are left are met again, and only a join's
    /// reach around.
    pub(super) fn unite(&mut self, own: &[u32], join_m: impl Fn(f32) -> f32) {
        for &cell in own {
            self.left.insert(self.cells[cell as usize].place);
        }
        for &root in own {
            if self.left.remove(self.cells[root as usize].place) {
                self.flood(root, &join_m);
            }
        }
    }

    fn flood(&mut self, root: u32, join_m: &impl Fn(f32) -> f32) {
        self.reached.clear();
        self.reached.push(root);
        let mut next = 0;
        while let Some(&a) = self.reached.get(next) {
            next += 1;
            self.root[a as usize] = root;
            let cell = self.cells[a as usize];
            // Of no other cell around is the range longer.
            let most_m = join_m(cell.range_m + REACH_MAX as f32 * CELL_M);
            let [columns, rows] = cell.around(most_m + ROUNDING_M);
            for row in rows {
                let first = row * SIDE as u32 + columns.start;
                let mut left = self.left.part(first, columns.len() as u32);
                while left != 0 {
                    let place = first + left.trailing_zeros();
                    left &= left - 1;
                    let b = self.number_at[place as usize];
                    let extent_m = self.cells[b as usize].extent_m;
                    if gap_squared(cell.extent_m, extent_m) <= most_m * most_m
                        && self.are_joined(a.min(b), a.max(b), join_m)
                    {
                        self.left.remove(place);
                        self.reached.push(b);
                    }
                }
            }
        }
    }

    fn are_joined(&self, low: u32, high: u32, join_m: &impl Fn(f32) -> f32) -> bool {
        let [a, b] = [low, high].map(|cell| &self.cells[cell as usize]);
        let join = join_m((a.range_m + b.range_m) / 2.0);
        self.touch(a, b, join * join) && {
            // The lower cell's reach counts, where two cells see each other differently.
            let [ax, ay] = a.column_and_row();
            let [bx, by] = b.column_and_row();
            ax.abs_diff(bx).max(ay.abs_diff(by)) <= reach_of(join_m(a.range_m))
        }
    }

    /// The first of the cells that are united with this one.
    pub(super) fn root(&self, cell: u32) -> u32 {
        self.root[cell as usize]
    }

    fn touch(&self, a: &Cell, b: &Cell, join_squared: f32) -> bool {
        if gap_squared(a.extent_m, b.extent_m) > join_squared {
            return false;
        }
        if span_squared(a.extent_m, b.extent_m) <= join_squared {
            return true;
        }
        let others = &self.places_m[b.points()];
        self.places_m[a.points()].iter().any(|&[x, y]| {
            gap_squared([x, y, x, y], b.extent_m) <= join_squared
                && others.iter().any(|&[ox, oy]| {
                    let (dx, dy) = (ox - x, oy - y);
                    dx * dx + dy * dy <= join_squared
                })
        })
    }
}

impl Cell {
    fn points(&self) -> Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }

    fn column_and_row(&self) -> [u32; 2] {
        [self.place % SIDE as u32, self.place / SIDE as u32]
    }

    /// Columns and rows of the cells that may hold points this near, m.
    fn around(&self, near_m: f32) -> [Range<u32>; 2] {
        let [column, row] = self.column_and_row();
        let range = |at: u32, low_m: f32, high_m: f32| {
            let first = (along(low_m - near_m) as u32).max(at.saturating_sub(REACH_MAX));
            first..(along(high_m + near_m) as u32).min(at + REACH_MAX) + 1
        };
        let [x0, y0, x1, y1] = self.extent_m;
        [range(column, x0, x1), range(row, y0, y1)]
    }
}

/// Column or row of a coordinate.
fn along(v_m: f32) -> usize {
    (((v_m + HALF_EXTENT_M as f32) / CELL_M) as usize).min(SIDE - 1)
}

/// Cells this many apart may still hold points within a join: the middle of a cell is not its nearest point.
fn reach_of(join_m: f32) -> u32 {
    ((join_m / CELL_M) as u32 + 1).min(REACH_MAX)
}

fn middle_m(place: usize) -> [f32; 2] {
    [place % SIDE, place / SIDE].map(|i| (i as f32 + 0.5) * CELL_M - HALF_EXTENT_M as f32)
}

/// Squared distance between two extents, m^2.
fn gap_squared(a: [f32; 4], b: [f32; 4]) -> f32 {
    let gap = |axis: usize| higher(higher(b[axis] - a[axis + 2], a[axis] - b[axis + 2]), 0.0);
    gap(0) * gap(0) + gap(1) * gap(1)
}

/// Squared diagonal of both extents together, m^2: no two of their points are farther apart.
fn span_squared(a: [f32; 4], b: [f32; 4]) -> f32 {
    let span = |axis: usize| higher(a[axis + 2], b[axis + 2]) - lower(a[axis], b[axis]);
    span(0) * span(0) + span(1) * span(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(points: &[[f32; 2]]) -> Cells {
        let mut cells = Cells::default();
        for (index, &[x, y]) in points.iter().enumerate() {
            cells.add(&IndexedPoint {
                at_m: [x, y, 0.0],
                index: index as u32,
            });
        }
        cells.sort();
        cells
    }

    fn scattered(count: usize) -> Vec<[f32; 2]> {
        let f = |i: usize, k: f64| ((i as f64 * k).sin() * 43758.5453).rem_euclid(1.0) as f32;
        (0..count)
            .map(|i| [20.0 + 9.0 * f(i, 12.9898), 3.0 + 9.0 * f(i, 78.233)])
            .collect()
    }

    /// Groups of points, each sorted, by joining pair by pair.
    fn plain(points: &[[f32; 2]], join_m: f32) -> Vec<usize> {
        let mut group: Vec<usize> = (0..points.len()).collect();
        let cell = |p: [f32; 2]| p.map(|v| (v / CELL_M).floor() as i32);
        loop {
            let mut changed = false;
            for a in 0..points.len() {
                for b in 0..points.len() {
                    let (p, q) = (points[a], points[b]);
                    let near = (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) <= join_m * join_m;
                    if group[a] > group[b] && (near || cell(p) == cell(q)) {
                        group[a] = group[b];
                        changed = true;
                    }
                }
            }
            if !changed {
                return group;
            }
        }
    }

    #[test]
    fn equals_joining_point_by_point() {
        for (count, join_m) in [(60, 0.5), (150, 0.5), (250, 0.4), (250, 0.15), (40, 1.2)] {
            let points = scattered(count);
            let mut cells = filled(&points);
            let own: Vec<u32> = (0..cells.cells.len() as u32).collect();
            cells.unite(&own, |_| join_m);
            let expected = plain(&points, join_m);
            let mut root_of = vec![0; count];
            for &cell in &own {
                let root = cells.root(cell);
                for slot in cells.points(cell) {
                    root_of[cells.indices[slot] as usize] = root;
                }
            }
            for a in 0..count {
                for b in 0..a {
                    assert_eq!(expected[a] == expected[b], root_of[a] == root_of[b]);
                }
            }
        }
    }

    #[test]
    fn a_frame_leaves_nothing_behind() {
        let mut cells = filled(&scattered(100));
        cells.clear();
        assert!(cells.number_at.iter().all(|&number| number == EMPTY));
        assert!(cells.cells.is_empty());
    }
}
