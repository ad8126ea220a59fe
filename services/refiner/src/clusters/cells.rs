//! The points that stand on the ground, in cells of 25 cm seen from above; cells near each other are united.
//!
//! Points of one cell belong together. Two cells belong together when any pair of their points is within the join distance
//! at their mean range, so the result does not depend on the order of points or cells. Cells are added in tiles of 1 m, at
//! the latest when a component comes near: tiles far from all requested tiles cost nothing.

use super::places::{Places, SIDE};
use crate::{fit::higher, fit::lower, frame::IndexedPoint};
use mluc_geometry::ground::tiles::{self, HALF_EXTENT_M};
use smart_default::SmartDefault;
use std::ops::Range;

/// Side of a cell, m: its diagonal is below the shortest full join distance (0.4 m).
const CELL_M: f32 = 0.25;
/// Number of cells along a tile's side.
const PER_TILE: u32 = 4;
const _: () = assert!(SIDE == tiles::SIDE * PER_TILE as usize);
const EMPTY: u32 = u32::MAX;
/// Maximum reach in cells: enough for join distances up to 3.5 m; a longer reach is cut.
const REACH_MAX: u32 = 15;
/// More than the rounding error of a distance, m.
const ROUNDING_M: f32 = 0.001;

/// One cell with points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// Index in the grid, row by row.
    place: u32,
    /// Index of its first point, and number of its points.
    first: u32,
    pub(super) count: u32,
    /// Lowest x, y and highest x, y of its points, m.
    pub(super) extent_m: [f32; 4],
    /// Lowest and highest z of its points, m.
    pub(super) z_m: [f32; 2],
    /// Distance from the sensor's axis to the cell's middle, m.
    range_m: f32,
}

/// The cells of one frame; buffers are reused.
#[derive(Debug, SmartDefault)]
pub(super) struct Cells {
    /// Number of the cell at each place of the grid.
    #[default(vec![EMPTY; SIDE * SIDE])]
    number_at: Vec<u32>,
    /// First cell of each tile, and one past its last cell; [`EMPTY`] for a tile that was not added.
    #[default(vec![[EMPTY; 2]; tiles::TILES])]
    tiles: Vec<[u32; 2]>,
    added: Vec<u32>,
    pub(super) cells: Vec<Cell>,
    /// x and y of the points, m, cell by cell.
    pub(super) places_m: Vec<[f32; 2]>,
    pub(super) indices: Vec<u32>,
    /// Places of the cells that are not reached yet.
    left: Places,
    /// The united cells, component by component.
    pub(super) reached: Vec<u32>,
    /// The end of each component in `reached`.
    pub(super) ends: Vec<u32>,
}

impl Cells {
    /// Clears the last frame; touches only the places that it used.
    pub(super) fn clear(&mut self) {
        for cell in &self.cells {
            self.number_at[cell.place as usize] = EMPTY;
        }
        for &tile in &self.added {
            self.tiles[tile as usize] = [EMPTY; 2];
        }
        self.added.clear();
        self.cells.clear();
        self.places_m.clear();
        self.indices.clear();
    }

    pub(super) fn has_tile(&self, tile: usize) -> bool {
        self.tiles[tile][0] != EMPTY
    }

    pub(super) fn add_tile(&mut self, tile: usize, points: &[IndexedPoint]) {
        let first_cell = self.cells.len();
        for point in points {
            let [x, y, z] = point.at_m;
            let place = place_of(point);
            let mut number = self.number_at[place] as usize;
            if number == EMPTY as usize {
                number = self.cells.len();
                let middle_m = |i: usize| (i as f32 + 0.5) * CELL_M - HALF_EXTENT_M as f32;
                let [middle_x, middle_y] = [place % SIDE, place / SIDE].map(middle_m);
                self.number_at[place] = number as u32;
                self.cells.push(Cell {
                    place: place as u32,
                    first: 0,
                    count: 0,
                    extent_m: [x, y, x, y],
                    z_m: [z, z],
                    range_m: (middle_x * middle_x + middle_y * middle_y).sqrt(),
                });
            }
            let cell = &mut self.cells[number];
            cell.count += 1;
            let [x0, y0, x1, y1] = cell.extent_m;
            cell.extent_m = [lower(x0, x), lower(y0, y), higher(x1, x), higher(y1, y)];
            cell.z_m = [lower(cell.z_m[0], z), higher(cell.z_m[1], z)];
        }
        let mut end = self.indices.len() as u32;
        for cell in &mut self.cells[first_cell..] {
            cell.first = end;
            end += cell.count;
            // Serves as the cursor below, which restores its value.
            cell.count = 0;
        }
        self.places_m.resize(end as usize, [0.0; 2]);
        self.indices.resize(end as usize, 0);
        for point in points {
            let number = self.number_at[place_of(point)];
            let cell = &mut self.cells[number as usize];
            let slot = (cell.first + cell.count) as usize;
            cell.count += 1;
            self.places_m[slot] = [point.at_m[0], point.at_m[1]];
            self.indices[slot] = point.index;
        }
        self.tiles[tile] = [first_cell as u32, self.cells.len() as u32];
        self.added.push(tile as u32);
    }

