//! How well each score of a kept box separates unknown objects from known ones and from background, independent of the threshold.

use super::{DetectedFrame, box_of};
use crate::{ClassRule, Difficulty, ObjectKind, matching::in_dont_care, operating::DONT_CARE_MAX};
use mluc_geometry::{Box3, iou_3d};
use mluc_head::Detection;
use serde::{Deserialize, Serialize};

/// A score of a kept box, with its sign set so that higher means more unknown.
type Score = (&'static str, fn(&Detection) -> f32);

/// Every score of the gate's input: EDS and its projected form (low between the prototypes), the distance to the nearest
/// prototype (high away from all), and standard scores (low where the network is uncertain).
const SCORES: [Score; 6] = [
    ("e", |d| -d.eds_normalised),
    ("e_perp", |d| -d.eds_perpendicular),
    ("delta", |d| d.delta),
    ("msp", |d| -d.softmax_max),
    ("max_logit", |d| -d.logit_max),
    ("energy", |d| -d.energy),
];

/// Figures of one score over the boxes on a label and the boxes that touch no label.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ScoreSeparation {
    /// `e` (normalised EDS), `e_perp`, `delta`, `msp` (largest probability), `max_logit`, `energy`.
    pub score: String,
    /// Probability that an unknown object's box scores more unknown than a known object's, 0..1; none without both kinds.
    pub auroc: Option<f64>,
    /// Share of known boxes called unknown at the threshold where 95 % of the unknown boxes are, 0..1.
    pub fpr95: Option<f64>,
    /// Probability that an unknown object's box scores more unknown than a box that touches no label, 0..1. Where a score also ranks
    /// the unknown objects, as in the paper, a high AP needs a high value here.
    pub auroc_background: Option<f64>,
    /// Boxes on known labels.
    pub known: usize,
    /// Boxes on unknown labels.
    pub unknown: usize,
    /// Boxes that touch no label and are not in a region without labels.
    pub background: usize,
}

/// The figures of every score. A label that counts at moderate takes the box of the highest objectness that overlaps it
/// by more than its rule requires, whatever the box's class; a box matches one label.
pub fn separation(frames: &[DetectedFrame], rules: &[ClassRule]) -> Vec<ScoreSeparation> {
    let boxes = frames.iter().flat_map(|frame| judged_boxes(frame, rules));
    let boxes: Vec<JudgedBox> = boxes.collect();
    let figures = |score: &str, values: Vec<f64>| {
        let side = |kind: Option<ObjectKind>| -> Vec<f64> {
            let pairs = boxes.iter().zip(&values);
            pairs.filter(|(b, _)| b.rule.map(|rule| rule.kind) == kind).map(|(_, v)| *v).collect()
        };
        let [k, u, b] = [Some(ObjectKind::Known), Some(ObjectKind::Unknown), None].map(side);
        ScoreSeparation {
            score: score.to_owned(),
            auroc: auroc(&k, &u),
            fpr95: fpr95(&k, &u),
            auroc_background: auroc(&b, &u),
            known: k.len(),
            unknown: u.len(),
            background: b.len(),
        }
    };
    let all = SCORES.iter().map(|&(score, of)| {
        let values = boxes.iter().map(|b| f64::from(of(b.detection)));
        figures(score, values.collect())
    });
    all.collect()
}

/// A box on a label that counts, or on no label.
struct JudgedBox<'a> {
    detection: &'a Detection,
    /// Rule of its label; `None`: the box touches no label at all.
    rule: Option<&'a ClassRule>,
}

