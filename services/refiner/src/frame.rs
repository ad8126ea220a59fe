//! One pass over the scan: the points near any detection, sorted into cells of 1 m seen from above.
//!
//! A counting sort that is linear in the points. Points far from every detection are touched once and then forgotten,
//! so the cost of all that follows depends on the regions alone. Points that are not finite, or further than
//! 128 m from the sensor along x or y, are left out and counted. Rows of cells in which nothing is wanted are never
//! looked at.

use std::ops::Range;

use mluc_ipc_types::{POINTS_MAX, Point};
use mluc_kernels::at_best;

use crate::merge::KNOWN_MARGIN_M;
use crate::proposal::Proposal;

/// Half the side of the square that is looked at, m: farther than such sensors reach.
pub(crate) const HALF_EXTENT_M: f64 = 128.0;
/// Cells of 1 m along a side.
const SIDE: usize = 2 * HALF_EXTENT_M as usize;
const CELLS: usize = SIDE * SIDE;
/// A point in no cell.
const NO_CELL: u32 = u32::MAX;
/// Points whose cells are worked out together.
const BLOCK: usize = 256;

/// A point with its place in the scan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))] // Copied as a whole.
pub struct IndexedPoint {
    /// x, y, z, m.
    pub at_m: [f32; 3],
    /// Index into the scan.
    pub index: u32,
}

/// The scan's points near the detections, by cell.
#[derive(Debug)]
pub struct FrameIndex {
    wanted: Vec<bool>,
    /// Rows of cells in which any is wanted; the lists below hold what is old in all others.
    rows: Range<usize>,
    /// First slot of each cell, and one past the last.
    cell_first: Vec<u32>,
    /// Slot of each cell's lowest point; [`NO_CELL`] where it is empty.
    lowest_slot: Vec<u32>,
    /// Wanted points and their cells.
    kept: Vec<(u32, u32)>,
    slots: Vec<IndexedPoint>,
    /// Points with NaN or infinity.
    pub not_finite: u32,
    /// Points beyond the square, and points beyond the contract's limit.
    pub outside: u32,
}

impl Default for FrameIndex {
    fn default() -> FrameIndex {
        FrameIndex {
            wanted: vec![false; CELLS],
            rows: 0..0,
            cell_first: vec![0; CELLS + 1],
            lowest_slot: vec![NO_CELL; CELLS],
            kept: Vec::with_capacity(POINTS_MAX),
            slots: Vec::with_capacity(POINTS_MAX),
            not_finite: 0,
            outside: 0,
        }
    }
}

/// A range of cells along x and along y, both ends included.
#[derive(Clone, Copy, Debug)]
struct Cells {
    x: (usize, usize),
    y: (usize, usize),
}

impl FrameIndex {
    /// Forgets the regions of the last frame.
    pub fn start(&mut self) {
        let cells = self.cells();
        self.wanted[cells].fill(false);
        self.rows = 0..0;
    }

    /// Asks for all points.
    pub fn want_all(&mut self) {
        self.wanted.fill(true);
        self.rows = 0..SIDE;
    }

    /// Asks for the points of a square around a centre, m. Centres and half sides that are not finite ask for nothing.
    pub fn want(&mut self, center_m: [f64; 2], half_side_m: f64) {
        let Some(cells) = Cells::around(center_m, half_side_m) else {
            return;
        };
        for iy in cells.y.0..=cells.y.1 {
            self.wanted[iy * SIDE + cells.x.0..=iy * SIDE + cells.x.1].fill(true);
        }
        self.rows = if self.rows.is_empty() {
            cells.y.0..cells.y.1 + 1
        } else {
            self.rows.start.min(cells.y.0)..self.rows.end.max(cells.y.1 + 1)
        };
    }

