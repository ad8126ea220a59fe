//! Unknown objects that were taken for known ones (absolute open-set error; Dhamija et al., WACV 2020).

use super::{ClassRule, Detection, Difficulty, Frame, Kind};
use mluc_geometry::iou_3d;

/// Unknown labels that count at moderate and that a detection of kind known overlaps by more than the unknown rule
/// asks. Labels go in file order and take the highest score; a detection serves one label. 0 without an unknown rule.
pub fn unknown_as_known(frames: &[Frame], rules: &[ClassRule]) -> usize {
    let rule = rules.iter().find(|rule| rule.kind == Kind::Unknown);
    rule.map_or(0, |rule| {
        frames.iter().map(|frame| in_frame(frame, rule)).sum()
    })
}

/// The same for one frame and the unknown rule.
pub(super) fn in_frame(frame: &Frame, rule: &ClassRule) -> usize {
    let is_known = |d: &&Detection| d.kind == Kind::Known && !rule.claims(d);
    let mut known: Vec<&Detection> = frame.detections.iter().filter(is_known).collect();
    known.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut count = 0;
    for label in frame.labels.iter() {
        if !rule.counts_at(label, Difficulty::Moderate) {
            continue;
        }
        let upright = label.camera_box.upright();
        let hit = known
            .iter()
            .position(|d| iou_3d(&d.upright, &upright) > rule.iou_min);
        if let Some(index) = hit {
            known.remove(index);
            count += 1;
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Label;
    use crate::evaluate::UnknownProtocol;
    use mluc_geometry::{Box3, Calibration};

    fn label(class: &str, x_m: f64) -> Label {
        let shape = Box3::new([x_m, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]);
        Label {
            class: class.to_owned(),
            truncated: 0.0,
            occluded: 0,
            alpha_rad: 0.0,
            image_box_px: [0.0, 0.0, 100.0, 100.0],
            camera_box: Calibration::without_camera().label_from_box_in_sensor(&shape),
            score: None,
        }
    }

    #[test]
    fn a_known_detection_counts_once_and_an_unknown_one_does_not() {
        let labels = [
            label("Van", 10.0),
            label("Van", 10.5),
            label("Van", 30.0),
            label("Car", 50.0),
        ];
        let detection = |x_m: f64, kind| Detection {
            kind,
            class: "car".to_owned(),
            score: 0.5,
            image_box_px: [0.0, 0.0, 100.0, 100.0],
            upright: label("", x_m).camera_box.upright(),
        };
        let frame = Frame {
            labels: labels.to_vec().into(),
            detections: vec![
                detection(10.2, Kind::Known),
                detection(30.0, Kind::Unknown),
                detection(50.0, Kind::Known),
            ],
        };
        let rules = [ClassRule::unknown(
            &["van".to_owned()],
            0.1,
            UnknownProtocol::Literal,
        )];
        assert_eq!(unknown_as_known(std::slice::from_ref(&frame), &rules), 1);
        assert_eq!(unknown_as_known(&[frame], &[]), 0);
    }
}
