//! What the unknown is confused with: what lies on unknown labels, and what unknown detections lie on.
//!
//! Counts beside the average precision, not a matching: a detection may lie on several labels and several on one, and a detection on a
//! label that does not count (occluded, of a class that may be found or not) is told with that label's class.

use crate::{CameraDetection, ClassRule, Difficulty, LabelledFrame, UNKNOWN};
use mluc_dataset::Label;
use mluc_geometry::{Box3, iou_3d};
use std::collections::BTreeMap;

/// Where no box overlaps enough.
const NOTHING: &str = "nothing";

/// Two rows of a confusion matrix, by overlap of volumes; classes in lower case, `nothing` where there is none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Confusion {
    /// Unknown labels that count at moderate, by what was found there: `unknown` if any detection of the unknown overlaps enough,
    /// else the class of the known detection that overlaps most.
    pub labels_found_as: BTreeMap<String, usize>,
    /// The unknown detections with the highest scores, as many as there are such labels, by the class of the label that they overlap most.
    pub detections_lie_on: BTreeMap<String, usize>,
}

impl Confusion {
    /// Of all frames, by the rule of the unknown; detections that are too small at moderate are left out.
    pub fn of(frames: &[LabelledFrame], rule: &ClassRule) -> Confusion {
        let mut confusion = Confusion::default();
        let mut best: Vec<(&CameraDetection, &LabelledFrame)> = Vec::new();
        for frame in frames {
            let labels = frame.labels.iter();
            for label in labels.filter(|label| rule.counts_at(label, Difficulty::Moderate)) {
                let class = found_as(label, frame, rule);
                *confusion.labels_found_as.entry(class).or_default() += 1;
            }
            let unknown = detections(frame).filter(|d| rule.claims(d));
            best.extend(unknown.map(|d| (d, frame)));
        }
        let label_count: usize = confusion.labels_found_as.values().sum();
        // Stable: equal scores keep file order.
        best.sort_by(|a, b| b.0.score.total_cmp(&a.0.score));
        for (detection, frame) in best.into_iter().take(label_count) {
            let class = lies_on(detection, frame, rule);
            *confusion.detections_lie_on.entry(class).or_default() += 1;
        }
        confusion
    }
}

fn detections(frame: &LabelledFrame) -> impl Iterator<Item = &CameraDetection> {
    let is_high_enough = |d: &&CameraDetection| !Difficulty::Moderate.is_too_small(d);
    frame.detections.iter().filter(is_high_enough)
}

fn found_as(label: &Label, frame: &LabelledFrame, rule: &ClassRule) -> String {
    let upright = label.camera_box.upright();
    let (unknown, known): (Vec<&CameraDetection>, Vec<&CameraDetection>) =
        detections(frame).partition(|d| rule.claims(d));
    let overlaps = |d: &&CameraDetection| iou_3d(&d.upright, &upright) > rule.iou_min;
    if unknown.iter().any(overlaps) {
        return UNKNOWN.to_owned();
    }
    let known = known.iter().map(|d| (d.class.as_str(), d.upright));
    most_overlapped(known, &upright, rule.iou_min)
}

fn lies_on(detection: &CameraDetection, frame: &LabelledFrame, rule: &ClassRule) -> String {
    let labels = frame.labels.iter().filter(|label| !label.is_dont_care());
    let labels = labels.map(|label| (label.class.as_str(), label.camera_box.upright()));
    most_overlapped(labels, &detection.upright, rule.iou_min)
}

/// Class of the box that overlaps `place` most, by more than `iou_min`; the first of equals.
fn most_overlapped<'a>(
    boxes: impl Iterator<Item = (&'a str, Box3)>,
    place: &Box3,
    iou_min: f64,
) -> String {
    let (mut class, mut most) = (NOTHING, iou_min);
    for (other, shape) in boxes {
        let overlap = iou_3d(&shape, place);
        if overlap > most {
            (class, most) = (other, overlap);
        }
    }
    class.to_ascii_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::UnknownProtocol;
    use crate::tests::{found_at, frame, label};

    /// Checks both rows against classes that occur once each.
    fn check(labels: &[Label], detections: &[CameraDetection], found_as: &[&str], on: &[&str]) {
        let frame = frame(labels.to_vec(), detections.to_vec());
        let classes = ["van".to_owned(), "truck".to_owned()];
        let rule = ClassRule::unknown(&classes, 0.1, UnknownProtocol::Literal);
        let counts = |classes: &[&str]| classes.iter().map(|c| ((*c).to_owned(), 1)).collect();
        let expected = Confusion {
            labels_found_as: counts(found_as),
            detections_lie_on: counts(on),
        };
        assert_eq!(Confusion::of(&[frame], &rule), expected);
    }

    #[test]
    fn both_rows_are_as_drawn() {
        let at = [
            ("Van", 10.0),
            ("Van", 20.0),
            ("Truck", 30.0),
            ("Truck", 40.0),
            ("Car", 50.0),
        ];
        let mut labels = at.map(|(class, x_m)| label(class, x_m));
        labels[3].occluded = 3;
        let detections = [
            // A known and an unknown detection on one label: found as unknown.
            found_at(10.0, "car", 0.9),
            found_at(11.0, UNKNOWN, 0.5),
            // Three known ones: the one that overlaps most counts, whatever its place and score.
            found_at(21.5, "pedestrian", 0.9),
            found_at(20.5, "Car", 0.3),
            found_at(21.0, "cyclist", 0.8),
            found_at(50.0, UNKNOWN, 0.8),
            found_at(70.0, UNKNOWN, 0.4),
            // Not among the first three.
            found_at(40.0, UNKNOWN, 0.1),
        ];
        let (found_as, on) = (["unknown", "car", "nothing"], ["car", "van", "nothing"]);
        check(&labels, &detections, &found_as, &on);
    }

    #[test]
    fn what_is_too_small_finds_nothing() {
        let labels = [label("Van", 10.0), label("DontCare", 50.0)];
        let (mut small, mut large) = (found_at(10.0, UNKNOWN, 0.9), found_at(50.0, UNKNOWN, 0.5));
        small.image_box_px[3] = 124.9;
        large.image_box_px[3] = 125.0;
        // A region without labels is no class.
        check(&labels, &[small, large], &["nothing"], &["nothing"]);
    }

    #[test]
    fn a_detector_that_names_unknown_classes_found_the_unknown() {
        let named = found_at(10.0, "Van", 0.9);
        check(&[label("Van", 10.0)], &[named], &["unknown"], &["van"]);
    }
}
