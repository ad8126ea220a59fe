//! Finds the cluster that a proposal is about.
//!
//! Proposals are off by up to a metre and have a wrong class's size. The cluster nearest to the proposal's centre is taken, close clusters first,
//! unless it is sparse: a few returns from inside a van are nearer to its centre than its body. The cost depends on the cells, not on their points.

use super::{ClusterFinder, NO_CLUSTER};
use crate::proposal::{NEAR_M, reach_m};
use mluc_geometry::{Box3, Inside};

/// A cluster with less than 1/10 of the points in the proposal's box is not the detected object. 1/5 and 1/20 give the
/// same results on simulated validation scans.
const SPARSE_ONE_IN: u32 = 10;
/// Number of clusters that are tried.
const TRIES: usize = 4;

/// A cluster near a proposal.
#[derive(Clone, Copy, Debug)]
struct Near {
    cluster: u32,
    /// Squared distance from the proposal's centre to the cluster's nearest cell, m^2: seen from above (`flat`) and in space (`full`).
    flat: f64,
    full: f64,
    /// Number of its points in the proposal's box.
    inside: u32,
}

/// Matches proposals; buffers are reused.
#[derive(Debug, Default)]
pub(crate) struct Matcher {
    near: Vec<Near>,
    /// Index in `near` of each cluster.
    place: Vec<u32>,
}

impl Matcher {
    /// The cluster that a proposal is about, and its distance from the proposal's centre, seen from above, m; `None` if none is within reach.
    pub(crate) fn find(&mut self, finder: &ClusterFinder, proposal: &Box3) -> Option<(usize, f64)> {
        self.collect(finder, proposal);
        let inside: u32 = self.near.iter().map(|near| near.inside).sum();
        let is_near = |near: &Near| near.flat <= NEAR_M * NEAR_M;
        self.near.sort_unstable_by(|a, b| {
            let by_distance = a.full.total_cmp(&b.full).then(a.cluster.cmp(&b.cluster));
            is_near(b).cmp(&is_near(a)).then(by_distance)
        });
        let tried = &self.near[..self.near.len().min(TRIES)];
        let is_dense = |near: &&Near| near.inside * SPARSE_ONE_IN >= inside;
        // Clusters are numbered by size, the largest first.
        let largest = || tried.iter().min_by_key(|near| near.cluster);
        let found = tried.iter().find(is_dense).or_else(largest)?;
        Some((found.cluster as usize, found.flat.sqrt()))
    }

    fn collect(&mut self, finder: &ClusterFinder, proposal: &Box3) {
        let [cx, cy, cz] = proposal.center_m;
        let reach_m = reach_m(proposal);
        let within = Inside::of(proposal, 0.0);
        let cells = &finder.cells;
        self.near.clear();
        self.place.clear();
        self.place.resize(finder.count(), NO_CLUSTER);
        for number in cells.around([cx, cy], reach_m) {
            let cluster = finder.cluster_of_cell[number as usize];
            if cluster == NO_CLUSTER {
                continue;
            }
            let cell = &cells.cells[number as usize];
            let [x0, y0, x1, y1] = cell.extent_m.map(f64::from);
            let [z0, z1] = cell.z_m.map(f64::from);
            let gap = |c: f64, low: f64, high: f64| (low - c).max(c - high).max(0.0);
            let (dx, dy, dz) = (gap(cx, x0, x1), gap(cy, y0, y1), gap(cz, z0, z1));
            let flat = dx * dx + dy * dy;
            if flat > reach_m * reach_m {
                continue;
            }
            let middle = [(x0 + x1) / 2.0, (y0 + y1) / 2.0, (z0 + z1) / 2.0];
            let is_inside = within.contains(middle);
            let place = &mut self.place[cluster as usize];
            if *place == NO_CLUSTER {
                *place = self.near.len() as u32;
                self.near.push(Near { cluster, flat, full: f64::INFINITY, inside: 0 });
            }
            let near = &mut self.near[*place as usize];
            near.flat = near.flat.min(flat);
            near.full = near.full.min(flat + dz * dz);
            near.inside += if is_inside { cell.count } else { 0 };
        }
    }
}
