//! Ground and clusters of a whole scan.
//!
//! One pass sorts the scan into cells of 1 m, planes every 8 m tell ground from what stands on it, cells of 25 cm that
//! lie within the join distance of each other are united, and what is larger than one thing can be is divided by shorter
//! reaches, at last by cutting. A cluster's box is laid when somebody asks for it.

mod cells;
mod cluster;
mod divide;
mod matching;
mod measure;
mod places;

pub use cluster::{FrameCluster, FrameClusters};
pub use divide::FrameCounters;
pub use measure::Measures;

use mluc_ipc_types::{POINTS_MAX, Point};

use crate::frame::FrameIndex;
use crate::ground_map::GroundMap;
use crate::{RefinerError, Sensor, Settings};
use cells::Cells;
use cluster::Shaper;
use divide::Divider;
pub(crate) use matching::{Matcher, NEAR_M};

/// No cluster.
pub const NO_CLUSTER: u32 = u32::MAX;

/// Finds the clusters of frame after frame; all buffers are made once.
#[derive(Debug)]
pub struct FrameClusterer {
    settings: Settings,
    sensor_height_m: f64,
    frame: FrameIndex,
    ground: GroundMap,
    cells: Cells,
    divider: Divider,
    shaper: Shaper,
    cluster_of_cell: Vec<u32>,
    counters: FrameCounters,
}

impl FrameClusterer {
    /// Refuses settings that make no sense.
    pub fn new(settings: &Settings, sensor: &Sensor) -> Result<FrameClusterer, RefinerError> {
        settings.check()?;
        Ok(FrameClusterer {
            sensor_height_m: sensor.height_m,
            frame: FrameIndex::default(),
            ground: GroundMap::default(),
            cells: Cells::default(),
            divider: Divider::new(settings.points_min as usize),
            shaper: Shaper::new(settings, sensor),
            cluster_of_cell: Vec::new(),
            counters: FrameCounters::default(),
            settings: settings.clone(),
        })
    }

    /// All clusters of one scan with their boxes, the ones with most points first.
    ///
    /// Points that are not finite, beyond 128 m or beyond the contract's limit are left out and counted.
    pub fn find(&mut self, points: &[Point], out: &mut FrameClusters) {
        out.clear();
        self.sort(points, FrameIndex::want_all);
        self.cluster(&[]);
        out.counters = self.counters;
        out.cluster_of_point.reserve(POINTS_MAX);
        out.cluster_of_point.resize(points.len(), NO_CLUSTER);
        for number in 0..self.divider.pieces().len() {
            let first = out.points.len();
            self.points_of(number, &mut out.points);
            let own = &out.points[first..];
            (own.iter()).for_each(|&i| out.cluster_of_point[i as usize] = number as u32);
            let range = first..out.points.len();
            let ranked = &self.divider.pieces()[number];
            out.clusters
                .push(self.shaper.shape(points, own, range, ranked, &self.ground));
        }
    }

    /// Sorts the points that `want` asks for into cells of 1 m.
    pub(crate) fn sort(&mut self, points: &[Point], want: impl FnOnce(&mut FrameIndex)) {
        self.frame.start();
        want(&mut self.frame);
        self.frame.sort(points);
    }

    /// What was sorted last.
    pub(crate) fn frame(&self) -> &FrameIndex {
        &self.frame
    }

    /// Ground and clusters of what was sorted last. `is_known` says of each point whether a known object owns it, or is
    /// empty: such points are in no cluster.
    pub(crate) fn cluster(&mut self, is_known: &[bool]) {
        self.ground.fit(&self.frame, self.sensor_height_m);
        self.counters = FrameCounters {
            points_not_finite: self.frame.not_finite,
            points_outside: self.frame.outside,
            ..FrameCounters::default()
        };
        self.collect_standing(is_known);
        let join_m = |range_m| self.settings.join_distance_m(range_m);
        self.divider
            .divide(&mut self.cells, join_m, &mut self.counters);
        self.cluster_of_cell.clear();
        self.cluster_of_cell
            .resize(self.cells.cells.len(), NO_CLUSTER);
        for (number, ranked) in self.divider.pieces().iter().enumerate() {
            for &cell in self.divider.cells_of(&ranked.piece) {
                self.cluster_of_cell[cell as usize] = number as u32;
            }
        }
    }

    /// The clusters' number.
    pub(crate) fn count(&self) -> usize {
        self.divider.pieces().len()
    }

    /// Appends the indices of a cluster's points, ascending.
    pub(crate) fn points_of(&mut self, number: usize, points: &mut Vec<u32>) {
        let first = points.len();
        let ranked = &self.divider.pieces()[number];
        for &cell in self.divider.cells_of(&ranked.piece) {
            points.extend_from_slice(&self.cells.indices[self.cells.points(cell)]);
        }
        self.cells.ascending.sort(&mut points[first..]);
    }

    /// Box, outline and measurements of a cluster with these points, as [`FrameClusterer::points_of`] gave them.
    pub(crate) fn shape(&mut self, scan: &[Point], number: usize, own: &[u32]) -> FrameCluster {
        let ranked = &self.divider.pieces()[number];
        self.shaper
            .shape(scan, own, 0..own.len(), ranked, &self.ground)
    }

    /// The ground of the last frame.
    pub fn ground(&self) -> &GroundMap {
        &self.ground
    }

    fn collect_standing(&mut self, is_known: &[bool]) {
        let low = self.settings.ground_clearance_m as f32;
        let high = self.settings.height_max_m as f32;
        let counters = &mut self.counters;
        self.cells.clear();
        let cells = &mut self.cells;
        self.ground.for_each_height(&self.frame, |point, height| {
            if height < low {
                counters.points_ground += 1;
            } else if height > high {
                counters.points_above += 1;
            } else if is_known.get(point.index as usize) == Some(&true) {
                counters.points_known += 1;
            } else {
                cells.add(point);
            }
        });
        self.cells.sort();
    }
}
