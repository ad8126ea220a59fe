//! Ours: boxes of the classes that the logit of the unknown doubts, boxes without a class, and clusters that nobody detected; each
//! refined by the range-scaled clustering, ranked by objectness x P(unknown) x cluster quality, within the sizes of road users.
//! A known object is removed only where the gate fires and P(unknown) is above one half.

use super::clusters::within_hull;
use super::refined::over_frames;
use super::{ClusterScorer, Input, MethodError, Swept, UnknownScore, unknown_probability};
use crate::evaluate::Kind;
use crate::pipeline::{FoundObject, THRESHOLDS};
use crate::train::clusters::ClusterNet;
use mluc_geometry::{Box3, intersection_bev_m2};
use mluc_head::Detection;
use mluc_ipc_types::{DetectionKind, Point};
use mluc_model::HeadKind;
use mluc_refiner::everything::{FrameCluster, FrameClusters};
use mluc_refiner::{Everything, Mode, Sensor, Settings};
use std::sync::{Mutex, PoisonError};

/// The levers, one by one.
#[derive(Clone, Debug, PartialEq)]
pub struct ImprovedSettings {
    /// The head's logit of the unknown; else the distance to the nearest prototype.
    pub logit: bool,
    /// Boxes of anchors without a class.
    pub generic: bool,
    /// Refine boxes by clustering; else the network's boxes stay.
    pub refine: Option<Mode>,
    /// Sizes of road users only.
    pub hull: bool,
    /// Rank boxes by the looks of the cluster that they lie on too.
    pub quality: bool,
    /// Clusters that nobody detected, with this weight beside detected ones; 0: none.
    pub cluster_weight: f32,
    /// How clusters are judged.
    pub clusters: ClusterScorer,
}

impl Default for ImprovedSettings {
    fn default() -> ImprovedSettings {
        ImprovedSettings {
            logit: true,
            generic: true,
            refine: Some(Mode::Distance),
            hull: true,
            quality: true,
            cluster_weight: 0.1,
            clusters: ClusterScorer::default(),
        }
    }
}

/// The ablation: every step adds one lever to the one before.
pub fn improved_steps() -> Vec<(&'static str, ImprovedSettings)> {
    let first = ImprovedSettings {
        logit: false,
        generic: false,
        refine: None,
        hull: false,
        quality: false,
        cluster_weight: 0.0,
        clusters: ClusterScorer::default(),
    };
    let all = ImprovedSettings::default();
    let logit = ImprovedSettings {
        logit: true,
        ..first.clone()
    };
    let generic = ImprovedSettings {
        generic: true,
        ..logit.clone()
    };
    let refine = ImprovedSettings {
        refine: all.refine,
        ..generic.clone()
    };
    let hull = ImprovedSettings {
        hull: true,
        ..refine.clone()
    };
    let quality = ImprovedSettings {
        quality: true,
        ..hull.clone()
    };
    vec![
        ("delta, boxes as they are", first),
        ("+ logit of the unknown", logit),
        ("+ anchors without a class", generic),
        ("+ range-scaled clustering", refine),
        ("+ sizes of road users", hull),
        ("+ looks of the cluster", quality),
        ("+ clusters nobody detected", all),
    ]
}

/// The looks of a box that lies on no cluster.
const NO_CLUSTER: f32 = 0.05;
/// Overlap (intersection over the smaller area) above which a cluster is one of the objects that there are.
const COVERED: f64 = 0.3;
/// The share of a gated box that another covers, above which the weaker goes.
const SAME: f64 = 0.5;

struct Levers<'a> {
    settings: &'a ImprovedSettings,
    classes: usize,
    has_logit: bool,
}

