//! What became of each label, by class and range: the question that an average precision does not answer.

use crate::{CameraDetection, ClassRule, Difficulty, LabelledFrame, ObjectKind};
use mluc_dataset::Label;
use mluc_geometry::{Box3, iou_3d};

/// A detection below this score is one that a robot would not act on: a guess, for these tables alone.
const SCORE_MIN: f64 = 0.3;
/// With less overlap a detection has nothing to do with a label.
const TOUCHES_IOU: f64 = 0.1;
/// Upper ends of the ranges, m.
const RANGES_M: [f64; 4] = [15.0, 30.0, 45.0, f64::INFINITY];

/// Labels of one class in one range, by disposition.
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

/// Dispositions of the labels and detections of one class.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MissTable {
    /// The class.
    pub class: String,
    /// By range: below 15, 30, 45 m, and beyond.
    pub by_range: [MissRow; 4],
    /// Its detections.
    pub alarms: AlarmRow,
}

/// Labels that count at moderate, in file order: upright box and rule.
pub(super) fn labels_that_count<'a>(
    labels: &'a [Label],
    rules: &'a [ClassRule],
) -> impl Iterator<Item = (Box3, &'a ClassRule)> {
    labels.iter().filter_map(|label| {
        let is_of = |rule: &&ClassRule| rule.label_counts(label) == Some(true);
        let rule = rules.iter().find(is_of)?;
        let takes = Difficulty::Moderate.takes(label);
        takes.then(|| (label.camera_box.upright(), rule))
    })
}

/// One table a rule; `frames` hold the detections to examine.
pub(super) fn misses(frames: &[LabelledFrame], rules: &[ClassRule]) -> Vec<MissTable> {
    let table = |rule: &ClassRule| {
        let mut table = MissTable {
            class: rule.name.clone(),
            by_range: Default::default(),
            alarms: AlarmRow::default(),
        };
        for frame in frames {
            let labels = labels_that_count(&frame.labels, rules);
            for (label, _) in labels.filter(|(_, own)| *own == rule) {
                // Upright boxes keep the camera's place, a hand's breadth from the sensor's.
                let range_m = label.center_m[0].hypot(label.center_m[1]);
                let row = RANGES_M.iter().position(|end| range_m < *end).unwrap_or(3);
                count_label(&label, frame, rule, &mut table.by_range[row]);
            }
            count_alarms(frame, rule, &mut table.alarms);
        }
        table
    };
    rules.iter().map(table).collect()
}

/// A known detection must score enough; the scores of unknown ones only order them.
fn is_sure(detection: &CameraDetection, rule: &ClassRule) -> bool {
    detection.score >= SCORE_MIN || rule.kind == ObjectKind::Unknown
}

fn count_label(label: &Box3, frame: &LabelledFrame, rule: &ClassRule, row: &mut MissRow) {
    let (mut found, mut weak, mut displaced, mut other) = (false, false, false, false);
    for detection in &frame.detections {
        let overlap = iou_3d(&detection.upright, label);
        let (own, sure) = (rule.claims(detection), is_sure(detection, rule));
        found |= own && sure && overlap > rule.iou_min;
        weak |= own && !sure && overlap > rule.iou_min;
        displaced |= own && overlap > TOUCHES_IOU;
        other |= !own && overlap > TOUCHES_IOU;
    }
    row.labels += 1;
    count_first([
        (found, &mut row.found),
        (weak, &mut row.weak),
        (displaced, &mut row.displaced),
        (other, &mut row.other_class),
        (true, &mut row.missed),
    ]);
}

/// Adds one to the first count whose condition holds.
fn count_first<const N: usize>(counts: [(bool, &mut usize); N]) {
    if let Some((_, count)) = counts.into_iter().find(|(holds, _)| *holds) {
        *count += 1;
    }
}

fn count_alarms(frame: &LabelledFrame, rule: &ClassRule, row: &mut AlarmRow) {
    let labels = frame.labels.iter().filter(|label| !label.is_dont_care());
    let own_and_box = |l: &Label| (rule.label_counts(l).is_some(), l.camera_box.upright());
    let boxes: Vec<(bool, Box3)> = labels.map(own_and_box).collect();
    let detections = frame.detections.iter();
    for detection in detections.filter(|d| is_sure(d, rule) && rule.claims(d)) {
        let best = |own: bool| {
            let of_kind = boxes.iter().filter(|(is_own, _)| *is_own == own);
            let overlaps = of_kind.map(|(_, label)| iou_3d(&detection.upright, label));
            overlaps.fold(0.0, f64::max)
        };
        let (own, other) = (best(true), best(false));
        row.detections += 1;
        count_first([
            (own > rule.iou_min, &mut row.right),
            (own > TOUCHES_IOU, &mut row.displaced),
            (other > TOUCHES_IOU, &mut row.other_class),
            (true, &mut row.background),
        ]);
    }
}
