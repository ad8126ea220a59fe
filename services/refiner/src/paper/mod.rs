//! The paper's variants: a cluster grown for each candidate by itself (paper algorithm 1, its body).

mod angle;
mod buckets;
pub mod grow;
mod neighbourhood;
mod seed;

pub use neighbourhood::{Gather, Neighbourhood};

use mluc_ipc_types::{Disposition, Object};

use crate::ascending::Ascending;
use crate::clusterer::{Clusterer, FrameInput};
use crate::clusters::Measures;
use crate::fit::{BoxFit, ClusterPoints, Extend, Fitter, footprint};
use crate::frame::{FrameIndex, IndexedPoint};
use crate::ground::{self, GroundPlane};
use crate::output::Counters;
use crate::priors::extend_of;
use crate::proposal::Proposal;
use crate::{Sensor, Settings, Variant};
use grow::{Depth, Grower, Printed};
use seed::Seek;

/// Work in points looked at, measured by time, of a candidate before any point,
const WORK_PER_CANDIDATE: u64 = 4000;
/// of a point in a growth,
const WORK_PER_GROWTH: u64 = 6;
/// and of a point in the box and its outline.
const WORK_PER_SHAPE: u64 = 12;
/// Points that one candidate may look at; beyond it they are thinned evenly, counted and flagged: a car at 4 m has some
/// 10,000.
const POINTS_MAX: usize = 16_384;

/// Refines candidate after candidate; holds what they share.
#[derive(Debug)]
pub(crate) struct PaperClusterer {
    is_printed: bool,
    grower: Box<dyn Grower>,
    fit: BoxFit,
    extend: Extend,
    sensor_height_m: f64,
    radius_m: f64,
    clearance_m: f64,
    points_min: usize,
    frame: FrameIndex,
    around: Neighbourhood,
    members: Vec<u32>,
    cluster: ClusterPoints,
    fitter: Fitter,
    inside: Vec<IndexedPoint>,
    ascending: Ascending,
}

impl PaperClusterer {
    pub(crate) fn new(settings: &Settings, sensor: &Sensor) -> PaperClusterer {
        let is_printed = settings.variant == Variant::Paper;
        PaperClusterer {
            is_printed,
            grower: if is_printed {
                Box::new(Printed::default())
            } else {
                Box::new(Depth::new(sensor.beams.as_ref()))
            },
            fit: settings.box_fit(),
            extend: extend_of(settings, sensor),
            sensor_height_m: sensor.height_m,
            radius_m: settings.radius_m(sensor),
            clearance_m: settings.ground_clearance_m,
            points_min: if is_printed {
                1
            } else {
                settings.points_min as usize
            },
            frame: FrameIndex::default(),
            around: Neighbourhood::default(),
            members: Vec::new(),
            cluster: ClusterPoints::default(),
            fitter: Fitter::default(),
            inside: Vec::new(),
            ascending: Ascending::default(),
        }
    }

    /// As printed, the ground is not looked for.
    fn ground_under(&self, proposal: &Proposal) -> GroundPlane {
        let [x, y, _] = proposal.shape.center_m;
        if self.is_printed {
            GroundPlane::flat([x, y], self.sensor_height_m)
        } else {
            GroundPlane::fit(&self.frame, [x, y], self.sensor_height_m)
        }
    }

    /// A random point inside the box (the paper), or the one nearest its centre that stands on the ground.
    fn seed(
        &mut self,
        sequence: u64,
        proposal: &Proposal,
        ground: &GroundPlane,
        work: &mut u64,
    ) -> Option<IndexedPoint> {
        let seek = Seek {
            frame: &self.frame,
            candidate: &proposal.shape,
            ground,
            height_m: [self.clearance_m, f64::INFINITY],
        };
        if self.is_printed {
            let key = (sequence, proposal.detection as u64);
            seek.random_inside(key, &mut self.inside, work)
        } else {
            seek.nearest_to_center(work)
        }
    }

    /// Gathers the points around a seed and grows its cluster among them.
    fn grow(&mut self, seed: &IndexedPoint, ground: &GroundPlane, work: &mut u64) {
        let height_min_m = if self.is_printed {
            f64::NEG_INFINITY
        } else {
            self.clearance_m
        };
        let wanted = Gather {
            radius_m: self.radius_m,
            height_m: [
                if self.grower.sees_ground() {
                    f64::NEG_INFINITY
                } else {
                    height_min_m
                },
                f64::INFINITY,
            ],
            points_max: POINTS_MAX,
        };
        let around = &mut self.around;
        let seed = around.gather(&self.frame, seed, ground, &wanted);
        self.grower
            .grow(around, seed, height_min_m, &mut self.members);
        *work += around.looked_at + WORK_PER_GROWTH * around.len() as u64;
        let cluster = &mut self.cluster;
        cluster.look_at(around.origin_m);
        for &member in &self.members {
            let at = member as usize;
            cluster.push(around.x_m[at], around.y_m[at], around.z_m[at]);
        }
    }
}

impl Clusterer for PaperClusterer {
    fn sort(&mut self, input: &FrameInput, proposals: &[Proposal], is_clustered: bool) {
        self.frame.start();
        for proposal in proposals.iter().filter(|p| p.is_standing() && is_clustered) {
            let [x, y, _] = proposal.shape.center_m;
            let reach_m = seed::reach_m(&proposal.shape) + self.radius_m;
            self.frame.want([x, y], reach_m.max(ground::RADIUS_M));
        }
        self.frame.want_known(proposals);
        self.frame.sort(input.scan);
    }

    fn frame(&self) -> &FrameIndex {
        &self.frame
    }

    fn refine(
        &mut self,
        input: &FrameInput,
        proposal: &mut Proposal,
        points: &mut Vec<u32>,
        counters: &mut Counters,
    ) -> Option<Measures> {
        let ground = self.ground_under(proposal);
        let mut work = WORK_PER_CANDIDATE;
        self.members.clear();
        self.cluster.clear();
        if let Some(seed) = self.seed(input.sequence, proposal, &ground, &mut work) {
            self.grow(&seed, &ground, &mut work);
            if self.around.thinned {
                proposal.flags |= Object::THINNED;
                counters.thinned += 1;
            }
        }
        if self.cluster.len() < self.points_min {
            proposal.disposition = Disposition::TooFewPoints;
        } else {
            work += WORK_PER_SHAPE * self.cluster.len() as u64;
            let tight = self.fitter.fit(self.fit, &self.cluster);
            let origin_m = self.around.origin_m;
            let fitted = (self.extend).box_around(&self.cluster, &tight, origin_m, &ground);
            // Only a cluster without points has no box.
            proposal.shape = fitted.unwrap_or(proposal.shape);
            let (corners, count) = footprint(&self.cluster, &tight);
            proposal.set_footprint(&corners[..count], origin_m);
        }
        counters.work += work;
        let first = points.len();
        points.extend(self.members.iter().map(|&m| self.around.index[m as usize]));
        self.ascending.sort(&mut points[first..]);
        proposal.points = (first, points.len());
        None
    }
}
