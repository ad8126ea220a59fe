//! How well each score of a kept box tells unknown from known objects, whatever the threshold.

use super::DetectedFrame;
use crate::evaluate::{
    ClassRule, Detection as Judged, Difficulty, Kind, SensorDetection, TruthFrame, auroc, fpr95,
};
use mluc_geometry::{Box3, iou_3d};
use mluc_head::Detection;

/// A score of a kept box, turned so that higher means more unknown.
type Score = (&'static str, fn(&Detection) -> f32);

/// Every score of the gate's input: EDS and its projected form (low between the prototypes), the distance to the nearest
/// prototype (high away from all), and the usual ones (low where the network is unsure).
const SCORES: [Score; 6] = [
    ("e", |d| -d.eds_normalised),
    ("e_perp", |d| -d.eds_perpendicular),
    ("delta", |d| d.delta),
    ("msp", |d| -d.softmax_max),
    ("max_logit", |d| -d.logit_max),
    ("energy", |d| -d.energy),
];

/// Figures of one score over the boxes that lie on a label.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ScoreSeparation {
    /// `e` (normalised EDS), `e_perp`, `delta`, `msp` (largest probability), `max_logit`, `energy`.
    pub score: &'static str,
    /// Chance that an unknown object's box looks more unknown than a known one's, 0..1; none without both kinds.
    pub auroc: Option<f64>,
    /// Part of the known called unknown where 95 % of the unknown are, 0..1.
    pub fpr95: Option<f64>,
    /// Boxes on known labels.
    pub known: usize,
    /// Boxes on unknown labels.
    pub unknown: usize,
}

/// The figures of every score. A label that counts at moderate takes the box of the highest objectness that overlaps it
/// by more than its rule asks, whatever the box's class; a box serves one label.
pub fn separation(frames: &[DetectedFrame], rules: &[ClassRule]) -> Vec<ScoreSeparation> {
    let (mut known, mut unknown) = (vec![], vec![]);
    for frame in frames {
        for (detection, kind) in boxes_on_labels(frame, rules) {
            match kind {
                Kind::Known => known.push(detection),
                Kind::Unknown => unknown.push(detection),
            }
        }
    }
    SCORES
        .iter()
        .map(|&(score, of)| {
            let values = |boxes: &[&Detection]| -> Vec<f64> {
                boxes.iter().map(|d| f64::from(of(d))).collect()
            };
            let (k, u) = (values(&known), values(&unknown));
            ScoreSeparation {
                score,
                auroc: auroc(&k, &u),
                fpr95: fpr95(&k, &u),
                known: k.len(),
                unknown: u.len(),
            }
        })
        .collect()
}

fn boxes_on_labels<'a>(
    frame: &'a DetectedFrame,
    rules: &[ClassRule],
) -> Vec<(&'a Detection, Kind)> {
    let boxes: Vec<Option<Judged>> = frame
        .detections
        .iter()
        .map(|d| frame.truth.view.detection(&plain(d)))
        .collect();
    let mut taken = vec![false; boxes.len()];
    let mut found = Vec::new();
    for (label, rule) in labels_that_count(&frame.truth, rules) {
        let hit = (0..boxes.len()).find(|&i| {
            let overlap = boxes[i].as_ref().map(|b| iou_3d(&b.upright, &label));
            !taken[i] && overlap.is_some_and(|overlap| overlap > rule.iou_min)
        });
        if let Some(i) = hit {
            taken[i] = true;
            found.push((&frame.detections[i], rule.kind));
        }
    }
    found
}

/// Labels that count at moderate, in file order: upright box and rule.
pub(super) fn labels_that_count<'a>(
    truth: &'a TruthFrame,
    rules: &'a [ClassRule],
) -> impl Iterator<Item = (Box3, &'a ClassRule)> {
    truth.labels.iter().filter_map(|label| {
        let rule = rules
            .iter()
            .find(|rule| rule.label_counts(label) == Some(true))?;
        let takes = Difficulty::Moderate.takes(label);
        takes.then(|| (label.camera_box.upright(), rule))
    })
}

/// The box alone, for its place in the camera frame.
fn plain(detection: &Detection) -> SensorDetection {
    SensorDetection {
        kind: Kind::Known,
        class: String::new(),
        score: 0.0,
        box_in_sensor: Box3 {
            center_m: detection.center_m.map(f64::from),
            size_m: detection.size_m.map(f64::from),
            yaw_rad: f64::from(detection.yaw_rad),
        },
    }
}
