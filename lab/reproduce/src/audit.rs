//! What a benchmark folder holds, beside the object counts that the paper quotes: which frames it trained on and judged follows from
//! them alone, since it does not say.

use mluc_dataset::{Dataset, DatasetError, KITTI_CLASSES, Label, check_classes, check_files};
use mluc_evaluate::Difficulty;
use rayon::prelude::*;
use std::fmt::Write as _;

/// Objects of one class.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClassCount {
    /// All of them.
    pub all: usize,
    /// Those that count at moderate (easy ones among them).
    pub moderate: usize,
    /// All, in frames that hold an unknown object.
    pub beside_unknown: usize,
    /// Those that count at moderate, in frames that hold an unknown object.
    pub moderate_beside_unknown: usize,
}

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
    pub classes: [ClassCount; 9],
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
    let frames: Vec<Vec<Label>> = dataset
        .names()
        .par_iter()
        .map(read)
        .collect::<Result<_, _>>()?;
    let mut audit = Audit {
        split: split.to_owned(),
        frames: frames.len(),
        with_unknown: 0,
        classes: Default::default(),
    };
    for labels in &frames {
        let has_unknown = labels
            .iter()
            .any(|label| UNKNOWN.iter().any(|class| label.is(class)));
        audit.with_unknown += usize::from(has_unknown);
        for label in labels {
            let Some(at) = KITTI_CLASSES.iter().position(|class| label.is(class)) else {
                continue;
            };
            let (count, moderate) = (&mut audit.classes[at], Difficulty::Moderate.takes(label));
            count.all += 1;
            count.moderate += usize::from(moderate);
            count.beside_unknown += usize::from(has_unknown);
            count.moderate_beside_unknown += usize::from(has_unknown && moderate);
        }
    }
    Ok(audit)
}

impl Audit {
    fn sum(&self, classes: &[&str], of: fn(&ClassCount) -> usize) -> usize {
        let counted = KITTI_CLASSES.iter().zip(&self.classes);
        counted
            .filter(|(class, _)| classes.contains(class))
            .map(|(_, count)| of(count))
            .sum()
    }

    /// Known objects in frames without any unknown one: what policy `drop_frames` trains on.
    pub fn known_without_unknown(&self) -> usize {
        self.sum(&KNOWN, |c| c.all - c.beside_unknown)
    }

    /// As Markdown: by class, then the counts that the paper's can be compared with.
    pub fn to_markdown(&self) -> String {
        let mut text = format!(
            "## {}\n\n{} frames: {} with a van or truck, {} without\n\n| class | objects | moderate or easier | in frames with a van or truck | of these moderate or \
             easier |\n|---|---|---|---|---|\n",
            self.split,
            self.frames,
            self.with_unknown,
            self.frames - self.with_unknown
        );
        let objects = KITTI_CLASSES.iter().zip(&self.classes);
        for (class, c) in objects.filter(|(class, _)| **class != "DontCare") {
            // Writing to a String does not fail.
            let _ = writeln!(
                text,
                "| {class} | {} | {} | {} | {} |",
                c.all, c.moderate, c.beside_unknown, c.moderate_beside_unknown
            );
        }
        let known = |of| self.sum(&KNOWN, of);
        let unknown = |of| self.sum(&UNKNOWN, of);
        text += "\n| known: car, pedestrian, cyclist; unknown: van, truck | here | the paper |\n|---|---|---|\n";
        let rows = [
            ("known, all frames", known(|c| c.all), ""),
            (
                "known, frames without unknown",
                self.known_without_unknown(),
                "8690 (train)",
            ),
            (
                "known, moderate or easier, all frames",
                known(|c| c.moderate),
                "",
            ),
            (
                "known, moderate or easier, frames with unknown",
                known(|c| c.moderate_beside_unknown),
                "4845 (test)",
            ),
            ("unknown, all", unknown(|c| c.all), ""),
            (
                "unknown, moderate or easier",
                unknown(|c| c.moderate),
                "1255 (test)",
            ),
        ];
        for (what, count, paper) in rows {
            let _ = writeln!(text, "| {what} | {count} | {paper} |");
        }
        text
    }
}
