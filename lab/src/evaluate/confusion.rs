//! What the unknown is confused with: what lies on unknown labels, and what unknown detections lie on.

use super::{ClassRule, Detection, Difficulty, Frame, UNKNOWN};
use crate::dataset::Label;
use mluc_geometry::{Box3, iou_3d};
use std::collections::BTreeMap;

/// What lies where nothing does.
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
    /// Of all frames, by the rule of the unknown. What is too small to count at moderate is left out, as in the average precision.
    pub fn of(frames: &[Frame], rule: &ClassRule) -> Confusion {
        let mut confusion = Confusion::default();
        let mut detections: Vec<(f64, String)> = Vec::new();
        for frame in frames {
            let labels = frame.labels.iter().filter(|label| counts(label, rule));
            for label in labels {
                let class = found_as(label, frame, rule);
                *confusion.labels_found_as.entry(class).or_default() += 1;
            }
            let unknown = frame
                .detections
                .iter()
                .filter(|d| rule.claims(d) && is_high_enough(d));
            detections.extend(unknown.map(|d| (d.score, lies_on(d, frame, rule))));
        }
        let labels: usize = confusion.labels_found_as.values().sum();
        // Stable: equal scores keep file order.
        detections.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (_, class) in detections.into_iter().take(labels) {
            *confusion.detections_lie_on.entry(class).or_default() += 1;
        }
        confusion
    }
}

fn counts(label: &Label, rule: &ClassRule) -> bool {
    rule.label_counts(label) == Some(true) && Difficulty::Moderate.takes(label)
}

fn is_high_enough(detection: &Detection) -> bool {
    let [_, top, _, bottom] = detection.image_box_px;
    (bottom - top).abs().trunc() >= Difficulty::Moderate.height_min_px()
}

fn found_as(label: &Label, frame: &Frame, rule: &ClassRule) -> String {
    let upright = label.camera_box.upright();
    let (unknown, known): (Vec<&Detection>, Vec<&Detection>) =
        frame.detections.iter().partition(|d| rule.claims(d));
    let overlaps = |d: &&Detection| iou_3d(&d.upright, &upright) > rule.iou_min;
    if unknown.iter().any(overlaps) {
        return UNKNOWN.to_owned();
    }
    let known = known.iter().map(|d| (d.class.as_str(), &d.upright));
    most_overlapped(known, &upright, rule.iou_min)
}

fn lies_on(detection: &Detection, frame: &Frame, rule: &ClassRule) -> String {
    let labels = frame.labels.iter().filter(|label| !label.is_dont_care());
    let boxes: Vec<(&str, Box3)> = labels
        .map(|label| (label.class.as_str(), label.camera_box.upright()))
        .collect();
    let boxes = boxes.iter().map(|(class, upright)| (*class, upright));
    most_overlapped(boxes, &detection.upright, rule.iou_min)
}

/// Class of the box that overlaps `place` most, by more than `iou_min`.
fn most_overlapped<'a>(
    boxes: impl Iterator<Item = (&'a str, &'a Box3)>,
    place: &Box3,
    iou_min: f64,
) -> String {
    boxes
        .map(|(class, shape)| (class, iou_3d(shape, place)))
        .filter(|(_, overlap)| *overlap > iou_min)
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(NOTHING.to_owned(), |(class, _)| class.to_ascii_lowercase())
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

    #[test]
    fn both_rows_are_as_drawn() {
        let frame = Frame {
            labels: vec![
                label("Van", 10.0, 0),
                label("Van", 20.0, 0),
                label("Truck", 30.0, 0),
                label("Truck", 40.0, 3),
                label("Car", 50.0, 0),
            ]
            .into(),
            detections: vec![
                // A known and an unknown detection on one label: found as unknown.
                detection(Kind::Known, "car", 10.0, 0.9, 100.0),
                detection(Kind::Unknown, "unknown", 11.0, 0.5, 100.0),
                // Two known ones: the nearer one counts.
                detection(Kind::Known, "pedestrian", 21.0, 0.9, 100.0),
                detection(Kind::Known, "Car", 20.5, 0.3, 100.0),
                detection(Kind::Unknown, "unknown", 50.0, 0.8, 100.0),
                detection(Kind::Unknown, "unknown", 70.0, 0.4, 100.0),
                // Too small in the image to count, and of too low a score to be among the first three.
                detection(Kind::Unknown, "unknown", 90.0, 0.95, 24.9),
                detection(Kind::Unknown, "unknown", 40.0, 0.1, 100.0),
            ],
        };
        let classes = ["van".to_owned(), "truck".to_owned()];
        let rule = ClassRule::unknown(&classes, 0.1, UnknownProtocol::Literal);
        let counts = |pairs: &[(&str, usize)]| -> BTreeMap<String, usize> {
            pairs.iter().map(|(k, n)| ((*k).to_owned(), *n)).collect()
        };
        let confusion = Confusion::of(&[frame], &rule);
        let labels = counts(&[("unknown", 1), ("car", 1), ("nothing", 1)]);
        assert_eq!(confusion.labels_found_as, labels);
        let detections = counts(&[("car", 1), ("van", 1), ("nothing", 1)]);
        assert_eq!(confusion.detections_lie_on, detections);
    }

    #[test]
    fn without_frames_both_are_empty() {
        let rule = ClassRule::unknown(&["van".to_owned()], 0.1, UnknownProtocol::Literal);
        assert_eq!(Confusion::of(&[], &rule), Confusion::default());
    }
}
