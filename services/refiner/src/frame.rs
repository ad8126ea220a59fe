//! One pass over the scan: its points, sorted into tiles of 1 m seen from above.
//!
//! A counting sort, linear in the points. Points that are not finite are left out and counted; points farther than 128 m along x or y are left out.

use crate::fit::lower;
use mluc_geometry::ground::tiles::{NO_TILE, TILES, tile_of, tile_rows};
use mluc_geometry::ground::{GROUND_HALF_M, lower_point};
use mluc_ipc_types::{POINTS_MAX, Point};
use mluc_kernels::at_best;
use smart_default::SmartDefault;

/// A point with its index in the scan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(16))] // Copied as a whole.
pub struct IndexedPoint {
    /// x, y, z, m.
    pub at_m: [f32; 3],
    /// Index into the scan.
    pub index: u32,
}

/// The points of a scan, by tile.
#[derive(Debug, SmartDefault)]
pub struct FrameIndex {
    /// First slot of each tile, and one past the last.
    #[default(vec![0; TILES + 1])]
    tile_first: Vec<u32>,
    /// The tile of each point of the scan.
    #[default(Vec::with_capacity(POINTS_MAX))]
    tiles: Vec<u32>,
    #[default(Vec::with_capacity(POINTS_MAX))]
    slots: Vec<IndexedPoint>,
    /// Points with NaN or infinity.
    pub not_finite: u32,
}

impl FrameIndex {
    /// Sorts the scan; points beyond [`POINTS_MAX`] are left out.
    pub fn sort(&mut self, scan: &[Point]) {
        let scan = &scan[..scan.len().min(POINTS_MAX)];
        self.count_tiles(scan);
        self.fill_slots(scan);
    }

    fn count_tiles(&mut self, scan: &[Point]) {
        // Every tile is overwritten.
        self.tiles.resize(scan.len(), NO_TILE);
        let tiles = &mut self.tiles;
        at_best!(tiles_of(scan, tiles));
        self.not_finite = 0;
        self.tile_first.fill(0);
        for (point, &tile) in scan.iter().zip(&self.tiles) {
            if tile == NO_TILE {
                let at_m = [point.x_m, point.y_m, point.z_m];
                self.not_finite += u32::from(!at_m.iter().all(|v| v.is_finite()));
            } else {
                self.tile_first[tile as usize] += 1;
            }
        }
        let mut sum = 0;
        for first in &mut self.tile_first {
            sum += *first;
            *first = sum;
        }
    }

    /// Fills the slots from the last point on. `tile_first` has the end of each tile before, and its first slot afterwards.
    fn fill_slots(&mut self, scan: &[Point]) {
        // Every slot is overwritten.
        let count = self.tile_first[TILES] as usize;
        self.slots.resize(count, IndexedPoint::default());
        for (index, (point, &tile)) in scan.iter().zip(&self.tiles).enumerate().rev() {
            if tile != NO_TILE {
                let slot = &mut self.tile_first[tile as usize];
                *slot -= 1;
                self.slots[*slot as usize] =
                    IndexedPoint { at_m: [point.x_m, point.y_m, point.z_m], index: index as u32 };
            }
        }
    }

    pub(crate) fn points(&self) -> &[IndexedPoint] {
        &self.slots
    }

    /// The points of a tile.
    pub(crate) fn points_in(&self, tile: usize) -> &[IndexedPoint] {
        &self.slots[self.tile_first[tile] as usize..self.tile_first[tile + 1] as usize]
    }

    /// The lowest point of every tile in the area of the ground grid.
    pub(crate) fn lowest(&self) -> impl Iterator<Item = [f32; 3]> {
        let tiles = tile_rows([0.0; 2], GROUND_HALF_M.into()).flatten();
        tiles.filter_map(|tile| {
            let points = self.points_in(tile).iter().map(|point| point.at_m);
            // The height alone is compared first: comparing whole points costs three times as much.
            let z = points.clone().map(|[_, _, z]| z).fold(f32::INFINITY, lower);
            points.filter(|point| point[2] == z).reduce(lower_point)
        })
    }

    #[cfg(test)]
    pub(crate) fn occupied_tiles(&self) -> impl Iterator<Item = usize> {
        let ends = self.tile_first.windows(2).enumerate();
        ends.filter_map(|(tile, ends)| (ends[0] < ends[1]).then_some(tile))
    }

    /// The points of the tiles that a square (centre and half side, m) touches, row by row: at least all points inside it.
    pub fn rows_around(
        &self,
        center_m: [f64; 2],
        half_side_m: f64,
    ) -> impl Iterator<Item = &[IndexedPoint]> {
        tile_rows(center_m, half_side_m).map(|tiles| {
            let [first, end] = [tiles.start, tiles.end].map(|tile| self.tile_first[tile] as usize);
            &self.slots[first..end]
        })
    }
}

/// The tile of each point.
#[inline(always)]
fn tiles_of(points: &[Point], tiles: &mut [u32]) {
    for (tile, point) in tiles.iter_mut().zip(points) {
        *tile = tile_of([point.x_m, point.y_m, point.z_m]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{point, sorted};

    /// Points around a place.
    fn found(frame: &FrameIndex, center_m: [f64; 2], half_side_m: f64) -> Vec<u32> {
        frame.rows_around(center_m, half_side_m).flatten().map(|p| p.index).collect()
    }

    #[test]
    fn points_are_found_by_tile_and_those_not_finite_are_counted() {
        let scan = [
            [10.2, 0.0, 1.0],
            [10.8, 0.4, -1.0],
            [50.0, 0.0, 0.0],
            [f32::NAN, 0.0, 0.0],
            [10.0, 0.0, f32::INFINITY],
            [500.0, 0.0, 0.0],
        ]
        .map(point);
        let mut frame = sorted(&scan);
        assert_eq!(found(&frame, [10.0, 0.0], 2.0), [0, 1]);
        let lowest: Vec<_> = frame.lowest().collect();
        assert_eq!(lowest, [[10.8, 0.4, -1.0], [50.0, 0.0, 0.0]]);
        for (center_m, half_side_m) in [([f64::NAN, 0.0], 2.0), ([0.0, 0.0], -1.0)] {
            assert!(found(&frame, center_m, half_side_m).is_empty());
        }
        assert_eq!(frame.not_finite, 2);
        frame.sort(&vec![point([10.0, 1.0, 0.0]); POINTS_MAX + 7]);
        assert_eq!(found(&frame, [10.0, 1.0], 1.0).len(), POINTS_MAX);
    }

    #[test]
    fn every_point_is_found_once_whatever_the_last_frame_was() {
        let places = (0..4000).map(|i| i as f32);
        let places = places.map(|i| [i * 0.37 % 60.0 - 30.0, i * 0.91 % 50.0 - 25.0, i * 1e-3]);
        let scan: Vec<Point> = places.map(point).collect();
        let mut used = sorted(&scan);
        let mut all = found(&used, [0.0, 0.0], 40.0);
        all.sort_unstable();
        assert!(all.into_iter().eq(0..4000));
        for some in scan.chunks(1300) {
            let fresh = sorted(some);
            used.sort(some);
            let own = found(&fresh, [20.0, 10.0], 12.0);
            assert!(!own.is_empty());
            assert_eq!(own, found(&used, [20.0, 10.0], 12.0));
            assert!(fresh.occupied_tiles().eq(used.occupied_tiles()));
        }
    }
}
