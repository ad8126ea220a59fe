//! How a variant gets from a scan and its proposals to clusters and their boxes; and the clusterer that clusters the scan once.

use crate::clusters::{ClusterFinder, FrameCluster, Matcher, Measures};
use crate::proposal::{NEAR_M, Proposal, reach_m};
use crate::{Sensor, Settings, frame::FrameIndex, output::Counters};
use mluc_geometry::ground::tiles::tile_rows;
use mluc_geometry::{Box3, iou_bev};
use mluc_ipc_types::{DETECTIONS_MAX, Disposition, Object, Point};

pub(crate) struct FrameTask<'a> {
    pub(crate) sequence: u64,
    pub(crate) scan: &'a [Point],
    pub(crate) frame: &'a FrameIndex,
    /// For each point, whether it belongs to a known object with a high score; for a variant that keeps such points apart.
    pub(crate) is_known: &'a [bool],
    /// The known objects with a high score: detection and box.
    pub(crate) known: &'a [(usize, Box3)],
    /// Points of all proposals, by their ranges.
    pub(crate) points: &'a mut Vec<u32>,
    pub(crate) counters: &'a mut Counters,
}

/// Finds the cluster of each proposal, and its box. By default proposals keep their boxes.
pub(crate) trait Clusterer: std::fmt::Debug + Send {
    /// Finds the ground of a frame, for a variant that has one.
    fn find_ground(&mut self, _frame: &FrameIndex) {}

    /// Finds the clusters near the candidates, for a variant that finds them together.
    fn find_clusters(&mut self, _task: &FrameTask, _proposals: &[Proposal]) {}

    /// Whether there is a cluster that a proposal is about; if not, the proposal gets the disposition that gives the reason.
    fn match_cluster(&mut self, _task: &mut FrameTask, _proposal: &mut Proposal) -> bool {
        true
    }

    /// Writes box, outline and points of the matched cluster into the proposal. Returns its measurements, if the variant takes any.
    fn lay_box(&mut self, _task: &mut FrameTask, _proposal: &mut Proposal) -> Option<Measures> {
        None
    }
}

/// Proposals keep their boxes.
#[derive(Debug)]
pub(crate) struct NoClusterer;

impl Clusterer for NoClusterer {}

/// Finds ground and clusters of the scan once; each proposal is matched to one of the clusters.
#[derive(Debug)]
pub(crate) struct ScanClusterer {
    finder: ClusterFinder,
    matcher: Matcher,
    /// The cluster of the current proposal.
    matched: usize,
    /// Clusters whose box was fitted in this frame.
    shaped: Vec<FrameCluster>,
    /// The index in `shaped` of each cluster.
    place: Vec<Option<u32>>,
}

/// Number of clusters for which memory is reserved: five times the clusters of a real scan of 120,000 points.
const CLUSTERS: usize = 1024;

impl ScanClusterer {
    pub(crate) fn new(settings: &Settings, sensor: &Sensor) -> ScanClusterer {
        ScanClusterer {
            finder: ClusterFinder::new(settings, sensor),
            matcher: Matcher::default(),
            matched: 0,
            shaped: Vec::with_capacity(DETECTIONS_MAX),
            place: Vec::with_capacity(CLUSTERS),
        }
    }

    /// Finds the clusters that have points in or near these tiles.
    fn cluster(&mut self, task: &FrameTask, tiles: impl Iterator<Item = usize>) {
        self.finder.cluster(task.frame, task.is_known, tiles);
        self.shaped.clear();
        self.place.clear();
        self.place.resize(self.finder.count(), None);
    }
}

impl Clusterer for ScanClusterer {
    fn find_ground(&mut self, frame: &FrameIndex) {
        self.finder.find_ground(frame);
    }

    /// Finds the clusters in the tiles in which the candidates look for their cluster.
    fn find_clusters(&mut self, task: &FrameTask, proposals: &[Proposal]) {
        let candidates = proposals.iter().filter(|p| p.is_standing());
        let around = candidates.flat_map(|candidate| {
            let [x, y, _] = candidate.shape.center_m;
            tile_rows([x, y], reach_m(&candidate.shape)).flatten()
        });
        self.cluster(task, around);
    }

    fn match_cluster(&mut self, task: &mut FrameTask, proposal: &mut Proposal) -> bool {
        let matched = self.matcher.find(&self.finder, &proposal.shape);
        let reach_m = matched.map_or(reach_m(&proposal.shape), |(_, distance_m)| distance_m);
        if reach_m > NEAR_M
            && let Some((by, distance_m)) = nearest_known(task.known, &proposal.shape)
            && (distance_m <= NEAR_M || (matched.is_some() && distance_m < reach_m))
        {
            // All points that the proposal is about belong to the known object.
            proposal.suppress(Disposition::OverlapsKnown, by, 1.0);
            return false;
        }
        match matched {
            Some((cluster, _)) => self.matched = cluster,
            None => proposal.disposition = Disposition::TooFewPoints,
        }
        matched.is_some()
    }

