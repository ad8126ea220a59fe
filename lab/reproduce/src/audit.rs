//! What a benchmark folder holds, beside the object counts that the paper quotes: which frames it trained on and judged follows from
//! them alone, since it does not say.

use mluc_dataset::{Dataset, DatasetError, KITTI_CLASSES, Label, check_classes, check_files};
use mluc_evaluate::Difficulty;
use rayon::prelude::*;
use serde_json::json;

/// Objects: all of them; those that count at moderate (easy ones among them); both again in frames that hold an unknown object.
pub type ObjectCounts = [usize; 4];

/// Counts of a split.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Audit {
    /// Name of the split.
    pub split: String,
    /// Frames.
    pub frames: usize,
    /// Frames that hold an unknown object.
    pub with_unknown: usize,
    /// By class, in KITTI's order ([`KITTI_CLASSES`]).
    pub classes: [ObjectCounts; 9],
}

const KNOWN: [&str; 3] = ["Car", "Pedestrian", "Cyclist"];
const UNKNOWN: [&str; 2] = ["Van", "Truck"];

/// Counts a split. Frames without label or calibration file, and labels of classes that KITTI does not have, are errors.
pub fn audit(dataset: &Dataset, split: &str) -> Result<Audit, DatasetError> {
    check_files(dataset)?;
    let read = |name: &String| -> Result<Vec<Label>, DatasetError> {
        check_classes(&dataset.label_path(name), &KITTI_CLASSES)?;
        dataset.calibration(name)?;
        dataset.labels(name)
    };
    let frames: Result<Vec<_>, _> = dataset.names().par_iter().map(read).collect();
    let frames = frames?;
    let mut audit = Audit {
        split: split.to_owned(),
        frames: frames.len(),
        with_unknown: 0,
        classes: Default::default(),
    };
    for labels in &frames {
        let is_unknown = |label: &Label| UNKNOWN.iter().any(|class| label.is(class));
        let beside = labels.iter().any(is_unknown);
        audit.with_unknown += usize::from(beside);
        for label in labels {
            let Some(at) = KITTI_CLASSES.iter().position(|class| label.is(class)) else {
                continue;
            };
            let moderate = Difficulty::Moderate.takes(label);
            let counted = [true, moderate, beside, beside && moderate];
            for (count, counts) in audit.classes[at].iter_mut().zip(counted) {
                *count += usize::from(counts);
            }
        }
    }
    Ok(audit)
}

impl Audit {
    fn sum(&self, classes: &[&str]) -> ObjectCounts {
        let counted = KITTI_CLASSES.iter().zip(&self.classes);
        let counted = counted.filter(|(class, _)| classes.contains(class));
        counted.fold([0; 4], |sum, (_, counts)| {
            [0, 1, 2, 3].map(|i| sum[i] + counts[i])
        })
    }

    /// As Markdown: by class, then the counts that the paper's can be compared with.
    pub fn to_markdown(&self) -> String {
        let values = json!({
            "split": self.split, "frames": self.frames, "with_unknown": self.with_unknown,
            "classes": KITTI_CLASSES.iter().zip(&self.classes).collect::<Vec<_>>(),
            "known": self.sum(&KNOWN), "unknown": self.sum(&UNKNOWN),
        });
        mluc_evaluate::render(include_str!("audit.md"), values) + "\n"
    }
}