impl Levers<'_> {
    fn unknown(&self, d: &Detection) -> f32 {
        unknown_probability(d, self.classes, self.has_logit)
    }

    /// The box with its kind at a threshold on 1 - P(unknown); `None` for one without a class that is not unknown. A candidate
    /// carries its rank as objectness, and the embedding of the centre, whose factor in the refiner's ranking is 1.
    fn gate(&self, d: &Detection, is_generic: bool, threshold: f64) -> Option<Detection> {
        let unknown = self.unknown(d);
        let fires = f64::from(1.0 - unknown) < threshold && unknown > 0.5;
        match (fires, is_generic) {
            (false, true) => None,
            (false, false) => Some(Detection {
                kind: DetectionKind::Known as u32,
                ..*d
            }),
            (true, _) => Some(Detection {
                kind: DetectionKind::Candidate as u32,
                objectness: d.objectness * unknown,
                eds_normalised: 1.0,
                ..*d
            }),
        }
    }
}

pub(super) fn run(input: &Input, settings: &ImprovedSettings) -> Result<Swept, MethodError> {
    let manifest = &input.model.manifest;
    let levers = Levers {
        settings,
        classes: manifest.network.classes,
        has_logit: settings.logit && manifest.network.head == HeadKind::Open,
    };
    let known =
        |d: &Detection| f64::from(UnknownScore::Known.of(d, levers.classes, levers.has_logit));
    let boxes = input.frames.iter().flat_map(|frame| &frame.detections);
    // Above one half nothing fires any more.
    let mut values: Vec<f64> = boxes.map(known).filter(|v| *v < 0.5).collect();
    values.push(0.5);
    let thresholds = input.thresholds_over(&values, THRESHOLDS);
    let refiner = Settings {
        mode: settings.refine.unwrap_or(Mode::None),
        ..Settings::default()
    };
    let sensor = Sensor::from_manifest(manifest)?;
    let net = ClusterNet::read(&input.model.weights);
    let spare: Mutex<Vec<(Everything, FrameClusters)>> = Mutex::new(vec![]);
    let objects = over_frames(input, &refiner, |finder, frame, points| {
        let clusters = match settings.quality || settings.cluster_weight > 0.0 {
            true => clusters(&spare, &refiner, &sensor, settings, net.as_ref(), points)?,
            false => vec![],
        };
        let detected = &input.frames[frame];
        let first_generic = detected.detections.len() - detected.generic;
        let mut before: Option<(usize, Vec<FoundObject>)> = None;
        let at = |threshold: &f64| {
            let gated: Vec<Detection> = detected
                .detections
                .iter()
                .enumerate()
                .filter(|(i, _)| *i < first_generic || settings.generic)
                .filter_map(|(i, d)| levers.gate(d, i >= first_generic, *threshold))
                .collect();
            let count = gated.iter().filter(|d| d.is_candidate()).count();
            let found = match before.take() {
                Some((last, found)) if last == count && count > 0 => found,
                _ => {
                    let found = finder.objects_of(frame as u64, points, gated.into_iter());
                    levers.complete(found, &clusters, *threshold > 0.0)
                }
            };
            before = Some((count, found.clone()));
            found
        };
        Ok::<_, MethodError>(thresholds.iter().map(at).collect())
    })?;
    let objects: Result<Vec<_>, MethodError> = objects.into_iter().collect();
    Ok((thresholds, objects?))
}

