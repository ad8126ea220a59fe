//! What the unknown is confused with: what lies on unknown labels, and what unknown detections lie on.
//!
//! Counts beside the average precision, not a matching: a detection may lie on several labels and several on one, and a detection on a
//! label that does not count (occluded, of a class that may be found or not) is told with that label's class.

use super::{ClassRule, Detection, Difficulty, Frame, UNKNOWN};
use crate::dataset::Label;
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
    pub fn of(frames: &[Frame], rule: &ClassRule) -> Confusion {
        let mut confusion = Confusion::default();
        let mut best: Vec<(&Detection, &Frame)> = Vec::new();
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

fn detections(frame: &Frame) -> impl Iterator<Item = &Detection> {
    let is_high_enough = |d: &&Detection| !Difficulty::Moderate.is_too_small(d);
    frame.detections.iter().filter(is_high_enough)
}

fn found_as(label: &Label, frame: &Frame, rule: &ClassRule) -> String {
    let upright = label.camera_box.upright();
    let (unknown, known): (Vec<&Detection>, Vec<&Detection>) =
        detections(frame).partition(|d| rule.claims(d));
    let overlaps = |d: &&Detection| iou_3d(&d.upright, &upright) > rule.iou_min;
    if unknown.iter().any(overlaps) {
        return UNKNOWN.to_owned();
    }
    let known = known.iter().map(|d| (d.class.as_str(), d.upright));
    most_overlapped(known, &upright, rule.iou_min)
}

fn lies_on(detection: &Detection, frame: &Frame, rule: &ClassRule) -> String {
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
    use crate::evaluate::{Kind, UnknownProtocol};
    use mluc_geometry::Calibration;

    fn label(class: &str, x_m: f64, occluded: i32) -> Label {
        let shape = Box3::new([x_m, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]);
        Label {
            class: class.to_owned(),
            truncated: 0.0,
            occluded,
            alpha_rad: 0.0,
            image_box_px: [0.0, 0.0, 100.0, 100.0],
            camera_box: Calibration::without_camera().label_from_box_in_sensor(&shape),
            score: None,
        }
    }

    fn detection(kind: Kind, class: &str, x_m: f64, score: f64, height_px: f64) -> Detection {
        Detection {
            kind,
            class: class.to_owned(),
            score,
            image_box_px: [0.0, 0.0, 100.0, height_px],
            upright: label("", x_m, 0).camera_box.upright(),
        }
    }

    fn counts(pairs: &[(&str, usize)]) -> BTreeMap<String, usize> {
        pairs.iter().map(|(k, n)| ((*k).to_owned(), *n)).collect()
    }

    fn confusion(labels: &[Label], detections: &[Detection]) -> Confusion {
        let frame = Frame {
            labels: labels.to_vec().into(),
            detections: detections.to_vec(),
        };
        let classes = ["van".to_owned(), "truck".to_owned()];
        let rule = ClassRule::unknown(&classes, 0.1, UnknownProtocol::Literal);
        Confusion::of(&[frame], &rule)
    }

    #[test]
    fn both_rows_are_as_drawn() {
        let labels = [
            label("Van", 10.0, 0),
            label("Van", 20.0, 0),
            label("Truck", 30.0, 0),
            label("Truck", 40.0, 3),
            label("Car", 50.0, 0),
        ];
        let detections = [
            // A known and an unknown detection on one label: found as unknown.
            detection(Kind::Known, "car", 10.0, 0.9, 100.0),
            detection(Kind::Unknown, "unknown", 11.0, 0.5, 100.0),
            // Three known ones: the one that overlaps most counts, whatever its place and score.
            detection(Kind::Known, "pedestrian", 21.5, 0.9, 100.0),
            detection(Kind::Known, "Car", 20.5, 0.3, 100.0),
            detection(Kind::Known, "cyclist", 21.0, 0.8, 100.0),
            detection(Kind::Unknown, "unknown", 50.0, 0.8, 100.0),
            detection(Kind::Unknown, "unknown", 70.0, 0.4, 100.0),
            // Not among the first three.
            detection(Kind::Unknown, "unknown", 40.0, 0.1, 100.0),
        ];
        let confusion = confusion(&labels, &detections);
        let expected = counts(&[("unknown", 1), ("car", 1), ("nothing", 1)]);
        assert_eq!(confusion.labels_found_as, expected);
        let expected = counts(&[("car", 1), ("van", 1), ("nothing", 1)]);
        assert_eq!(confusion.detections_lie_on, expected);
    }

    #[test]
    fn what_is_too_small_finds_nothing() {
        let labels = [label("Van", 10.0, 0), label("DontCare", 50.0, 0)];
        let small = detection(Kind::Unknown, "unknown", 10.0, 0.9, 24.9);
        let large = detection(Kind::Unknown, "unknown", 50.0, 0.5, 25.0);
        let confusion = confusion(&labels, &[small, large]);
        assert_eq!(confusion.labels_found_as, counts(&[("nothing", 1)]));
        // A region without labels is no class.
        assert_eq!(confusion.detections_lie_on, counts(&[("nothing", 1)]));
    }

    #[test]
    fn a_detector_that_names_unknown_classes_found_the_unknown() {
        let van = detection(Kind::Known, "Van", 10.0, 0.9, 100.0);
        let confusion = confusion(&[label("Van", 10.0, 0)], &[van]);
        assert_eq!(confusion.labels_found_as, counts(&[("unknown", 1)]));
        assert_eq!(confusion.detections_lie_on, counts(&[("van", 1)]));
    }
}
