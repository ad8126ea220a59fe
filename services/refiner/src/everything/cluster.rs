//! From the divided cells to clusters with a box, an outline, points and measurements.

use std::ops::Range;

use mluc_geometry::Box3;
use mluc_ipc_types::{FOOTPRINT_MAX, POINTS_MAX, Point};

use super::NO_CLUSTER;
use super::cells::Cells;
use super::divide::{Divider, Piece};
use super::measure::{Measurer, Measures};
use crate::Sensor;
use crate::fit::{ClusterPoints, Fitter, footprint};
use crate::ground_map::GroundMap;
use crate::recipe::Recipe;

/// Clusters of one frame at most; those with the fewest points are dropped first, and counted.
const CLUSTERS_MAX: usize = 4096;

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

/// All clusters of one frame; buffers are reused.
#[derive(Debug, Default)]
pub struct FrameClusters {
    /// Those with most points first.
    pub clusters: Vec<FrameCluster>,
    /// Indices into the scan, ascending within each cluster.
    pub points: Vec<u32>,
    /// For each point of the scan the number of its cluster, or [`NO_CLUSTER`].
    pub cluster_of_point: Vec<u32>,
    /// Counts.
    pub counters: FrameCounters,
}

impl FrameClusters {
    pub(super) fn clear(&mut self) {
        self.clusters.clear();
        self.points.clear();
        self.cluster_of_point.clear();
        self.counters = FrameCounters::default();
    }

    /// Indices of a cluster's points into the scan.
    pub fn points_of(&self, cluster: &FrameCluster) -> &[u32] {
        self.points.get(cluster.points.clone()).unwrap_or(&[])
    }
}

/// Shapes the clusters of frame after frame.
#[derive(Debug)]
pub(super) struct Shaper {
    recipe: Recipe,
    fitter: Fitter,
    measurer: Measurer,
    cluster: ClusterPoints,
    ranked: Vec<Ranked>,
    cursors: Vec<u32>,
}

/// What orders clusters: points, then place.
#[derive(Clone, Copy, Debug)]
struct Ranked {
    points: u32,
    /// Lowest x, y and highest x, y, m.
    extent_m: [f32; 4],
    piece: Piece,
}

impl Shaper {
    pub(super) fn new(recipe: Recipe, sensor: &Sensor) -> Shaper {
        Shaper {
            recipe,
            fitter: Fitter::default(),
            measurer: Measurer::new(sensor),
            cluster: ClusterPoints::default(),
            ranked: Vec::with_capacity(CLUSTERS_MAX),
            cursors: Vec::with_capacity(CLUSTERS_MAX),
        }
    }

    /// Fills `out` with the divider's pieces.
    pub(super) fn shape(
        &mut self,
        scan: &[Point],
        cells: &Cells,
        divider: &Divider,
        ground: &GroundMap,
        out: &mut FrameClusters,
    ) {
        self.rank(cells, divider, out);
        self.hand_out_points(scan.len(), cells, divider, out);
        let mut first = 0;
        for at in 0..self.ranked.len() {
            let ranked = self.ranked[at];
            let points = first..first + ranked.points as usize;
            first = points.end;
            out.clusters
                .push(self.cluster(scan, &out.points, points, &ranked, ground));
        }
    }

    fn rank(&mut self, cells: &Cells, divider: &Divider, out: &mut FrameClusters) {
        self.ranked.clear();
        self.ranked.extend(divider.pieces().iter().map(|piece| {
            let own = divider.cells_of(piece);
            Ranked {
                points: cells.count(own) as u32,
                extent_m: cells.extent_m(own),
                piece: *piece,
            }
        }));
        self.ranked.sort_unstable_by(|a, b| {
            let places = || a.extent_m.partial_cmp(&b.extent_m);
            b.points
                .cmp(&a.points)
                .then_with(|| places().unwrap_or(std::cmp::Ordering::Equal))
        });
        let dropped = self.ranked.len().saturating_sub(CLUSTERS_MAX);
        out.counters.clusters_dropped = dropped as u32;
        self.ranked.truncate(CLUSTERS_MAX);
    }

    /// Sorts the points' indices by cluster, in the order of the scan.
    fn hand_out_points(
        &mut self,
        scan_points: usize,
        cells: &Cells,
        divider: &Divider,
        out: &mut FrameClusters,
    ) {
        out.cluster_of_point.reserve(POINTS_MAX);
        out.cluster_of_point.resize(scan_points, NO_CLUSTER);
        self.cursors.clear();
        let mut first = 0;
        for (number, ranked) in self.ranked.iter().enumerate() {
            self.cursors.push(first);
            first += ranked.points;
            for &cell in divider.cells_of(&ranked.piece) {
                for &index in &cells.indices[cells.points(cell)] {
                    out.cluster_of_point[index as usize] = number as u32;
                }
            }
        }
        out.points.resize(first as usize, 0);
        for (index, &number) in out.cluster_of_point.iter().enumerate() {
            if let Some(cursor) = self.cursors.get_mut(number as usize) {
                out.points[*cursor as usize] = index as u32;
                *cursor += 1;
            }
        }
    }

    fn cluster(
        &mut self,
        scan: &[Point],
        all_points: &[u32],
        points: Range<usize>,
        ranked: &Ranked,
        ground: &GroundMap,
    ) -> FrameCluster {
        let [x0, y0, x1, y1] = ranked.extent_m.map(f64::from);
        let origin_m = [(x0 + x1) / 2.0, (y0 + y1) / 2.0];
        let own = &all_points[points.clone()];
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
        let tight = self.fitter.fit(self.recipe.fit, &self.cluster);
        let extend = &self.recipe.extend;
        let shape = extend.box_around(&self.cluster, &tight, origin_m, &plane);
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