fn judged_boxes<'a>(frame: &'a DetectedFrame, rules: &'a [ClassRule]) -> Vec<JudgedBox<'a>> {
    let seen = |d: &Detection| -> Option<([f64; 4], Box3)> {
        let (image_box_px, camera_box) = frame.truth.in_camera(&box_of(d))?;
        Some((image_box_px, camera_box.upright()))
    };
    let boxes: Vec<_> = frame.detections.iter().map(seen).collect();
    let mut taken = vec![false; boxes.len()];
    let mut found = Vec::new();
    let judged = |detection, rule| JudgedBox { detection, rule };
    // Labels that count at moderate, in file order.
    for label in frame.truth.labels.iter() {
        let counts = |rule: &&ClassRule| rule.counts_at(label, Difficulty::Moderate);
        let Some(rule) = rules.iter().find(counts) else {
            continue;
        };
        let label = label.camera_box.upright();
        let fits = |(_, b): &([f64; 4], Box3)| iou_3d(b, &label) > rule.iou_min;
        let free = (0..boxes.len()).filter(|&i| !taken[i] && boxes[i].as_ref().is_some_and(fits));
        let objectness = |i: &usize| frame.detections[*i].objectness;
        // The first one at equal objectness.
        let best = free.min_by(|a, b| objectness(b).total_cmp(&objectness(a)));
        if let Some(i) = best {
            taken[i] = true;
            found.push(judged(&frame.detections[i], Some(rule)));
        }
    }
    let all = &frame.truth.labels;
    let labels: Vec<Box3> = all.iter().map(|label| label.camera_box.upright()).collect();
    let is_background = |(image_box_px, b): &([f64; 4], Box3)| {
        let is_apart = labels.iter().all(|l| iou_3d(b, l) == 0.0);
        is_apart && !in_dont_care(all, image_box_px, DONT_CARE_MAX)
    };
    for (seen, detection) in boxes.iter().zip(&frame.detections) {
        if seen.as_ref().is_some_and(is_background) {
            found.push(judged(detection, None));
        }
    }
    found
}

/// For scores where higher means more unknown: area under the ROC curve, 0..1: the probability that an unknown scores above a known, ties half.
/// `None` when either side is empty or a score is NaN.
fn auroc(known: &[f64], unknown: &[f64]) -> Option<f64> {
    let (known, unknown) = (sorted(known)?, sorted(unknown)?);
    let mut wins = 0.0;
    for score in &unknown {
        let below = known.partition_point(|k| k < score);
        let not_above = known.partition_point(|k| k <= score);
        wins += below as f64 + 0.5 * (not_above - below) as f64;
    }
    Some(wins / (known.len() as f64 * unknown.len() as f64))
}

/// Share of the known called unknown at the threshold that 95 % of the unknown pass (FPR at 95 % TPR),
/// 0..1. `None` when either side is empty or a score is NaN.
fn fpr95(known: &[f64], unknown: &[f64]) -> Option<f64> {
    let (known, unknown) = (sorted(known)?, sorted(unknown)?);
    // The highest threshold at or above which at least 95 % of the unknown lie.
    let passed_over = unknown.len() - (unknown.len() * 95).div_ceil(100);
    let threshold = unknown[passed_over];
    let called = known.len() - known.partition_point(|&k| k < threshold);
    Some(called as f64 / known.len() as f64)
}

fn sorted(scores: &[f64]) -> Option<Vec<f64>> {
    if scores.is_empty() || scores.iter().any(|s| s.is_nan()) {
        return None;
    }
    let mut sorted = scores.to_vec();
    sorted.sort_by(f64::total_cmp);
    Some(sorted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separated_equal_and_mixed_scores() {
        assert_eq!(auroc(&[0.1, 0.2], &[0.3, 0.9]), Some(1.0));
        assert_eq!(auroc(&[0.3, 0.9], &[0.1, 0.2]), Some(0.0));
        assert_eq!(auroc(&[0.5; 4], &[0.5; 3]), Some(0.5));
        assert_eq!(auroc(&[1.0, 3.0], &[2.0, 4.0]), Some(0.75));
        assert_eq!(auroc(&[], &[1.0]), None);
        assert_eq!(auroc(&[f64::NAN], &[1.0]), None);
    }

    #[test]
    fn false_alarms_at_95_percent() {
        let unknown: Vec<f64> = (1..=100).map(f64::from).collect();
        // 95 of them are 6 or more.
        assert_eq!(fpr95(&[5.0, 6.0, 7.0, 0.0], &unknown), Some(0.5));
        assert_eq!(fpr95(&[0.0], &[1.0]), Some(0.0));
        assert_eq!(fpr95(&[2.0], &[1.0]), Some(1.0));
    }
}