    /// The cells of the added tiles that a square (centre and half side, m) touches.
    pub(super) fn around(&self, center_m: [f64; 2], half_side_m: f64) -> impl Iterator<Item = u32> {
        let tiles = tiles::tile_rows(center_m, half_side_m).flatten();
        tiles.flat_map(|tile| self.tiles[tile][0]..self.tiles[tile][1])
    }

    pub(super) fn points(&self, cell: u32) -> Range<usize> {
        self.cells[cell as usize].points()
    }

    pub(super) fn count(&self, cells: &[u32]) -> usize {
        cells.iter().map(|&cell| self.cells[cell as usize].count as usize).sum()
    }

    /// Lowest x, y and highest x, y of many cells' points, m.
    pub(super) fn extent_m(&self, cells: &[u32]) -> [f32; 4] {
        let far = f32::INFINITY;
        cells.iter().fold([far, far, -far, -far], |e, &cell| {
            let [x0, y0, x1, y1] = self.cells[cell as usize].extent_m;
            [e[0].min(x0), e[1].min(y0), e[2].max(x1), e[3].max(y1)]
        })
    }

    pub(super) fn length_m(&self, cells: &[u32]) -> f32 {
        let [x0, y0, x1, y1] = self.extent_m(cells);
        (x1 - x0).max(y1 - y0)
    }

    /// Writes the components of `own` into `reached` and `ends`; the join distance may depend on the range.
    pub(super) fn unite(&mut self, own: &[u32], join_m: impl Fn(f32) -> f32) {
        for &cell in own {
            self.left.insert(self.cells[cell as usize].place);
        }
        self.flood_all(own.iter().copied(), join_m, |_, _| {});
    }

    /// Finds the whole components that contain any cell of the tiles added so far; `add` adds a tile that a component comes near.
    pub(super) fn unite_whole(
        &mut self,
        join_m: impl Fn(f32) -> f32,
        mut add: impl FnMut(&mut Cells, usize),
    ) {
        let mut seen = 0;
        let mut insert_new = |cells: &mut Cells| {
            for cell in &cells.cells[seen..] {
                cells.left.insert(cell.place);
            }
            seen = cells.cells.len();
        };
        insert_new(self);
        let add_around = |cells: &mut Cells, [columns, rows]: &[Range<u32>; 2]| {
            let tiles = |range: &Range<u32>| range.start / PER_TILE..range.end.div_ceil(PER_TILE);
            for row in tiles(rows) {
                for column in tiles(columns) {
                    let tile = row as usize * tiles::SIDE + column as usize;
                    if !cells.has_tile(tile) {
                        add(cells, tile);
                        insert_new(cells);
                    }
                }
            }
        };
        self.flood_all(0..self.cells.len() as u32, join_m, add_around);
        // Cells of tiles that a component came near but did not reach.
        for cell in &self.cells {
            self.left.remove(cell.place);
        }
    }

    /// Starts a flood at every root that no earlier flood has reached. A flood only visits cells that are left, within a
    /// join's reach; `prepare` is called with these columns and rows before.
    fn flood_all(
        &mut self,
        roots: impl Iterator<Item = u32>,
        join_m: impl Fn(f32) -> f32,
        mut prepare: impl FnMut(&mut Cells, &[Range<u32>; 2]),
    ) {
        self.reached.clear();
        self.ends.clear();
        let mut next = 0;
        for root in roots {
            if !self.left.remove(self.cells[root as usize].place) {
                continue;
            }
            self.reached.push(root);
            while let Some(&a) = self.reached.get(next) {
                next += 1;
                let cell = self.cells[a as usize];
                // No other cell around has a longer range.
                let most_m = join_m(cell.range_m + REACH_MAX as f32 * CELL_M);
                let around = cell.around(most_m + ROUNDING_M);
                prepare(self, &around);
                self.reach(&cell, around, most_m, &join_m);
            }
            self.ends.push(self.reached.len() as u32);
        }
    }

