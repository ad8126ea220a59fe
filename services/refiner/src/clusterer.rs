//! A variant's way from a scan and its proposals to clusters, and the way that clusters the scan once.

use mluc_geometry::Box3;
use mluc_ipc_types::{DETECTIONS_MAX, Disposition, Object, Point};

use crate::clusters::{FrameCluster, FrameClusterer, Matcher, Measures, NEAR_M};
use crate::frame::FrameIndex;
use crate::output::Counters;
use crate::proposal::Proposal;
use crate::{RefinerError, Sensor, Settings};

/// One frame.
pub(crate) struct FrameInput<'a> {
    pub(crate) sequence: u64,
    pub(crate) scan: &'a [Point],
    /// Of each point whether a known object of a high score owns it, where a variant keeps them apart.
    pub(crate) is_known: &'a [bool],
    /// Those known objects: detection and box.
    pub(crate) known: &'a [(usize, Box3)],
}

/// Finds the cluster of each proposal.
pub(crate) trait Clusterer: std::fmt::Debug + Send {
    /// Sorts the points that the proposals may be about; those of known objects alone when nothing will be clustered.
    fn sort(&mut self, input: &FrameInput, proposals: &[Proposal], is_clustered: bool);

    /// What was sorted.
    fn frame(&self) -> &FrameIndex;

    /// Ground and clusters of the sorted scan, for a variant that finds them all at once.
    fn cluster_scan(&mut self, _input: &FrameInput) {}

    /// Puts box, outline and disposition of its cluster into the proposal; the cluster's points are appended to `points`.
    /// Measurements of it, where the variant takes any.
    fn refine(
        &mut self,
        input: &FrameInput,
        proposal: &mut Proposal,
        points: &mut Vec<u32>,
        counters: &mut Counters,
    ) -> Option<Measures>;
}

/// Ground and clusters of the scan once; each proposal is matched to one of them.
#[derive(Debug)]
pub(crate) struct ScanClusterer {
    clusterer: FrameClusterer,
    matcher: Matcher,
    /// Clusters whose box was laid in this frame, with the range of their points,
    shaped: Vec<(FrameCluster, (usize, usize))>,
    /// and the place of each cluster among them.
    place: Vec<Option<u32>>,
}

/// Clusters that memory is made for, five times those of a real scan of 120,000 points.
const CLUSTERS: usize = 1024;

impl ScanClusterer {
    pub(crate) fn new(settings: &Settings, sensor: &Sensor) -> Result<ScanClusterer, RefinerError> {
        Ok(ScanClusterer {
            clusterer: FrameClusterer::new(settings, sensor)?,
            matcher: Matcher::default(),
            shaped: Vec::with_capacity(DETECTIONS_MAX),
            place: Vec::with_capacity(CLUSTERS),
        })
    }

    /// The place of a cluster among those with a box.
    fn shape(
        &mut self,
        scan: &[Point],
        cluster: usize,
        points: &mut Vec<u32>,
        counters: &mut Counters,
    ) -> usize {
        if let Some(place) = self.place[cluster] {
            return place as usize;
        }
        let first = points.len();
        self.clusterer.points_of(cluster, points);
        counters.work += (points.len() - first) as u64;
        let shaped = self.clusterer.shape(scan, cluster, &points[first..]);
        self.place[cluster] = Some(self.shaped.len() as u32);
        self.shaped.push((shaped, (first, points.len())));
        self.shaped.len() - 1
    }
}

impl Clusterer for ScanClusterer {
    fn sort(&mut self, input: &FrameInput, proposals: &[Proposal], is_clustered: bool) {
        self.clusterer.sort(input.scan, |frame| {
            if is_clustered {
                frame.want_all();
            } else {
                frame.want_known(proposals);
            }
        });
    }

    fn frame(&self) -> &FrameIndex {
        self.clusterer.frame()
    }

    fn cluster_scan(&mut self, input: &FrameInput) {
        self.clusterer.cluster(input.is_known);
        self.shaped.clear();
        self.place.clear();
        self.place.resize(self.clusterer.count(), None);
    }

    fn refine(
        &mut self,
        input: &FrameInput,
        proposal: &mut Proposal,
        points: &mut Vec<u32>,
        counters: &mut Counters,
    ) -> Option<Measures> {
        let found = self.matcher.find(&self.clusterer, &proposal.shape);
        let known = nearest_known(input.known, &proposal.shape);
        let reach_m = found.map_or(Matcher::reach_m(&proposal.shape), |found| found.distance_m);
        if let Some((by, distance_m)) = known
            && reach_m > NEAR_M
            && (distance_m <= NEAR_M || distance_m < reach_m)
        {
            // All of the points that it is about are the known object's.
            proposal.suppress(Disposition::OverlapsKnown, by, 1.0);
            return None;
        }
        let Some(found) = found else {
            proposal.disposition = Disposition::TooFewPoints;
            return None;
        };
        let place = self.shape(input.scan, found.cluster, points, counters);
        let (cluster, range) = &self.shaped[place];
        proposal.shape = cluster.shape;
        proposal.points = *range;
        proposal.footprint_m = cluster.footprint_m;
        proposal.footprint_count = cluster.footprint_count;
        if cluster.measures.is_cut {
            proposal.flags |= Object::SPLIT;
            counters.split += 1;
        }
        Some(cluster.measures)
    }
}

/// Proposals keep their boxes.
#[derive(Debug, Default)]
pub(crate) struct NoClusterer {
    frame: FrameIndex,
}

impl Clusterer for NoClusterer {
    fn sort(&mut self, input: &FrameInput, proposals: &[Proposal], _is_clustered: bool) {
        self.frame.start();
        self.frame.want_known(proposals);
        self.frame.sort(input.scan);
    }

    fn frame(&self) -> &FrameIndex {
        &self.frame
    }

    fn refine(
        &mut self,
        _input: &FrameInput,
        _proposal: &mut Proposal,
        _points: &mut Vec<u32>,
        _counters: &mut Counters,
    ) -> Option<Measures> {
        None
    }
}

/// The known object whose box is nearest to a proposal's centre, seen from above, and its distance, m.
fn nearest_known(known: &[(usize, Box3)], proposal: &Box3) -> Option<(usize, f64)> {
    let distance_m = |shape: &Box3| {
        let local = shape.local_m(proposal.center_m);
        let beyond = |axis: usize| (local[axis].abs() - shape.size_m[axis] / 2.0).max(0.0);
        beyond(0).hypot(beyond(1))
    };
    let distances = known.iter().map(|(by, shape)| (*by, distance_m(shape)));
    distances.min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)))
}
