//! What became of each label, by class and range: the question that an average precision does not answer.

use super::DetectedFrame;
use super::separation::labels_that_count;
use crate::evaluate::{ClassRule, Frame, Kind};
use mluc_geometry::{Box3, iou_3d};

/// A detection below this score is one that a robot would not act on: a guess, for these tables alone.
const SCORE_MIN: f64 = 0.3;
/// With less overlap a detection has nothing to do with a label.
const TOUCHES_IOU: f64 = 0.1;
/// Upper ends of the ranges, m.
const RANGES_M: [f64; 4] = [15.0, 30.0, 45.0, f64::INFINITY];

/// Labels of one class in one range, by fate.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct MissRow {
    /// Labels that count at moderate.
    pub labels: usize,
    /// Its class's detection overlaps enough and scores at least 0.3.
    pub found: usize,
    /// It overlaps enough and scores less.
    pub weak: usize,
    /// Its class's best detection overlaps too little.
    pub displaced: usize,
    /// Only another class's detection lies there.
    pub other_class: usize,
    /// Nothing lies there.
    pub missed: usize,
}

/// Detections of one class that score at least 0.3, by what they lie on.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct AlarmRow {
    /// Detections.
    pub detections: usize,
    /// On a label of the class, whatever its difficulty.
    pub right: usize,
    /// On one, with too little overlap.
    pub displaced: usize,
    /// On a label of another class.
    pub other_class: usize,
    /// On nothing that is labelled.
    pub background: usize,
}

/// Fates of the labels and detections of one class.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MissTable {
    /// The class.
    pub class: String,
    /// By range: below 15, 30, 45 m, and beyond.
    pub by_range: [MissRow; 4],
    /// Its detections.
    pub alarms: AlarmRow,
}

/// One table a rule; `judged` are the frames with the detections to look at.
pub fn misses(frames: &[DetectedFrame], judged: &[Frame], rules: &[ClassRule]) -> Vec<MissTable> {
    let table = |rule: &ClassRule| {
        let mut table = MissTable {
            class: rule.name.clone(),
            by_range: Default::default(),
            alarms: AlarmRow::default(),
        };
        for (frame, found) in frames.iter().zip(judged) {
            for (label, own) in labels_that_count(&frame.truth, rules) {
                if own == rule {
                    // Upright boxes keep the camera's place, a hand's breadth from the sensor's.
                    let range_m = label.center_m[0].hypot(label.center_m[1]);
                    let row = RANGES_M.iter().position(|end| range_m < *end).unwrap_or(3);
                    count_label(&label, found, rule, &mut table.by_range[row]);
                }
            }
            count_alarms(found, rule, &mut table.alarms);
        }
        table
    };
    rules.iter().map(table).collect()
}

fn count_label(label: &Box3, frame: &Frame, rule: &ClassRule, row: &mut MissRow) {
    let (mut found, mut weak, mut displaced, mut other) = (false, false, false, false);
    for detection in &frame.detections {
        let overlap = iou_3d(&detection.upright, label);
        let own = rule.claims(detection);
        let sure = detection.score >= SCORE_MIN || rule.kind == Kind::Unknown;
        found |= own && sure && overlap > rule.iou_min;
        weak |= own && !sure && overlap > rule.iou_min;
        displaced |= own && overlap > TOUCHES_IOU;
        other |= !own && overlap > TOUCHES_IOU;
    }
    row.labels += 1;
    let fate = match () {
        () if found => &mut row.found,
        () if weak => &mut row.weak,
        () if displaced => &mut row.displaced,
        () if other => &mut row.other_class,
        () => &mut row.missed,
    };
    *fate += 1;
}

fn count_alarms(frame: &Frame, rule: &ClassRule, row: &mut AlarmRow) {
    let boxes: Vec<(bool, Box3)> = frame
        .labels
        .iter()
        .filter(|label| !label.is_dont_care())
        .map(|label| {
            (
                rule.label_counts(label).is_some(),
                label.camera_box.upright(),
            )
        })
        .collect();
    for detection in &frame.detections {
        let sure = detection.score >= SCORE_MIN || rule.kind == Kind::Unknown;
        if !sure || !rule.claims(detection) {
            continue;
        }
        let best = |own: bool| {
            let of_kind = boxes.iter().filter(|(is_own, _)| *is_own == own);
            of_kind
                .map(|(_, label)| iou_3d(&detection.upright, label))
                .fold(0.0, f64::max)
        };
        let (own, other) = (best(true), best(false));
        row.detections += 1;
        let fate = match () {
            () if own > rule.iou_min => &mut row.right,
            () if own > TOUCHES_IOU => &mut row.displaced,
            () if other > TOUCHES_IOU => &mut row.other_class,
            () => &mut row.background,
        };
        *fate += 1;
    }
}
