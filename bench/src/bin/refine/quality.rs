//! RefinerOutput boxes against labels.

use mluc_geometry::{Box3, iou_3d};
use mluc_refiner::{FrameIndex, Refiner, RefinerOutput};
use serde::Serialize;

use crate::ceiling;
use crate::proposals::{candidate, keyed, proposal};
use crate::scene::{self, Frame};

/// Proposals for each labelled object.
const PROPOSALS_PER_OBJECT: u64 = 8;
/// Points farther from an object than this along x or y are never looked at for its proposals, m: what is passed over is
/// the sorting alone.
const SURROUNDINGS_M: f32 = 30.0;

/// All figures of one labelled object.
pub(crate) struct Judged {
    pub(crate) class: String,
    pub(crate) ious: Vec<f64>,
    pub(crate) ceiling: f64,
    /// What its first proposal came to.
    pub(crate) first: Option<mluc_ipc_types::Object>,
}

/// Means over some objects.
#[derive(Default, Serialize)]
pub(crate) struct Quality {
    pub(crate) objects: usize,
    pub(crate) mean_iou_3d: f64,
    pub(crate) share_above_0_1: f64,
    pub(crate) share_above_0_3: f64,
    pub(crate) share_above_0_5: f64,
    pub(crate) ceiling_mean_iou_3d: f64,
}

/// Each proposal alone: what is judged is the box, not who suppresses whom.
pub(crate) fn judge(frames: &[Frame], refiner: &mut Refiner) -> Vec<Judged> {
    let mut out = RefinerOutput::default();
    let mut index = FrameIndex::default();
    let height_m = scene::sensor().height_m;
    let mut judged = Vec::new();
    let mut around = Vec::new();
    for frame in frames {
        for object in &frame.objects {
            let [x, y] = [object.shape.center_m[0], object.shape.center_m[1]].map(|v| v as f32);
            around.clear();
            around.extend(frame.points.iter().filter(|p| {
                (p.x_m - x).abs() < SURROUNDINGS_M && (p.y_m - y).abs() < SURROUNDINGS_M
            }));
            let mut first = None;
            let ious = (0..PROPOSALS_PER_OBJECT)
                .map(|k| {
                    let keys = [frame.number as u64, object.number as u64, k];
                    let mut random = keyed(keys);
                    let proposed = proposal(&object.class, &object.shape, &mut random);
                    let detections = [candidate(&proposed, 1.0)];
                    refiner.refine(frame.number as u64 * 8 + k, &around, &detections, &mut out);
                    first = first.or(out.objects.first().copied());
                    let published = out.objects.iter().find(|found| found.is_published());
                    published.map_or(0.0, |found| iou_3d(&box_of(found), &object.shape))
                })
                .collect();
            judged.push(Judged {
                class: object.class.clone(),
                first,
                ious,
                ceiling: ceiling::ceiling(&around, &object.shape, &mut index, height_m),
            });
        }
    }
    judged
}

pub(crate) fn box_of(object: &mluc_ipc_types::Object) -> Box3 {
    Box3 {
        center_m: object.center_m.map(f64::from),
        size_m: object.size_m.map(f64::from),
        yaw_rad: f64::from(object.yaw_rad),
    }
}

pub(crate) fn quality(objects: &[&Judged]) -> Quality {
    let ious: Vec<f64> = objects
        .iter()
        .flat_map(|o| o.ious.iter().copied())
        .collect();
    let count = ious.len().max(1) as f64;
    let above = |least: f64| ious.iter().filter(|&&iou| iou > least).count() as f64 / count;
    let ceilings: f64 = objects.iter().map(|o| o.ceiling).sum();
    Quality {
        objects: objects.len(),
        mean_iou_3d: ious.iter().sum::<f64>() / count,
        share_above_0_1: above(0.1),
        share_above_0_3: above(0.3),
        share_above_0_5: above(0.5),
        ceiling_mean_iou_3d: ceilings / objects.len().max(1) as f64,
    }
}