    /// Asks for the points in and around the boxes of known objects.
    pub(crate) fn want_known(&mut self, proposals: &[Proposal]) {
        for known in proposals.iter().filter(|p| p.is_known()) {
            let grown = known.grown(KNOWN_MARGIN_M);
            let [x, y, _] = grown.center_m;
            self.want([x, y], grown.size_m[0].hypot(grown.size_m[1]) / 2.0);
        }
    }

    /// The cells of all rows in which any is wanted.
    fn cells(&self) -> Range<usize> {
        self.rows.start * SIDE..self.rows.end * SIDE
    }

    /// Sorts the scan; points beyond [`POINTS_MAX`] are left out.
    pub fn sort(&mut self, scan: &[Point]) {
        self.outside = scan.len().saturating_sub(POINTS_MAX) as u32;
        let scan = &scan[..scan.len().min(POINTS_MAX)];
        self.count_cells(scan);
        self.fill_slots(scan);
        self.find_lowest();
    }

    fn count_cells(&mut self, scan: &[Point]) {
        self.not_finite = 0;
        let cells = self.cells();
        self.cell_first[cells.start..=cells.end].fill(0);
        self.kept.clear();
        let (wanted, cell_first) = (&self.wanted[..], &mut self.cell_first[..]);
        let mut cell_of_point = [NO_CELL; BLOCK];
        for (block, points) in scan.chunks(BLOCK).enumerate() {
            at_best(
                #[inline(always)]
                || cells_of(points, &mut cell_of_point),
            );
            for (i, (point, &cell)) in points.iter().zip(&cell_of_point).enumerate() {
                if cell == NO_CELL {
                    if point.x_m.is_finite() && point.y_m.is_finite() && point.z_m.is_finite() {
                        self.outside += 1;
                    } else {
                        self.not_finite += 1;
                    }
                } else if wanted[cell as usize] {
                    cell_first[cell as usize + 1] += 1;
                    self.kept.push(((block * BLOCK + i) as u32, cell));
                }
            }
        }
        let mut sum = 0;
        for first in &mut self.cell_first[cells.start..=cells.end] {
            sum += *first;
            *first = sum;
        }
    }

    /// `cell_first[c]` serves as the cursor of cell c and ends as the first slot of cell c + 1: the sum above is
    /// inclusive one place to the right, so it is walked back afterwards.
    fn fill_slots(&mut self, scan: &[Point]) {
        // Every slot is overwritten.
        self.slots.resize(self.kept.len(), IndexedPoint::default());
        for &(index, cell) in &self.kept {
            let point = &scan[index as usize];
            let cursor = &mut self.cell_first[cell as usize];
            self.slots[*cursor as usize] = IndexedPoint {
                at_m: [point.x_m, point.y_m, point.z_m],
                index,
            };
            *cursor += 1;
        }
        let cells = self.cells();
        self.cell_first.copy_within(cells.clone(), cells.start + 1);
        self.cell_first[cells.start] = 0;
    }

    /// Ties go by x and y, so that the order of the scan does not matter.
    fn find_lowest(&mut self) {
        for cell in self.cells() {
            let (first, end) = (self.cell_first[cell], self.cell_first[cell + 1]);
            self.lowest_slot[cell] = NO_CELL;
            if first == end {
                continue;
            }
            let own = &self.slots[first as usize..end as usize];
            let (mut best, [mut bx, mut by, mut bz]) = (0, own[0].at_m);
            for (i, point) in own.iter().enumerate() {
                let [x, y, z] = point.at_m;
                if z < bz || (z == bz && (x < bx || (x == bx && y < by))) {
                    (best, [bx, by, bz]) = (i as u32, point.at_m);
                }
            }
            self.lowest_slot[cell] = first + best;
        }
    }

    /// The points of the wanted cells that a square touches, row by row; at least all points inside it.
    pub fn rows_around(
        &self,
        center_m: [f64; 2],
        half_side_m: f64,
    ) -> impl Iterator<Item = &[IndexedPoint]> {
        self.cell_rows(center_m, half_side_m).map(move |cells| {
            let first = self.cell_first[cells.start] as usize;
            let end = self.cell_first[cells.end] as usize;
            &self.slots[first..end]
        })
    }

