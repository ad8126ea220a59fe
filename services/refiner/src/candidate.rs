//! One candidate: seed, cluster, box (paper algorithm 1, its body).

use mluc_geometry::Box3;
use mluc_ipc_types::Fate;

use crate::cluster::{Bounds, Clusterer};
use crate::draft::Draft;
use crate::fit::{
    BoxFit, Closeness, ClusterPoints, Rectangle, axis_aligned, footprint, minimum_area,
};
use crate::frame::{FrameIndex, IndexedPoint};
use crate::ground::GroundPlane;
use crate::neighbourhood::{Gather, Neighbourhood};
use crate::recipe::{Recipe, SeedRule, clusterer};
use crate::refined::Counters;
use crate::settings::GroundSettings;
use crate::size::{is_upright, is_within};
use crate::{Sensor, Settings, seed};

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
    closeness: Closeness,
    inside: Vec<IndexedPoint>,
    /// Points of clusters that were too small to be a thing.
    tried: Vec<u32>,
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
            closeness: Closeness::default(),
            inside: Vec::new(),
            tried: Vec::new(),
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
        let key = (sequence, draft.detection as u64);
        self.tried.clear();
        self.members.clear();
        self.cluster.clear();
        for _ in 0..recipe.seeds {
            let work = &mut counters.work_points;
            let Some(seed) = self.seed(frame, recipe, &draft.shape, &ground, key, work) else {
                break;
            };
            let seed = self.gather(frame, recipe, &*clusterer, &seed, &ground, is_known);
            counters.work_points += self.around.looked_at;
            counters.thinned += u32::from(self.around.thinned);
            self.grow(recipe, &mut *clusterer, seed);
            if self.members.len() >= recipe.points_min {
                break;
            }
            let index = |&m: &u32| self.around.index[m as usize];
            self.tried.extend(self.members.iter().map(index));
        }
        self.clusterer = Some(clusterer);
        self.shape(recipe, &ground, draft);
        let first = points.len();
        points.extend(self.members.iter().map(|&m| self.around.index[m as usize]));
        points[first..].sort_unstable();
        draft.points = (first, points.len());
    }

    fn ground_under(&self, frame: &FrameIndex, recipe: &Recipe, shape: &Box3) -> GroundPlane {
        let center = [shape.center_m[0], shape.center_m[1]];
        match recipe.removes_ground {
            true => GroundPlane::fit(frame, center, self.sensor_height_m, &self.ground),
            false => GroundPlane::flat(center, self.sensor_height_m),
        }
    }

    fn seed(
        &mut self,
        frame: &FrameIndex,
        recipe: &Recipe,
        shape: &Box3,
        ground: &GroundPlane,
        key: (u64, u64),
        work: &mut u64,
    ) -> Option<IndexedPoint> {
        match recipe.seed {
            SeedRule::RandomInside => {
                seed::random_inside(frame, shape, key, &mut self.inside, work)
            }
            SeedRule::NearestToCenter => {
                let heights = [self.ground.clearance_m, recipe.height_max_m];
                seed::nearest_to_center(frame, shape, ground, heights, &self.tried, work)
            }
        }
    }

    fn gather(
        &mut self,
        frame: &FrameIndex,
        recipe: &Recipe,
        clusterer: &dyn Clusterer,
        seed: &IndexedPoint,
        ground: &GroundPlane,
        is_known: &[bool],
    ) -> usize {
        let height_min_m = match clusterer.sees_ground() {
            true => f64::NEG_INFINITY,
            false => self.ground.clearance_m,
        };
        let wanted = Gather {
            radius_m: self.radius_m,
            height_m: [height_min_m, recipe.height_max_m],
            points_max: self.points_max,
        };
        self.around.gather(frame, seed, ground, &wanted, is_known)
    }

    /// Grows the cluster, and again with a shorter reach while it is larger than a road user. Part of it is taken when
    /// that stands upright by itself: people beside each other are joined otherwise.
    ///
    /// A shorter reach gives a part of what a longer one gives, so each growth looks at the last one's points alone.
    fn grow(&mut self, recipe: &Recipe, clusterer: &mut dyn Clusterer, mut seed: usize) {
        self.grow_once(recipe, clusterer, seed, 1.0);
        let Some(scales) = &recipe.scales else {
            return;
        };
        if scales.upright > 0.0 && !is_upright(&self.cluster) {
            seed = self.around.keep_only(&self.members, seed);
            self.grow_once(recipe, clusterer, seed, scales.upright);
            if self.cluster.len() >= recipe.points_min && is_upright(&self.cluster) {
                return;
            }
            self.take_all();
        }
        let mut scale = 1.0;
        for _ in 0..scales.shrink_attempts {
            if is_within(&self.cluster, scales.shrink_above_m) {
                return;
            }
            scale *= scales.shrink_factor;
            seed = self.around.keep_only(&self.members, seed);
            self.grow_once(recipe, clusterer, seed, scale);
        }
    }

    fn take_all(&mut self) {
        self.members.clear();
        self.members.extend(0..self.around.len() as u32);
        self.collect_cluster();
    }

    fn grow_once(
        &mut self,
        recipe: &Recipe,
        clusterer: &mut dyn Clusterer,
        seed: usize,
        scale: f64,
    ) {
        let bounds = Bounds {
            height_min_m: match recipe.removes_ground {
                true => self.ground.clearance_m,
                false => f64::NEG_INFINITY,
            },
            scale,
        };
        clusterer.grow(&self.around, seed, &bounds, &mut self.members);
        self.collect_cluster();
    }

    fn collect_cluster(&mut self) {
        self.cluster.clear();
        for &m in &self.members {
            let m = m as usize;
            self.cluster
                .push(self.around.x_m[m], self.around.y_m[m], self.around.z_m[m]);
        }
    }

    /// Box, outline and fate from the cluster.
    fn shape(&mut self, recipe: &Recipe, ground: &GroundPlane, draft: &mut Draft) {
        let enough = self.cluster.len() >= recipe.points_min.max(1);
        let rectangle = self.rectangle(recipe.fit);
        let origin_m = self.around.origin_m;
        let fitted = recipe
            .extend
            .box_around(&self.cluster, &rectangle, origin_m, ground);
        let (true, Some(fitted)) = (enough, fitted) else {
            draft.fate = Fate::TooFewPoints;
            return;
        };
        draft.shape = fitted;
        let (corners, count) = footprint(&self.cluster, &rectangle);
        draft.set_footprint(&corners[..count], origin_m);
        if draft.shape.size_m[0] > self.length_max_m {
            draft.fate = Fate::Oversized;
        }
    }

    fn rectangle(&mut self, fit: BoxFit) -> Rectangle {
        match fit {
            BoxFit::AxisAligned => axis_aligned(&self.cluster),
            BoxFit::MinimumArea => minimum_area(&self.cluster),
            BoxFit::Closeness => self.closeness.fit(&self.cluster),
        }
    }
}