/// Boxes and looks (0 to 1) of a frame's clusters of a road user's size.
fn clusters(
    spare: &Mutex<Vec<(Everything, FrameClusters)>>,
    refiner: &Settings,
    sensor: &Sensor,
    settings: &ImprovedSettings,
    net: Option<&ClusterNet>,
    points: &[Point],
) -> Result<Vec<FoundObject>, MethodError> {
    let lock = || spare.lock().unwrap_or_else(PoisonError::into_inner);
    let taken = lock().pop();
    let (mut everything, mut found) = match taken {
        Some(pair) => pair,
        None => (Everything::new(refiner, sensor)?, FrameClusters::default()),
    };
    everything.find(points, &mut found);
    let learned = net.map(|net| net.scores(found.clusters.iter().map(|c| &c.measures)));
    let object = |(i, cluster): (usize, &FrameCluster)| {
        let ([x, y, z], size) = (cluster.shape.center_m, cluster.shape.size_m);
        let size_m = size.map(|v| v as f32);
        let plain = settings.clusters.score(size_m, &cluster.measures);
        let score = match &learned {
            Some(scores) if within_hull(size_m) => scores[i],
            Some(_) => 0.0,
            None => plain,
        };
        let [l, w, h] = size;
        (score > 0.0).then(|| FoundObject {
            kind: Kind::Unknown,
            class_id: 0,
            score,
            bounds: [x, y, z, l, w, h, cluster.shape.yaw_rad].map(|v| v as f32),
        })
    };
    let objects = found
        .clusters
        .iter()
        .enumerate()
        .filter_map(object)
        .collect();
    lock().push((everything, found));
    Ok(objects)
}

impl Levers<'_> {
    /// What is published: sizes of road users, the best of each place, and clusters where nothing else is.
    fn complete(
        &self,
        found: Vec<FoundObject>,
        clusters: &[FoundObject],
        open: bool,
    ) -> Vec<FoundObject> {
        let fits = |o: &FoundObject| {
            let [.., l, w, h, _] = o.bounds;
            o.kind == Kind::Known || !self.settings.hull || within_hull([l, w, h])
        };
        let mut objects: Vec<FoundObject> = found.into_iter().filter(fits).collect();
        let unknown = objects.iter_mut().filter(|o| o.kind == Kind::Unknown);
        for object in unknown.filter(|_| self.settings.quality) {
            object.score *= looks(object, clusters);
        }
        suppress(&mut objects);
        let taken: Vec<Box3> = objects.iter().map(shape).collect();
        let free = |o: &&FoundObject| {
            let own = shape(o);
            open && taken.iter().all(|other| shared(&own, other) < COVERED)
        };
        let weight = self.settings.cluster_weight;
        let weighed = |o: &FoundObject| FoundObject {
            score: weight * o.score,
            ..*o
        };
        if weight > 0.0 {
            objects.extend(clusters.iter().filter(free).map(weighed));
        }
        objects
    }
}

/// The looks of the cluster that an object shares most with.
fn looks(object: &FoundObject, clusters: &[FoundObject]) -> f32 {
    let own = shape(object);
    let near = clusters.iter().map(|c| (shared(&own, &shape(c)), c.score));
    let best = near.reduce(|a, b| if b.0 > a.0 { b } else { a });
    match best {
        Some((share, score)) if share > COVERED => score.max(NO_CLUSTER),
        _ => NO_CLUSTER,
    }
}

/// Unknown objects that mostly cover a better one go.
fn suppress(objects: &mut Vec<FoundObject>) {
    let mut order: Vec<usize> = (0..objects.len())
        .filter(|i| objects[*i].kind == Kind::Unknown)
        .collect();
    order.sort_by(|a, b| {
        objects[*b]
            .score
            .total_cmp(&objects[*a].score)
            .then(a.cmp(b))
    });
    let mut kept: Vec<usize> = vec![];
    for i in order.iter().copied() {
        let own = shape(&objects[i]);
        if kept
            .iter()
            .all(|k| shared(&own, &shape(&objects[*k])) <= SAME)
        {
            kept.push(i);
        }
    }
    let mut at = 0..;
    objects.retain(|o| {
        let i = at.next().unwrap_or(0);
        o.kind == Kind::Known || kept.contains(&i)
    });
}

fn shape(object: &FoundObject) -> Box3 {
    Box3::new(object.bounds.map(f64::from))
}

/// Intersection over the smaller area, from above.
fn shared(a: &Box3, b: &Box3) -> f64 {
    let area = |b: &Box3| b.size_m[0] * b.size_m[1];
    intersection_bev_m2(a, b) / area(a).min(area(b)).max(1e-9)
}