    /// The cells that a square touches, row by row; rows in which nothing is wanted are left out.
    fn cell_rows(
        &self,
        center_m: [f64; 2],
        half_side_m: f64,
    ) -> impl Iterator<Item = Range<usize>> {
        let cells = Cells::around(center_m, half_side_m);
        cells.into_iter().flat_map(move |cells| {
            let rows = cells.y.0.max(self.rows.start)..(cells.y.1 + 1).min(self.rows.end);
            rows.map(move |iy| iy * SIDE + cells.x.0..iy * SIDE + cells.x.1 + 1)
        })
    }

    /// The cells with points: where their lower corner lies, m, and their points.
    pub fn occupied_cells(&self) -> impl Iterator<Item = ([f64; 2], &[IndexedPoint])> {
        let cells = self.cells();
        let first = cells.start;
        self.cell_first[first..=cells.end]
            .windows(2)
            .enumerate()
            .filter_map(move |(i, ends)| {
                let cell = first + i;
                let corner = [cell % SIDE, cell / SIDE].map(|i| i as f64 - HALF_EXTENT_M);
                let own = &self.slots[ends[0] as usize..ends[1] as usize];
                (!own.is_empty()).then_some((corner, own))
            })
    }

    /// The lowest point of every wanted cell that a square touches.
    pub fn lowest_around(
        &self,
        center_m: [f64; 2],
        half_side_m: f64,
    ) -> impl Iterator<Item = &IndexedPoint> {
        let rows = self.cell_rows(center_m, half_side_m);
        // Rows without a point are passed over at once.
        let rows = rows.filter(move |c| self.cell_first[c.start] < self.cell_first[c.end]);
        rows.flat_map(move |cells| self.lowest_slot[cells].iter())
            .filter(|&&slot| slot != NO_CELL)
            .map(move |&slot| &self.slots[slot as usize])
    }
}

/// The cell of each point of a block.
#[inline(always)]
fn cells_of(points: &[Point], cells: &mut [u32; BLOCK]) {
    for (cell, point) in cells.iter_mut().zip(points) {
        *cell = cell_of(point);
    }
}

/// [`NO_CELL`] outside of the square, and for numbers that are not finite.
#[inline(always)]
fn cell_of(point: &Point) -> u32 {
    const SIDE_F: f32 = SIDE as f32;
    let x = point.x_m + HALF_EXTENT_M as f32;
    let y = point.y_m + HALF_EXTENT_M as f32;
    // Comparisons with NaN are false. No short cuts: branches that depend on the data cost more than comparisons.
    let side = 0.0..SIDE_F;
    let inside = side.contains(&x) & side.contains(&y) & (point.z_m.abs() <= f32::MAX);
    if inside {
        whole(y) * SIDE as u32 + whole(x)
    } else {
        NO_CELL
    }
}

/// The whole part of a number of 0 to 2^23, by steps that registers of several numbers can do: adding 2^23 leaves it in
/// the low bits.
#[inline(always)]
pub(crate) fn whole(v: f32) -> u32 {
    (v.trunc() + 8_388_608.0).to_bits() & 0x7F_FFFF
}

