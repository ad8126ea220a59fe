//! Refined boxes versus labels.

use crate::scene::{Frame, candidate};
use mluc_geometry::ground::{GroundGrid, ground_height_m};
use mluc_geometry::{Box3, iou_3d, mean_and_spread};
use mluc_refiner::fit::{Closeness, ClusterPoints, Extend};
use mluc_refiner::{Refiner, RefinerOutput, Settings};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Proposals per labelled object.
const PROPOSALS_PER_OBJECT: u64 = 8;
/// For an object's proposals the refiner gets the points up to this distance along x and y, m.
const SURROUNDINGS_M: f64 = 30.0;

pub(crate) struct Judged<'a> {
    class: &'a str,
    /// 3-D IoU of each refined box with the label; 0 for a proposal that is not published.
    ious: Vec<f64>,
    /// The IoU that the labelled points themselves reach.
    ceiling: f64,
}

/// Figures of all objects, and by class.
pub(crate) fn report(judged: &[Judged]) -> Value {
    let mut classes: BTreeMap<&str, Vec<&Judged>> = BTreeMap::new();
    for object in judged {
        classes.entry(object.class).or_default().push(object);
    }
    let mut all = figures(&judged.iter().collect::<Vec<_>>());
    all["by_class"] = classes.into_iter().map(|(class, own)| (class, figures(&own))).collect();
    all
}

fn figures(objects: &[&Judged]) -> Value {
    let ious: Vec<f64> = objects.iter().flat_map(|object| &object.ious).copied().collect();
    let above = |least: f64| {
        ious.iter().filter(|iou| **iou > least).count() as f64 / ious.len().max(1) as f64
    };
    let ceilings: Vec<f64> = objects.iter().map(|object| object.ceiling).collect();
    json!({
        "objects": objects.len(), "mean_iou_3d": mean_and_spread(&ious)[0],
        "share_above_0_1": above(0.1), "share_above_0_3": above(0.3), "share_above_0_5": above(0.5),
        "ceiling_mean_iou_3d": mean_and_spread(&ceilings)[0],
    })
}

/// Refines each proposal alone: the figures are about its box, not about what suppresses what.
pub(crate) fn judge<'a>(
    frames: &'a [Frame],
    refiner: &mut Refiner,
    sensor_height_m: f64,
) -> Vec<Judged<'a>> {
    let (mut out, mut ground) = (RefinerOutput::default(), GroundGrid::new(sensor_height_m));
    let mut judged = vec![];
    for frame in frames {
        for object in &frame.objects {
            let center_m = object.shape.center_m;
            let is_near =
                |p: &[f32; 4], i: usize| (f64::from(p[i]) - center_m[i]).abs() < SURROUNDINGS_M;
            let points = frame.points.iter().filter(|p| is_near(p, 0) && is_near(p, 1));
            let points: Vec<[f32; 4]> = points.copied().collect();
            let iou = |number| {
                let detections = [candidate(object, [frame.number, object.number, number], 1.0)];
                let sequence = frame.number * PROPOSALS_PER_OBJECT + number;
                refiner.refine(sequence, bytemuck::cast_slice(&points), &detections, &mut out);
                let published = out.objects.iter().find(|found| found.is_published());
                published.map_or(0.0, |found| {
                    let found = Box3::from_f32(found.center_m, found.size_m, found.yaw_rad);
                    iou_3d(&found, &object.shape)
                })
            };
            judged.push(Judged {
                class: &object.class,
                ious: (0..PROPOSALS_PER_OBJECT).map(iou).collect(),
                ceiling: ceiling(&points, &object.shape, ground.find(&points)),
            });
        }
    }
    judged
}

/// IoU of the closeness fit around an object's own points above the ground, extended to the ground.
fn ceiling(points: &[[f32; 4]], object: &Box3, ground_m: &[f32]) -> f64 {
    let clearance_m = Settings::default().ground_clearance_m;
    let [x_m, y_m, _] = object.center_m;
    let mut own = ClusterPoints::default();
    own.start([x_m, y_m]);
    for &[x, y, z, _] in points.iter().filter(|point| object.has_point(point)) {
        if f64::from(z - ground_height_m(ground_m, [x, y])) >= clearance_m {
            own.push((f64::from(x) - x_m) as f32, (f64::from(y) - y_m) as f32, z);
        }
    }
    let tight = Closeness::default().fit(&own);
    let extend = Extend { to_ground: true, completes: false, top_rad: None };
    extend.box_around(&own, &tight, ground_m).map_or(0.0, |fitted| iou_3d(&fitted, object))
}
