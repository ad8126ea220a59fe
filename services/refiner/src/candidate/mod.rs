//! One candidate: seed, cluster, box (paper algorithm 1, its body).

mod grow;
mod search;
mod shape;

use mluc_geometry::Box3;
use mluc_ipc_types::{Object, POINTS_MAX};

use crate::ascending::Ascending;
use crate::cluster::Clusterer;
use crate::draft::Draft;
use crate::fit::{ClusterPoints, Fitter};
use crate::frame::{FrameIndex, IndexedPoint};
use crate::ground::GroundPlane;
use crate::neighbourhood::Neighbourhood;
use crate::recipe::{Recipe, clusterer};
use crate::refined::Counters;
use crate::settings::GroundSettings;
use crate::{Sensor, Settings};

/// Work in points looked at, measured by time, of a candidate before any point.
const WORK_PER_CANDIDATE: u64 = 4000;

/// Refines candidate after candidate; holds what they share.
#[derive(Debug)]
pub(crate) struct Candidates {
    clusterer: Option<Box<dyn Clusterer>>,
    ground: GroundSettings,
    sensor_height_m: f64,
    radius_m: f64,
    points_max: usize,
    length_max_m: f64,
    around: Neighbourhood,
    members: Vec<u32>,
    cluster: ClusterPoints,
    fitter: Fitter,
    inside: Vec<IndexedPoint>,
    /// Points of clusters that were too small to be a thing, or to be what was detected; ascending.
    tried: Vec<u32>,
    is_seen: Vec<bool>,
    /// One part of a cluster.
    part: Vec<u32>,
    ascending: Ascending,
    /// Work of the candidate at hand.
    work: u64,
}

/// Where a candidate is refined.
struct Scene<'a> {
    sequence: u64,
    frame: &'a FrameIndex,
    /// Of each point of the scan whether a known object owns it; empty: none does.
    is_known: &'a [bool],
    ground: &'a GroundPlane,
}

/// A cluster's beginning.
#[derive(Clone, Copy, Debug, Default)]
struct Grown {
    /// Of the seed among the points around it, m.
    seed_m: [f32; 2],
    is_thinned: bool,
    /// Points around the seed that lie in the proposal's box.
    in_proposal: usize,
}

impl Candidates {
    pub(crate) fn new(settings: &Settings, sensor: &Sensor, radius_m: f64) -> Candidates {
        Candidates {
            clusterer: clusterer(settings, sensor),
            ground: settings.ground.clone(),
            sensor_height_m: sensor.height_m,
            radius_m,
            points_max: settings.points_per_candidate_max as usize,
            length_max_m: settings.length_max_m,
            around: Neighbourhood::default(),
            members: Vec::new(),
            cluster: ClusterPoints::default(),
            fitter: Fitter::default(),
            inside: Vec::new(),
            tried: Vec::with_capacity(POINTS_MAX.min(settings.points_per_candidate_max as usize)),
            is_seen: Vec::new(),
            part: Vec::new(),
            ascending: Ascending::default(),
            work: 0,
        }
    }

    /// Whether candidates cost anything at all.
    pub(crate) fn is_needed(&self) -> bool {
        self.clusterer.is_some()
    }

    /// Puts the refined box, points and fate into the draft; its points are appended to `points`.
    pub(crate) fn refine(
        &mut self,
        sequence: u64,
        frame: &FrameIndex,
        is_known: &[bool],
        recipe: &Recipe,
        draft: &mut Draft,
        points: &mut Vec<u32>,
        counters: &mut Counters,
    ) {
        let Some(mut clusterer) = self.clusterer.take() else {
            return;
        };
        let ground = self.ground_under(frame, recipe, &draft.shape);
        self.work = WORK_PER_CANDIDATE;
        self.tried.clear();
        self.members.clear();
        self.cluster.clear();
        let on = Scene {
            sequence,
            frame,
            is_known,
            ground: &ground,
        };
        let grown = self.search(&on, recipe, &mut *clusterer, draft);
        self.clusterer = Some(clusterer);
        self.shape(recipe, &ground, grown.seed_m, draft);
        if grown.is_thinned {
            draft.flags |= Object::THINNED;
            counters.thinned += 1;
        }
        counters.split += u32::from(draft.flags & Object::SPLIT != 0);
        counters.work += std::mem::take(&mut self.work);
        let first = points.len();
        points.extend(self.members.iter().map(|&m| self.around.index[m as usize]));
        self.ascending.sort(&mut points[first..]);
        draft.points = (first, points.len());
    }

    fn ground_under(&self, frame: &FrameIndex, recipe: &Recipe, shape: &Box3) -> GroundPlane {
        let center = [shape.center_m[0], shape.center_m[1]];
        match recipe.removes_ground {
            true => GroundPlane::fit(frame, center, self.sensor_height_m, &self.ground),
            false => GroundPlane::flat(center, self.sensor_height_m),
        }
    }
}