    /// Fits each cluster's box at most once.
    fn lay_box(&mut self, task: &mut FrameTask, proposal: &mut Proposal) -> Option<Measures> {
        let place = *self.place[self.matched].get_or_insert_with(|| {
            let shaped = (self.finder).shape(task.scan, self.matched, task.points);
            task.counters.work += shaped.points.len() as u64;
            self.shaped.push(shaped);
            self.shaped.len() as u32 - 1
        });
        let cluster = &self.shaped[place as usize];
        proposal.shape = cluster.shape;
        proposal.points = (cluster.points.start, cluster.points.end);
        proposal.footprint = cluster.footprint;
        if cluster.measures.is_cut {
            proposal.flags |= Object::SPLIT;
        }
        Some(cluster.measures)
    }
}

/// Of the known objects whose boxes overlap a proposal's, seen from above, the one nearest to its centre, and its distance, m.
fn nearest_known(known: &[(usize, Box3)], proposal: &Box3) -> Option<(usize, f64)> {
    let distance_m = |shape: &Box3| {
        let local = shape.local_m(proposal.center_m);
        let beyond = |axis: usize| (local[axis].abs() - shape.size_m[axis] / 2.0).max(0.0);
        beyond(0).hypot(beyond(1))
    };
    let touching = known.iter().filter(|(_, own)| iou_bev(own, proposal) > 0.0);
    let distances = touching.map(|(by, shape)| (*by, distance_m(shape)));
    distances.min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::Random;
    use mluc_ipc_types::{Detection, DetectionKind};
    use std::path::Path;

    /// Simulated scans that are bundled with the programs.
    const SCANS: [&str; 4] = [
        "services/mluc/assets/000010.bin.zst",
        "services/mluc/assets/000380.bin.zst",
        "tests/assets/kitti/000003.bin.zst",
        "tests/assets/kitti/000031.bin.zst",
    ];

    /// Candidates around random points of the scan.
    fn candidates(scan: &[Point], count: usize) -> Vec<Proposal> {
        let mut random = Random::from_state(3);
        let candidate = |index: usize| {
            let p = scan[random.below(scan.len())];
            let place_m = [p.x_m, p.y_m, p.z_m].map(|v| f64::from(v) + random.uniform(-0.8, 0.8));
            let detection = Detection {
                kind: DetectionKind::Candidate as u32,
                center_m: place_m.map(|v| v as f32),
                size_m: [12.0, 2.5, 1.6].map(|most| random.uniform(0.5, most) as f32),
                ..Detection::default()
            };
            let shape = crate::proposal::valid_box(&detection, 1).expect("a box");
            Proposal::of_detection(index, &detection, shape, 0.5)
        };
        (0..count).map(candidate).collect()
    }

    /// Each refined proposal, with its points and measurements.
    fn refined(
        clusterer: &mut ScanClusterer,
        task: &mut FrameTask,
        proposals: &[Proposal],
    ) -> Vec<(Object, Vec<u32>, Option<Measures>)> {
        task.points.clear();
        let mut one = |mut proposal: Proposal| {
            let is_matched = clusterer.match_cluster(task, &mut proposal);
            let lay_box = || clusterer.lay_box(task, &mut proposal);
            let measures = is_matched.then(lay_box).flatten();
            let (first, end) = proposal.points;
            let object = proposal.object(&Detection::default(), 1);
            (object, task.points[first..end].to_vec(), measures)
        };
        proposals.iter().map(|proposal| one(*proposal)).collect()
    }

    #[test]
    fn the_clusters_near_candidates_are_those_of_the_whole_scan() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let sensor = Sensor::plain(&["car"]);
        let [mut whole, mut near] =
            [(); 2].map(|()| ScanClusterer::new(&Settings::default(), &sensor));
        let mut matched = 0;
        for name in SCANS {
            let bytes = std::fs::read(root.join(name)).expect("a bundled scan");
            let scan = crate::testing::unpacked(&bytes);
            let frame = crate::testing::sorted(&scan);
            // The points of a corridor belong to a known object.
            let is_known: Vec<bool> = scan.iter().map(|p| (5.0..6.0).contains(&p.y_m)).collect();
            let mut task = FrameTask {
                sequence: 0,
                scan: &scan,
                frame: &frame,
                is_known: &is_known,
                known: &[(0, Box3::new([10.0, 5.5, 0.0, 30.0, 1.0, 3.0, 0.0]))],
                points: &mut Vec::new(),
                counters: &mut Counters::default(),
            };
            whole.find_ground(&frame);
            near.find_ground(&frame);
            for some in candidates(&scan, 120).chunks(6) {
                whole.cluster(&task, frame.occupied_tiles());
                near.find_clusters(&task, some);
                let expected = refined(&mut whole, &mut task, some);
                assert_eq!(refined(&mut near, &mut task, some), expected, "{name}");
                matched += expected.iter().filter(|(.., m)| m.is_some()).count();
            }
        }
        assert!(matched > 50, "{matched} of 480");
    }
}
