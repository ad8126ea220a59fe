//! Ground and clusters of a scan.
//!
//! One pass sorts the scan into tiles of 1 m. A surface under their lowest points separates the ground from the points that stand on it.
//! Cells of 25 cm within the join distance of each other are united. A component larger than one object can be is divided by shorter
//! join distances, at last by cutting. A cluster's box is fitted on request.
//!
//! The refiner only requests the clusters near its candidates: they are the same as in the whole scan, and tiles that no requested cluster
//! comes near are not processed.

mod cells;
mod divide;
mod matching;
mod measure;
mod places;

pub use measure::Measures;

use crate::frame::{FrameIndex, IndexedPoint};
use crate::{Sensor, Settings, fit::Fitter, fit::Footprint};
use cells::Cells;
use divide::Divider;
pub(crate) use matching::Matcher;
use measure::Measurer;
use mluc_geometry::Box3;
use mluc_geometry::{ground::GroundGrid, ground::ground_height_m, ground::tiles::low_corner_m};
use mluc_ipc_types::Point;
use std::ops::Range;

/// The number that means no cluster.
const NO_CLUSTER: u32 = u32::MAX;

/// A cluster of points that stand on the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameCluster {
    /// Box around its points, down to the ground, completed away from the sensor; sensor frame, heading ambiguous by half a turn.
    pub shape: Box3,
    /// Its points: a range of the frame's list of points.
    pub points: Range<usize>,
    /// Outline seen from above, in the sensor frame.
    pub footprint: Footprint,
    /// Measurements for a classifier.
    pub measures: Measures,
}

/// Finds clusters in the points of a frame.
#[derive(Debug)]
pub(crate) struct ClusterFinder {
    settings: Settings,
    ground: GroundGrid,
    cells: Cells,
    divider: Divider,
    fitter: Fitter,
    measurer: Measurer,
    cluster_of_cell: Vec<u32>,
    /// The points of one tile that stand on the ground.
    standing: Vec<IndexedPoint>,
}

impl ClusterFinder {
    pub(crate) fn new(settings: &Settings, sensor: &Sensor) -> ClusterFinder {
        ClusterFinder {
            ground: GroundGrid::new(sensor.height_m),
            cells: Cells::default(),
            divider: Divider::new(settings),
            fitter: Fitter::new(settings, sensor),
            measurer: Measurer::new(sensor),
            cluster_of_cell: Vec::new(),
            standing: Vec::new(),
            settings: settings.clone(),
        }
    }

    /// Finds the ground of a frame, and the step between its beams.
    pub(crate) fn find_ground(&mut self, frame: &FrameIndex) {
        self.ground.find_under(frame.lowest());
        self.measurer.look(frame.points());
    }

    /// Finds the clusters of all components that have points in one of these tiles: the same as in the whole frame. The ground must be found
    /// before. `is_known`: for each point, whether it belongs to a known object; may be empty. Such points are in no cluster.
    pub(crate) fn cluster(
        &mut self,
        frame: &FrameIndex,
        is_known: &[bool],
        tiles: impl Iterator<Item = usize>,
    ) {
        let ground_m = self.ground.heights_m();
        self.cells.clear();
        let low = self.settings.ground_clearance_m as f32;
        let high = self.settings.height_max_m as f32;
        let mut add = |cells: &mut Cells, tile: usize| {
            self.standing.clear();
            for (point, height) in heights(ground_m, frame, tile) {
                let is_known = || is_known.get(point.index as usize) == Some(&true);
                if height >= low && height <= high && !is_known() {
                    self.standing.push(*point);
                }
            }
            cells.add_tile(tile, &self.standing);
        };
        for tile in tiles {
            if !self.cells.has_tile(tile) {
                add(&mut self.cells, tile);
            }
        }
        // Neighbouring returns of a surface lie as far apart as the rays.
        let spread = f64::from(self.measurer.spread());
        self.divider.settings.join_per_range = self.settings.join_per_range * spread;
        self.divider.divide(&mut self.cells, add);
        self.cluster_of_cell.clear();
        (self.cluster_of_cell).resize(self.cells.cells.len(), NO_CLUSTER);
        for (number, piece) in self.divider.pieces().iter().enumerate() {
            for &cell in self.divider.cells_of(piece) {
                self.cluster_of_cell[cell as usize] = number as u32;
            }
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.divider.pieces().len()
    }

    /// Box, outline and measurements of a cluster. Appends the indices of its points to `points`, ascending.
    pub(crate) fn shape(
        &mut self,
        scan: &[Point],
        number: usize,
        points: &mut Vec<u32>,
    ) -> FrameCluster {
        let first = points.len();
        let piece = &self.divider.pieces()[number];
        for &cell in self.divider.cells_of(piece) {
            points.extend_from_slice(&self.cells.indices[self.cells.points(cell)]);
        }
        let own = &mut points[first..];
        own.sort_unstable();
        let origin_m = mean_m(scan, own);
        let cluster = &mut self.fitter.points;
        cluster.start(origin_m);
        for p in own.iter().filter_map(|&index| scan.get(index as usize)) {
            let x = f64::from(p.x_m) - origin_m[0];
            let y = f64::from(p.y_m) - origin_m[1];
            cluster.push(x as f32, y as f32, p.z_m);
        }
        let ground_m = self.ground.heights_m();
        let (shape, tight) = self.fitter.fit(ground_m);
        let cluster = &self.fitter.points;
        FrameCluster {
            shape,
            points: first..points.len(),
            footprint: Footprint::around(cluster, &tight),
            measures: Measures {
                component_length_m: piece.component_length_m,
                is_cut: piece.is_cut,
                ..self.measurer.measure(cluster, &tight, ground_m)
            },
        }
    }
}

/// The points of a tile with their heights above the ground, m.
fn heights<'a>(
    ground_m: &[f32],
    frame: &'a FrameIndex,
    tile: usize,
) -> impl Iterator<Item = (&'a IndexedPoint, f32)> + use<'a> {
    let [x, y] = low_corner_m(tile);
    // No node of the ground lies inside a tile, so the tile's corners define the ground in it.
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    let [a, b, c, d] = corners.map(|[u, v]| ground_height_m(ground_m, [x + u, y + v]));
    frame.points_in(tile).iter().map(move |point| {
        let at = point.at_m;
        let (u, v) = (at[0] - x, at[1] - y);
        let floor = a + u * (b - a) + v * (c - a + u * (d - c - b + a));
        (point, at[2] - floor)
    })
}

/// Mean x and y of some points, m. Summed in whole millimetres, so that their order does not matter.
fn mean_m(scan: &[Point], own: &[u32]) -> [f64; 2] {
    let mut sum = [0i64; 2];
    for p in own.iter().filter_map(|&index| scan.get(index as usize)) {
        for (sum, v) in sum.iter_mut().zip([p.x_m, p.y_m]) {
            *sum += (v * 1000.0).round() as i64;
        }
    }
    sum.map(|sum| sum as f64 / 1000.0 / own.len().max(1) as f64)
}
