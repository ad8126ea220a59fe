//! The paper's variants: a cluster is grown for each candidate separately (the body of the paper's algorithm 1).

mod angle;
mod buckets;
pub mod grow;
mod neighbourhood;
mod seed;

pub use neighbourhood::Neighbourhood;

use crate::fit::{Fitter, Footprint};
use crate::{FrameIndex, clusters::Measures, frame::IndexedPoint, proposal::Proposal};
use crate::{Sensor, Settings, Variant, clusterer::Clusterer, clusterer::FrameTask};
use grow::{Depth, Grower, Growth, Printed};
use mluc_geometry::ground::GroundGrid;
use mluc_ipc_types::{Disposition, Object};
use seed::Seek;

/// Work of a candidate before any point is read; the unit is one read of a point, by measured time.
const WORK_PER_CANDIDATE: u64 = 4000;
/// Work of a point in a growth, in the same unit.
const WORK_PER_GROWTH: u64 = 6;
/// Work of a point in the box and its outline, in the same unit.
const WORK_PER_SHAPE: u64 = 12;

/// Grows the cluster of one candidate after the other; owns the buffers that they share.
#[derive(Debug)]
pub(crate) struct PaperClusterer {
    is_printed: bool,
    grower: Box<dyn Grower>,
    fitter: Fitter,
    /// The ground; level in the variant `paper`.
    ground: GroundGrid,
    radius_m: f64,
    /// Minimum height of points above the ground, m; minus infinity in the variant `paper`, which has no ground.
    height_min_m: f64,
    points_min: usize,
    around: Neighbourhood,
    members: Vec<u32>,
    inside: Vec<IndexedPoint>,
}

impl PaperClusterer {
    pub(crate) fn new(settings: &Settings, sensor: &Sensor) -> PaperClusterer {
        let is_printed = settings.variant == Variant::Paper;
        let grower: Box<dyn Grower> = if is_printed {
            Box::new(Printed::default())
        } else {
            Box::new(Depth::new(sensor.beams.as_ref()))
        };
        let (height_min_m, points_min) = if is_printed {
            (f64::NEG_INFINITY, 1)
        } else {
            (settings.ground_clearance_m, settings.points_min as usize)
        };
        PaperClusterer {
            is_printed,
            grower,
            fitter: Fitter::new(settings, sensor),
            ground: GroundGrid::new(sensor.height_m),
            // The paper's cylinder around the seed: 4 m in its industrial park, with a view all around; 5 m on KITTI, with a view ahead.
            radius_m: if sensor.sees_all_around { 4.0 } else { 5.0 },
            height_min_m,
            points_min,
            around: Neighbourhood::default(),
            members: Vec::new(),
            inside: Vec::new(),
        }
    }

    /// A random point inside the box (the variant `paper`), or the point nearest to its centre that stands on the ground.
    fn seed(&mut self, task: &mut FrameTask, proposal: &Proposal) -> Option<IndexedPoint> {
        let work = &mut task.counters.work;
        let seek = Seek {
            frame: task.frame,
            candidate: &proposal.shape,
            ground_m: self.ground.heights_m(),
            height_min_m: self.height_min_m,
        };
        if self.is_printed {
            let key = (task.sequence, proposal.detection as u64);
            seek.random_inside(key, &mut self.inside, work)
        } else {
            seek.nearest_to_center(work)
        }
    }
}

impl Clusterer for PaperClusterer {
    /// Finds the ground, except in the variant `paper`, which has none.
    fn find_ground(&mut self, frame: &FrameIndex) {
        if !self.is_printed {
            self.ground.find_under(frame.lowest());
        }
    }

    /// Gathers the points around a seed, with ground points as borders between objects, and grows the cluster among them.
    fn match_cluster(&mut self, task: &mut FrameTask, proposal: &mut Proposal) -> bool {
        self.members.clear();
        task.counters.work += WORK_PER_CANDIDATE;
        if let Some(seed) = self.seed(task, proposal) {
            let around = &mut self.around;
            let growth = Growth {
                seed: around.gather(task.frame, &seed, self.ground.heights_m(), self.radius_m),
                around,
                height_min_m: self.height_min_m,
            };
            self.grower.grow(&growth, &mut self.members);
            task.counters.work += around.looked_at + WORK_PER_GROWTH * around.len() as u64;
            if around.thinned {
                proposal.flags |= Object::THINNED;
                task.counters.thinned += 1;
            }
        }
        let first = task.points.len();
        let members = self.members.iter().map(|&m| self.around.index[m as usize]);
        task.points.extend(members);
        task.points[first..].sort_unstable();
        proposal.points = (first, task.points.len());
        let is_cluster = self.members.len() >= self.points_min;
        if !is_cluster {
            proposal.disposition = Disposition::TooFewPoints;
        }
        is_cluster
    }

    fn lay_box(&mut self, task: &mut FrameTask, proposal: &mut Proposal) -> Option<Measures> {
        task.counters.work += WORK_PER_SHAPE * self.members.len() as u64;
        let (around, points) = (&self.around, &mut self.fitter.points);
        points.start(around.origin_m);
        for &member in &self.members {
            let at = member as usize;
            points.push(around.x_m[at], around.y_m[at], around.z_m[at]);
        }
        let (shape, tight) = self.fitter.fit(self.ground.heights_m());
        proposal.shape = shape;
        proposal.footprint = Footprint::around(&self.fitter.points, &tight);
        None
    }
}
