//! How well each score of a kept box tells unknown objects from known ones, and from background, whatever the threshold.

use super::DetectedFrame;
use super::mahalanobis::mahalanobis;
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

/// Figures of one score over the boxes that lie on a label, and over those that touch none.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ScoreSeparation {
    /// `e` (normalised EDS), `e_perp`, `delta`, `msp` (largest probability), `max_logit`, `energy`, `mahalanobis`.
    pub score: &'static str,
    /// Chance that an unknown object's box looks more unknown than a known one's, 0..1; none without both kinds.
    pub auroc: Option<f64>,
    /// Part of the known called unknown where 95 % of the unknown are, 0..1.
    pub fpr95: Option<f64>,
    /// Chance that an unknown object's box looks more unknown than one that touches no label, 0..1. Where a score also ranks the
    /// unknown, as the paper's does, AP needs this one to be high.
    pub auroc_background: Option<f64>,
    /// Boxes on known labels.
    pub known: usize,
    /// Boxes on unknown labels.
    pub unknown: usize,
    /// Boxes that touch no label.
    pub background: usize,
}

/// The figures of every score. A label that counts at moderate takes the box of the highest objectness that overlaps it
/// by more than its rule asks, whatever the box's class; a box serves one label.
pub fn separation(frames: &[DetectedFrame], rules: &[ClassRule]) -> Vec<ScoreSeparation> {
    let boxes: Vec<JudgedBox> = frames
        .iter()
        .enumerate()
        .flat_map(|(frame, detected)| judged_boxes(frame, detected, rules))
        .collect();
    let distances = mahalanobis(&boxes);
    let figures = |score: &'static str, values: Vec<f64>| {
        let side = |kind: Option<Kind>| -> Vec<f64> {
            let pairs = boxes.iter().zip(&values);
            pairs
                .filter(|(b, _)| b.rule.map(|rule| rule.kind) == kind)
                .map(|(_, v)| *v)
                .collect()
        };
        let [k, u, b] = [Some(Kind::Known), Some(Kind::Unknown), None].map(side);
        ScoreSeparation {
            score,
            auroc: auroc(&k, &u),
            fpr95: fpr95(&k, &u),
            auroc_background: auroc(&b, &u),
            known: k.len(),
            unknown: u.len(),
            background: b.len(),
        }
    };
    let plain = SCORES.iter().map(|&(score, of)| {
        figures(
            score,
            boxes.iter().map(|b| f64::from(of(b.detection))).collect(),
        )
    });
    let mut all: Vec<ScoreSeparation> = plain.collect();
    all.push(figures("mahalanobis", distances));
    all
}

/// A box on a label that counts, or on nothing.
pub(super) struct JudgedBox<'a> {
    pub(super) frame: usize,
    pub(super) detection: &'a Detection,
    /// Of its label; none: it touches no label at all.
    pub(super) rule: Option<&'a ClassRule>,
}

fn judged_boxes<'a>(
    number: usize,
    frame: &'a DetectedFrame,
    rules: &'a [ClassRule],
) -> Vec<JudgedBox<'a>> {
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
            found.push(JudgedBox {
                frame: number,
                detection: &frame.detections[i],
                rule: Some(rule),
            });
        }
    }
    let labels: Vec<Box3> = frame
        .truth
        .labels
        .iter()
        .map(|label| label.camera_box.upright())
        .collect();
    let touches_none = |b: &Judged| labels.iter().all(|label| iou_3d(&b.upright, label) == 0.0);
    let background = boxes.iter().zip(&frame.detections).filter_map(|(b, d)| {
        touches_none(b.as_ref()?).then_some(JudgedBox {
            frame: number,
            detection: d,
            rule: None,
        })
    });
    found.extend(background);
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
