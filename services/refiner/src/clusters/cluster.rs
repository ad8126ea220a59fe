//! What is found: clusters with a box, an outline, points and measurements.

use std::ops::Range;

use mluc_geometry::Box3;
use mluc_ipc_types::Point;

use super::measure::Measures;
use crate::fit::Footprint;

/// Something that stands on the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameCluster {
    /// Around its points, down to the ground, completed away from the sensor; sensor frame, heading up to half a turn.
    pub shape: Box3,
    /// Its points: a range of [`FrameClusters::points`].
    pub points: Range<usize>,
    /// Seen from above, in the sensor frame.
    pub footprint: Footprint,
    /// For a classifier.
    pub measures: Measures,
}

/// All clusters of one frame; buffers are reused.
#[derive(Debug, Default)]
pub struct FrameClusters {
    /// Those with most points first.
    pub clusters: Vec<FrameCluster>,
    /// Indices into the scan, ascending within each cluster.
    pub points: Vec<u32>,
    /// For each point of the scan the number of its cluster, or [`NO_CLUSTER`](super::NO_CLUSTER).
    pub cluster_of_point: Vec<u32>,
    /// Counts.
    pub counters: FrameCounters,
}

impl FrameClusters {
    /// Indices of a cluster's points into the scan.
    pub fn points_of(&self, cluster: &FrameCluster) -> &[u32] {
        self.points.get(cluster.points.clone()).unwrap_or(&[])
    }
}

/// Where the points of a frame went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounters {
    /// Points with NaN or infinity.
    pub points_not_finite: u32,
    /// Points beyond 128 m, or beyond the contract's limit.
    pub points_outside: u32,
    /// Points of the ground.
    pub points_ground: u32,
    /// Points that hang higher than any road user is.
    pub points_above: u32,
    /// Points that a known object owns.
    pub points_known: u32,
    /// Points of clusters with too few of them.
    pub points_too_few: u32,
    /// Components at the full reach, before anything was divided.
    pub components: u32,
    /// Clusters with too few points.
    pub clusters_too_small: u32,
    /// Clusters longer than any road user, cut to size.
    pub oversized: u32,
    /// Clusters beyond the limit of 4096.
    pub clusters_dropped: u32,
}

/// Mean place of some points, m. Summed in whole millimetres, so that their order does not matter.
pub(super) fn mean_m(scan: &[Point], own: &[u32]) -> [f64; 2] {
    let mut sum = [0i64; 2];
    for p in own.iter().filter_map(|&index| scan.get(index as usize)) {
        for (sum, v) in sum.iter_mut().zip([p.x_m, p.y_m]) {
            *sum += (v * 1000.0).round() as i64;
        }
    }
    sum.map(|sum| sum as f64 / 1000.0 / own.len().max(1) as f64)
}
