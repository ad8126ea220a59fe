//! One candidate: seed, cluster, box (paper algorithm 1, its body).

use mluc_geometry::Box3;
use mluc_ipc_types::{Fate, Object, POINTS_MAX};

use crate::ascending::Ascending;
use crate::cluster::{Bounds, Clusterer};
use crate::draft::Draft;
use crate::fit::{ClusterPoints, Fitter, Rectangle, footprint};
use crate::frame::{FrameIndex, IndexedPoint};
use crate::ground::GroundPlane;
use crate::neighbourhood::{Gather, Neighbourhood};
use crate::recipe::{Recipe, SeedRule, clusterer};
use crate::refined::Counters;
use crate::seed::Seek;
use crate::settings::GroundSettings;
use crate::size::{is_rest, is_upright, is_within, longest_side};
use crate::{Sensor, Settings};

/// Work in points looked at, measured by time: of a candidate before any point, of a point in a growth, and of a point in
/// the box and its outline.
const WORK_PER_CANDIDATE: u64 = 4000;
const WORK_PER_GROWTH: u64 = 6;
/// No other seed is tried where those so far were as dear as a whole scan.
const WORK_PER_SEED_MAX: u64 = 131_072;
const WORK_PER_SHAPE: u64 = 12;
/// A cluster with less than one in so many of the points in the proposal's box is not what was detected there: it may be a few
/// returns from within a van, and the van's body lies around them. One in 5 is the same on simulated validation scans, one in 20 a
/// little less (docs/refiner.md).
const SPARSE_ONE_IN: usize = 10;

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

    /// Grows a cluster from seed after seed until one is large enough; of others the largest is taken.
    fn search(
        &mut self,
        on: &Scene,
        recipe: &Recipe,
        clusterer: &mut dyn Clusterer,
        draft: &Draft,
    ) -> Grown {
        let (mut grown, mut is_thinned, mut last) = (Grown::default(), false, None);
        let mut largest: Option<(usize, IndexedPoint)> = None;
        for _ in 0..recipe.seeds {
            let Some(seed) = self.next_seed(on, recipe, draft) else {
                break;
            };
            grown = self.grow_from(&seed, on, recipe, clusterer, &draft.shape);
            is_thinned |= grown.is_thinned;
            last = Some(seed.index);
            let found = self.members.len();
            let is_sparse = found * SPARSE_ONE_IN < grown.in_proposal;
            if found >= recipe.points_min && !is_sparse {
                largest = None;
                break;
            }
            if largest.is_none_or(|(most, _)| found > most) {
                largest = Some((found, seed));
            }
            if self.work > WORK_PER_SEED_MAX {
                break;
            }
            let index = |&m: &u32| self.around.index[m as usize];
            self.tried.extend(self.members.iter().map(index));
            self.tried.sort_unstable();
        }
        if let Some((most, seed)) = largest
            && most >= recipe.points_min
            && last != Some(seed.index)
        {
            grown = self.grow_from(&seed, on, recipe, clusterer, &draft.shape);
        }
        Grown {
            is_thinned,
            ..grown
        }
    }

    /// Where to begin, past what was tried.
    fn next_seed(&mut self, on: &Scene, recipe: &Recipe, draft: &Draft) -> Option<IndexedPoint> {
        let seek = Seek {
            frame: on.frame,
            candidate: &draft.shape,
            ground: on.ground,
            height_m: [self.ground.clearance_m, recipe.height_max_m],
            tried: &self.tried,
            is_known: if recipe.keeps_known_apart {
                on.is_known
            } else {
                &[]
            },
        };
        let (key, work) = ((on.sequence, draft.detection as u64), &mut self.work);
        match recipe.seed {
            SeedRule::RandomInside => seek.random_inside(key, &mut self.inside, work),
            SeedRule::NearestToCenter => seek.nearest_to_center(work),
        }
    }

    /// Gathers the points around a seed and grows its cluster among them.
    fn grow_from(
        &mut self,
        seed: &IndexedPoint,
        on: &Scene,
        recipe: &Recipe,
        clusterer: &mut dyn Clusterer,
        proposal: &Box3,
    ) -> Grown {
        let height_min_m = match clusterer.sees_ground() {
            true => f64::NEG_INFINITY,
            false => self.ground.clearance_m,
        };
        let wanted = Gather {
            radius_m: self.radius_m,
            height_m: [height_min_m, recipe.height_max_m],
            points_max: self.points_max,
        };
        let around = &mut self.around;
        let seed = around.gather(on.frame, seed, on.ground, &wanted, on.is_known);
        let tries = recipe.seeds > 1;
        self.work += around.looked_at + if tries { around.len() as u64 } else { 0 };
        let grown = Grown {
            seed_m: [around.x_m[seed], around.y_m[seed]],
            is_thinned: around.thinned,
            // One seed is taken as it comes.
            in_proposal: match tries {
                true => around.count_within(proposal),
                false => 0,
            },
        };
        self.grow(recipe, clusterer, seed);
        grown
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
            let is_small = is_within(&self.cluster, scales.upright_apart_m);
            seed = self.around.keep_only(&self.members, seed);
            self.grow_once(recipe, clusterer, seed, scales.upright);
            if self.cluster.len() >= recipe.points_min
                && is_upright(&self.cluster)
                && !(is_small && self.leaves_a_rest(recipe, clusterer))
            {
                return;
            }
            self.take_all();
        }
        let mut scale = 1.0;
        for _ in 0..scales.shrink_attempts {
            if scales.limits.hold(&self.cluster) {
                return;
            }
            scale *= scales.shrink_factor;
            seed = self.around.keep_only(&self.members, seed);
            self.grow_once(recipe, clusterer, seed, scale);
        }
    }

    /// Whether the other parts of the last cluster that do not stand upright are a thing to reckon with. Leaves the
    /// members as they are.
    fn leaves_a_rest(&mut self, recipe: &Recipe, clusterer: &mut dyn Clusterer) -> bool {
        let bounds = self.bounds(recipe, recipe.scales.map_or(1.0, |scales| scales.upright));
        let Candidates {
            around,
            members,
            part,
            cluster,
            is_seen,
            work,
            ..
        } = self;
        is_seen.clear();
        is_seen.resize(around.len(), false);
        members.iter().for_each(|&m| is_seen[m as usize] = true);
        let (mut upright, mut rest) = (members.len(), 0);
        clusterer.grow_rest(around, &bounds, is_seen, part, &mut |part| {
            *work += WORK_PER_GROWTH * around.len() as u64;
            if part.len() >= recipe.points_min {
                collect(around, part, cluster);
                match is_upright(cluster) {
                    true => upright += part.len(),
                    false => rest += part.len(),
                }
            }
        });
        self.collect_cluster();
        is_rest(rest, upright)
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
        let bounds = self.bounds(recipe, scale);
        clusterer.grow(&self.around, seed, &bounds, &mut self.members);
        self.collect_cluster();
        self.work += WORK_PER_GROWTH * self.around.len() as u64;
    }

    fn bounds(&self, recipe: &Recipe, scale: f64) -> Bounds {
        Bounds {
            height_min_m: match recipe.removes_ground {
                true => self.ground.clearance_m,
                false => f64::NEG_INFINITY,
            },
            scale,
        }
    }

    fn collect_cluster(&mut self) {
        collect(&self.around, &self.members, &mut self.cluster);
    }

    /// Box, outline and fate from the cluster.
    fn shape(
        &mut self,
        recipe: &Recipe,
        ground: &GroundPlane,
        seed_m: [f32; 2],
        draft: &mut Draft,
    ) {
        if self.cluster.len() < recipe.points_min.max(1) {
            draft.fate = Fate::TooFewPoints;
            return;
        }
        self.work += WORK_PER_SHAPE * self.cluster.len() as u64;
        let (mut rectangle, mut fitted) = self.fit(recipe, ground);
        if fitted.size_m[0] > self.length_max_m {
            let whole = self.cluster.len();
            self.keep_piece_around(seed_m);
            if self.cluster.len() < whole {
                (rectangle, fitted) = self.fit(recipe, ground);
                draft.flags |= Object::SPLIT;
            }
        }
        draft.shape = fitted;
        let (corners, count) = footprint(&self.cluster, &rectangle);
        draft.set_footprint(&corners[..count], self.around.origin_m);
    }

    fn fit(&mut self, recipe: &Recipe, ground: &GroundPlane) -> (Rectangle, Box3) {
        let rectangle = self.fitter.fit(recipe.fit, &self.cluster);
        let origin_m = self.around.origin_m;
        let extend = &recipe.extend;
        let fitted = extend.box_around(&self.cluster, &rectangle, origin_m, ground);
        // Only a cluster without points has no box, and such are told before.
        (rectangle, fitted.unwrap_or_else(|| Box3::new([0.0; 7])))
    }

    /// Of a cluster longer than any road user the piece around the seed: it is cut across its longest side into equal
    /// pieces of at most that length. What is cut off is no object of this candidate; it is there for others.
    fn keep_piece_around(&mut self, seed_m: [f32; 2]) {
        let (yaw_rad, length_m) = longest_side(&self.cluster);
        let along = [yaw_rad.cos() as f32, yaw_rad.sin() as f32];
        let [low, _] = self.cluster.span_m(along);
        let count = (length_m / self.length_max_m).ceil().max(1.0) as f32;
        let piece_m = length_m as f32 / count;
        let piece = |x: f32, y: f32| {
            let at = (x * along[0] + y * along[1] - low) / piece_m;
            (at as i32).clamp(0, count as i32 - 1)
        };
        let own = piece(seed_m[0], seed_m[1]);
        let around = &self.around;
        self.members
            .retain(|&m| piece(around.x_m[m as usize], around.y_m[m as usize]) == own);
        self.collect_cluster();
    }
}

/// The points of `members` by themselves.
fn collect(around: &Neighbourhood, members: &[u32], cluster: &mut ClusterPoints) {
    let columns = [
        (&mut cluster.x_m, &around.x_m),
        (&mut cluster.y_m, &around.y_m),
        (&mut cluster.z_m, &around.z_m),
    ];
    for (to, from) in columns {
        to.clear();
        to.extend(members.iter().map(|&m| from[m as usize]));
    }
    cluster.look_at(around.origin_m);
}