impl Cells {
    fn around(center_m: [f64; 2], half_side_m: f64) -> Option<Cells> {
        let span = |center: f64| {
            let low = center - half_side_m + HALF_EXTENT_M;
            let high = center + half_side_m + HALF_EXTENT_M;
            // False for NaN as well.
            let meets = low < SIDE as f64 && high >= 0.0 && low <= high;
            meets.then(|| (low.max(0.0) as usize, (high as usize).min(SIDE - 1)))
        };
        Some(Cells {
            x: span(center_m[0])?,
            y: span(center_m[1])?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_m: f32, y_m: f32, z_m: f32) -> Point {
        Point {
            x_m,
            y_m,
            z_m,
            intensity: 0.0,
        }
    }

    #[test]
    fn only_the_wanted_points_are_kept_and_the_rest_is_counted() {
        let scan = [
            at(10.2, 0.0, 1.0),
            at(10.8, 0.4, -1.0),
            at(50.0, 0.0, 0.0),
            at(f32::NAN, 0.0, 0.0),
            at(10.0, 0.0, f32::INFINITY),
            at(500.0, 0.0, 0.0),
        ];
        let mut frame = FrameIndex::default();
        for _ in 0..2 {
            frame.start();
            frame.want([10.0, 0.0], 2.0);
            frame.want([f64::NAN, 0.0], 2.0);
            frame.want([0.0, 0.0], f64::INFINITY.min(-1.0));
            frame.sort(&scan);
            let found: Vec<u32> = frame
                .rows_around([10.0, 0.0], 2.0)
                .flatten()
                .map(|p| p.index)
                .collect();
            assert_eq!(found, [0, 1]);
            assert_eq!((frame.not_finite, frame.outside), (2, 1));
            let lowest: Vec<u32> = frame
                .lowest_around([10.0, 0.0], 2.0)
                .map(|p| p.index)
                .collect();
            assert_eq!(lowest, [1]);
        }
    }

    #[test]
    fn points_beyond_the_limit_are_counted() {
        let scan = vec![at(1.0, 1.0, 0.0); POINTS_MAX + 7];
        let mut frame = FrameIndex::default();
        frame.start();
        frame.want([1.0, 1.0], 1.0);
        frame.sort(&scan);
        assert_eq!(frame.outside, 7);
        let found = frame.rows_around([1.0, 1.0], 1.0).flatten().count();
        assert_eq!(found, POINTS_MAX);
    }

    #[test]
    fn a_frame_is_as_after_any_other() {
        let scan: Vec<Point> = (0..3000)
            .map(|i| {
                at(
                    (i % 97) as f32 - 48.0,
                    (i % 89) as f32 - 44.0,
                    i as f32 * 1e-3,
                )
            })
            .collect();
        let regions = [[0.0, 0.0], [20.0, 30.0], [-30.0, -35.0]];
        let sorted = |frame: &mut FrameIndex, center_m: [f64; 2]| {
            frame.start();
            frame.want(center_m, 6.0);
            frame.sort(&scan);
        };
        let mut used = FrameIndex::default();
        used.want_all();
        used.sort(&scan);
        for center_m in regions {
            let mut fresh = FrameIndex::default();
            sorted(&mut fresh, center_m);
            sorted(&mut used, center_m);
            for asked in regions {
                let found = |frame: &FrameIndex| {
                    let points = frame.rows_around(asked, 40.0).flatten();
                    let lowest = frame.lowest_around(asked, 40.0);
                    [
                        points.map(|p| p.index).collect(),
                        lowest.map(|p| p.index).collect(),
                    ]
                };
                let (expected, again): ([Vec<u32>; 2], _) = (found(&fresh), found(&used));
                assert_eq!(expected, again);
                assert!(asked != center_m || !expected[0].is_empty());
            }
            assert!(fresh.occupied_cells().eq(used.occupied_cells()));
        }
    }

    #[test]
    fn every_wanted_point_is_in_its_row_once() {
        let scan: Vec<Point> = (0..4000)
            .map(|i| {
                let i = i as f32;
                at((i * 0.37) % 60.0 - 30.0, (i * 0.91) % 50.0 - 25.0, i * 1e-3)
            })
            .collect();
        let mut frame = FrameIndex::default();
        frame.start();
        frame.want([0.0, 0.0], 40.0);
        frame.sort(&scan);
        let mut found: Vec<u32> = frame
            .rows_around([0.0, 0.0], 40.0)
            .flatten()
            .map(|p| p.index)
            .collect();
        found.sort_unstable();
        assert!(found.iter().copied().eq(0..4000));
    }
}
