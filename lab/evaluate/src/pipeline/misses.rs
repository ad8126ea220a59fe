//! What became of each label, by class and range: the question that an average precision does not answer.

use crate::breakdown::range_bin;
use crate::frame::score_of;
use crate::{ClassRule, Difficulty, LabelledFrame, ObjectKind};
use mluc_dataset::Label;
use mluc_geometry::{Box3, iou_3d};

/// A detection below this score is one that a robot would not act on: a guess, for these tables alone.
const SCORE_MIN: f64 = 0.3;
/// With less overlap a detection has nothing to do with a label.
const TOUCHES_IOU: f64 = 0.1;

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

/// Dispositions of the labels of one class.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MissTable {
    /// The class.
    pub class: String,
    /// By range: below 15, 30, 45 m, and beyond.
    pub by_range: [MissRow; 4],
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
        };
        for frame in frames {
            let labels = labels_that_count(&frame.labels, rules);
            for (label, _) in labels.filter(|(_, own)| *own == rule) {
                count_label(&label, frame, rule, &mut table.by_range[range_bin(&label)]);
            }
        }
        table
    };
    rules.iter().map(table).collect()
}

fn count_label(label: &Box3, frame: &LabelledFrame, rule: &ClassRule, row: &mut MissRow) {
    let (mut found, mut weak, mut displaced, mut other) = (false, false, false, false);
    for detection in &frame.detections {
        let overlap = iou_3d(&detection.camera_box.upright(), label);
        let own = rule.claims(detection);
        // The scores of unknown detections only order them.
        let sure = score_of(detection) >= SCORE_MIN || rule.kind == ObjectKind::Unknown;
        found |= own && sure && overlap > rule.iou_min;
        weak |= own && !sure && overlap > rule.iou_min;
        displaced |= own && overlap > TOUCHES_IOU;
        other |= !own && overlap > TOUCHES_IOU;
    }
    row.labels += 1;
    let dispositions = [
        (found, &mut row.found),
        (weak, &mut row.weak),
        (displaced, &mut row.displaced),
        (other, &mut row.other_class),
        (true, &mut row.missed),
    ];
    if let Some((_, count)) = dispositions.into_iter().find(|(holds, _)| *holds) {
        *count += 1;
    }
}