    /// Adds the cells that are joined to `cell` to the reached cells.
    fn reach(
        &mut self,
        cell: &Cell,
        [columns, rows]: [Range<u32>; 2],
        most_m: f32,
        join_m: &impl Fn(f32) -> f32,
    ) {
        for row in rows {
            let first = row * SIDE as u32 + columns.start;
            let mut left = self.left.part(first, columns.len() as u32);
            while left != 0 {
                let place = first + left.trailing_zeros();
                left &= left - 1;
                let number = self.number_at[place as usize];
                let other = &self.cells[number as usize];
                if gap_squared(cell.extent_m, other.extent_m) <= most_m * most_m
                    && self.are_joined(cell, other, join_m)
                {
                    self.left.remove(place);
                    self.reached.push(number);
                }
            }
        }
    }

    fn are_joined(&self, a: &Cell, b: &Cell, join_m: &impl Fn(f32) -> f32) -> bool {
        let (a, b) = if a.place < b.place { (a, b) } else { (b, a) };
        let join = join_m((a.range_m + b.range_m) / 2.0);
        self.touch(a, b, join * join) && {
            // The reaches of two cells may differ; the reach of the cell with the lower place counts. Cells this far apart
            // may still have points within a join: the middle of a cell is not its nearest point.
            let reach = ((join_m(a.range_m) / CELL_M) as u32 + 1).min(REACH_MAX);
            let [ax, ay] = a.column_and_row();
            let [bx, by] = b.column_and_row();
            ax.abs_diff(bx).max(ay.abs_diff(by)) <= reach
        }
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

    /// Columns and rows of the cells that may have points within `near_m`, m.
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

fn place_of(point: &IndexedPoint) -> usize {
    along(point.at_m[1]) * SIDE + along(point.at_m[0])
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
    use std::collections::BTreeMap;

    fn scattered(count: usize) -> Vec<[f32; 2]> {
        let f = |i: usize, k: f64| ((i as f64 * k).sin() * 43758.5453).rem_euclid(1.0) as f32;
        let place = |i| [20.0 + 9.0 * f(i, 12.9898), 3.0 + 9.0 * f(i, 78.233)];
        (0..count).map(place).collect()
    }

    fn tiles(points: &[[f32; 2]]) -> BTreeMap<usize, Vec<IndexedPoint>> {
        let mut tiles: BTreeMap<usize, Vec<IndexedPoint>> = BTreeMap::new();
        for (index, &[x, y]) in points.iter().enumerate() {
            let tile = tiles::tile_of([x, y, 0.0]) as usize;
            tiles
                .entry(tile)
                .or_default()
                .push(IndexedPoint { at_m: [x, y, 0.0], index: index as u32 });
        }
        tiles
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

    /// The component of each point; [`EMPTY`] for points without a component.
    fn components(cells: &Cells, points: usize) -> Vec<u32> {
        let mut component = vec![EMPTY; points];
        let mut first = 0;
        for &end in &cells.ends {
            for &cell in &cells.reached[first as usize..end as usize] {
                for slot in cells.points(cell) {
                    component[cells.indices[slot] as usize] = end;
                }
            }
            first = end;
        }
        component
    }

    #[test]
    fn equals_joining_point_by_point_from_all_tiles_and_from_one() {
        for (count, join_m) in [(60, 0.5), (150, 0.5), (250, 0.4), (250, 0.15), (40, 1.2)] {
            let points = scattered(count);
            let tiles = tiles(&points);
            let expected = plain(&points, join_m);
            let mut cells = Cells::default();
            let mut run = |start: Option<usize>| {
                cells.clear();
                assert!(cells.number_at.iter().all(|&number| number == EMPTY));
                for (&tile, points) in &tiles {
                    if start.is_none_or(|start| start == tile) {
                        cells.add_tile(tile, points);
                    }
                }
                let of = |tile| tiles.get(&tile).map_or(&[][..], Vec::as_slice);
                cells.unite_whole(|_| join_m, |cells, tile| cells.add_tile(tile, of(tile)));
                components(&cells, count)
            };
            let same = |found: &[u32], a: usize, b: usize| {
                let is_any = [found[a], found[b]].contains(&EMPTY);
                is_any || (expected[a] == expected[b]) == (found[a] == found[b])
            };
            let all = run(None);
            assert!(!all.contains(&EMPTY));
            assert!((0..count).all(|a| (0..a).all(|b| same(&all, a, b))));
            for (&tile, own) in &tiles {
                let found = run(Some(tile));
                assert!((0..count).all(|a| (0..a).all(|b| same(&found, a, b))));
                let seeds: Vec<usize> = own.iter().map(|p| expected[p.index as usize]).collect();
                assert!((0..count).all(|i| (found[i] == EMPTY) != seeds.contains(&expected[i])));
            }
        }
    }
}
