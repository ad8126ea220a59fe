//! Refined boxes against labels.

use std::collections::BTreeMap;

use mluc_bench::inputs::{box_of, candidate, sensor};
use mluc_geometry::ground::{GroundGrid, ground_height_m};
use mluc_geometry::{Box3, iou_3d, mean_and_spread};
use mluc_ipc_types::Point;
use mluc_refiner::fit::{Closeness, ClusterPoints, Extend};
use mluc_refiner::{Refiner, RefinerOutput, Settings};
use serde_json::{Value, json};

use crate::scene::{Frame, inside, keyed, proposal};

/// Proposals for each labelled object.
const PROPOSALS_PER_OBJECT: u64 = 8;
/// Points farther from an object than this along x or y are never looked at for its proposals, m.
const SURROUNDINGS_M: f32 = 30.0;

pub(crate) struct Judged {
    pub(crate) class: String,
    /// Of each of its boxes with the label.
    pub(crate) ious: Vec<f64>,
    pub(crate) ceiling: f64,
}

/// Means over some objects.
fn overlaps(objects: &[&Judged]) -> Value {
    let ious: Vec<f64> = objects.iter().flat_map(|o| &o.ious).copied().collect();
    let count = ious.len().max(1) as f64;
    let above = |least: f64| ious.iter().filter(|&&iou| iou > least).count() as f64 / count;
    let ceilings: Vec<f64> = objects.iter().map(|o| o.ceiling).collect();
    json!({
        "objects": objects.len(), "mean_iou_3d": mean_and_spread(&ious)[0],
        "share_above_0_1": above(0.1), "share_above_0_3": above(0.3), "share_above_0_5": above(0.5),
        "ceiling_mean_iou_3d": mean_and_spread(&ceilings)[0],
    })
}

/// Of all objects, and by class.
pub(crate) fn quality(judged: &[Judged]) -> Value {
    let mut classes: BTreeMap<&str, Vec<&Judged>> = BTreeMap::new();
    for object in judged {
        classes.entry(&object.class).or_default().push(object);
    }
    let mut all = overlaps(&judged.iter().collect::<Vec<_>>());
    let by_class = classes.into_iter();
    all["by_class"] = by_class
        .map(|(class, own)| (class, overlaps(&own)))
        .collect();
    all
}

/// Each proposal alone: what is judged is the box, not who suppresses whom.
pub(crate) fn judge(frames: &[Frame], refiner: &mut Refiner) -> Vec<Judged> {
    let mut out = RefinerOutput::default();
    let mut ground = GroundGrid::new(sensor().height_m);
    let mut judged = Vec::new();
    let mut around = Vec::new();
    for frame in frames {
        for object in &frame.objects {
            let [x, y] = [object.shape.center_m[0], object.shape.center_m[1]].map(|v| v as f32);
            around.clear();
            around.extend(frame.points.iter().filter(|p| {
                (p.x_m - x).abs() < SURROUNDINGS_M && (p.y_m - y).abs() < SURROUNDINGS_M
            }));
            let ious = (0..PROPOSALS_PER_OBJECT)
                .map(|k| {
                    let mut random = keyed([frame.number as u64, object.number as u64, k]);
                    let proposed = proposal(&object.class, &object.shape, &mut random);
                    let detections = [candidate(&proposed, 1.0)];
                    refiner.refine(frame.number as u64 * 8 + k, &around, &detections, &mut out);
                    let published = out.objects.iter().find(|found| found.is_published());
                    published.map_or(0.0, |found| iou_3d(&box_of(found), &object.shape))
                })
                .collect();
            judged.push(Judged {
                class: object.class.clone(),
                ious,
                ceiling: ceiling(&around, &object.shape, &mut ground),
            });
        }
    }
    judged
}

/// What the labelled points reach: IoU of the L-shape around an object's own points above the ground, extended to the ground.
fn ceiling(points: &[Point], object: &Box3, ground: &mut GroundGrid) -> f64 {
    let clearance_m = Settings::default().ground_clearance_m;
    let center = [object.center_m[0], object.center_m[1]];
    let ground_m = ground.find(bytemuck::cast_slice(points));
    let mut own = ClusterPoints::default();
    own.start(center);
    for p in inside(points, object) {
        let height_m = p.z_m - ground_height_m(ground_m, [p.x_m, p.y_m]);
        if f64::from(height_m) >= clearance_m {
            let [x, y] = [p.x_m, p.y_m].map(f64::from);
            own.push((x - center[0]) as f32, (y - center[1]) as f32, p.z_m);
        }
    }
    let tight = Closeness::default().fit(&own);
    let fitted = Extend::TO_GROUND.box_around(&own, &tight, ground_m);
    fitted.map_or(0.0, |fitted| iou_3d(&fitted, object))
}
