//! From the divided cells to clusters with a box, an outline, points and measurements.

use std::ops::Range;

use mluc_geometry::Box3;
use mluc_ipc_types::{FOOTPRINT_MAX, Point};

use super::divide::{FrameCounters, RankedPiece};
use super::measure::{Measurer, Measures};
use crate::fit::{BoxFit, ClusterPoints, Extend, Fitter, footprint};
use crate::ground_map::GroundMap;
use crate::priors::extend_of;
use crate::{Sensor, Settings};

/// Something that stands on the ground.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameCluster {
    /// Around its points, down to the ground, completed away from the sensor; sensor frame, heading up to half a turn.
    pub shape: Box3,
    /// Its points: a range of [`FrameClusters::points`].
    pub points: Range<usize>,
    /// Convex outline seen from above, counter-clockwise, x and y in m.
    pub footprint_m: [[f32; 2]; FOOTPRINT_MAX],
    /// Corners of the outline in use.
    pub footprint_count: usize,
    /// For a classifier.
    pub measures: Measures,
}

impl FrameCluster {
    /// The outline's corners in use.
    pub fn footprint(&self) -> &[[f32; 2]] {
        &self.footprint_m[..self.footprint_count]
    }
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
    pub(super) fn clear(&mut self) {
        self.clusters.clear();
        self.points.clear();
        self.cluster_of_point.clear();
    }

    /// Indices of a cluster's points into the scan.
    pub fn points_of(&self, cluster: &FrameCluster) -> &[u32] {
        self.points.get(cluster.points.clone()).unwrap_or(&[])
    }
}

/// Lays boxes around pieces; holds the buffers.
#[derive(Debug)]
pub(super) struct Shaper {
    fit: BoxFit,
    extend: Extend,
    fitter: Fitter,
    measurer: Measurer,
    cluster: ClusterPoints,
}

impl Shaper {
    pub(super) fn new(settings: &Settings, sensor: &Sensor) -> Shaper {
        Shaper {
            fit: settings.box_fit(),
            extend: extend_of(settings, sensor),
            fitter: Fitter::default(),
            measurer: Measurer::new(sensor),
            cluster: ClusterPoints::default(),
        }
    }

    /// Box, outline and measurements of a piece, whose points are `own`; `points` is handed through.
    pub(super) fn shape(
        &mut self,
        scan: &[Point],
        own: &[u32],
        points: Range<usize>,
        ranked: &RankedPiece,
        ground: &GroundMap,
    ) -> FrameCluster {
        let origin_m = mean_m(scan, own);
        self.cluster.clear();
        self.cluster.look_at(origin_m);
        for p in own.iter().filter_map(|&index| scan.get(index as usize)) {
            let (x, y) = (
                f64::from(p.x_m) - origin_m[0],
                f64::from(p.y_m) - origin_m[1],
            );
            self.cluster.push(x as f32, y as f32, p.z_m);
        }
        let plane = ground.plane_at(origin_m);
        let tight = self.fitter.fit(self.fit, &self.cluster);
        let shape = (self.extend).box_around(&self.cluster, &tight, origin_m, &plane);
        let (corners, footprint_count) = footprint(&self.cluster, &tight);
        let mut measures = self
            .measurer
            .measure(&self.cluster, &tight, origin_m, &plane);
        measures.set_intensity(own.iter().filter_map(|&i| scan.get(i as usize)));
        measures.component_length_m = ranked.piece.component_length_m;
        measures.is_cut = ranked.piece.is_cut;
        FrameCluster {
            // Every piece has points: a box of no size never comes out.
            shape: shape.unwrap_or_else(|| Box3::new([0.0; 7])),
            points,
            footprint_m: corners
                .map(|c| [(c[0] + origin_m[0]) as f32, (c[1] + origin_m[1]) as f32]),
            footprint_count,
            measures,
        }
    }
}

/// Mean place of some points, m. Summed in whole millimetres, so that their order does not matter.
fn mean_m(scan: &[Point], own: &[u32]) -> [f64; 2] {
    let mut sum = [0i64; 2];
    for p in own.iter().filter_map(|&index| scan.get(index as usize)) {
        for (sum, v) in sum.iter_mut().zip([p.x_m, p.y_m]) {
            *sum += (v * 1000.0).round() as i64;
        }
    }
    sum.map(|sum| sum as f64 / 1000.0 / own.len().max(1) as f64)
}
