//! The scenes of figure 6: the chosen frames, and the objects of each row in them.

use crate::{Result, evaluate::setting_rules, options::TestFrames};
use crate::{evaluated::ByRow, evaluated::Evaluated, report::DrawnScene, report::Panel};
use mluc_evaluate::{Difficulty, ObjectKind, SensorDetection};

/// Columns of figure 6 after the labels, for the evaluated rows; where two have the same title, the first one.
const SHOWN: [(&str, &str); 6] = [
    ("closed-set", "Closed set"),
    ("naive", "Naive"),
    ("osis", "OSIS"),
    ("osis-geo", "OSIS"),
    ("paper-corrected", "MLUC"),
    ("mluc-full", "MLUC full"),
];
/// Pictures leave out known objects with a lower score.
const KNOWN_SCORE_MIN: f64 = 0.3;
/// Objects further away are hard to see in a picture, m.
const NEAR_M: f64 = 32.0;

/// A label in a picture.
struct Truth {
    shown: SensorDetection,
    /// Whether its class is evaluated and it is easy enough.
    counts: bool,
    range_m: f64,
}

impl Truth {
    fn is_unknown(&self) -> bool {
        self.shown.kind == ObjectKind::Unknown
    }
}

/// Labels of a frame that are visible (in view of the camera where there is one).
fn truths(test: &TestFrames, index: usize) -> Result<Vec<Truth>> {
    let rules = setting_rules(test.setting)?;
    let truth = test.set.truth(index)?;
    let seen = truth.labels.iter().filter(|label| !label.is_dont_care());
    let drawn = seen.map(|label| {
        let rule = rules.iter().find(|rule| rule.valid.iter().any(|class| label.is(class)));
        let calibration = &truth.calibration;
        let box_in_sensor = calibration.box_in_sensor_from_label(&label.camera_box);
        Truth {
            counts: rule.is_some() && Difficulty::Moderate.takes(label),
            range_m: box_in_sensor.center_m[0].hypot(box_in_sensor.center_m[1]),
            shown: SensorDetection {
                class: label.class.clone(),
                kind: rule.map_or(ObjectKind::Known, |rule| rule.kind),
                track: label.track,
                ..SensorDetection::unknown(1.0, box_in_sensor)
            },
        }
    });
    Ok(drawn.collect())
}

/// The frame with the most counting unknown objects within 32 m, then with the most known ones; `None` without any such object.
pub(crate) fn figure6_scene(test: &TestFrames, evaluated: &ByRow) -> Result<Option<DrawnScene>> {
    let mut best: Option<([usize; 2], usize)> = None;
    for index in 0..test.set.names().len() {
        let truths = truths(test, index)?;
        let near = truths.iter().filter(|t| t.counts && t.range_m < NEAR_M);
        let (unknown, known): (Vec<_>, Vec<_>) = near.partition(|t| t.is_unknown());
        let worth = [unknown.len(), known.len()];
        if worth[0] > 0 && best.is_none_or(|(most, _)| worth > most) {
            best = Some((worth, index));
        }
    }
    let Some((_, index)) = best else {
        return Ok(None);
    };
    let mut panels: Vec<Panel> = Vec::new();
    for (method, title) in SHOWN {
        let first = evaluated.get(method).and_then(|seeds| seeds.first());
        if let Some(first) = first.filter(|_| panels.iter().all(|(own, _)| own != title)) {
            panels.push((title.to_owned(), shown(first, index)));
        }
    }
    let truths = truths(test, index)?;
    let near = truths.iter().filter(|t| t.is_unknown() && t.counts);
    let nearest = near.min_by(|a, b| a.range_m.total_cmp(&b.range_m));
    let target_m = nearest.map_or([15.0, 0.0], |t| {
        let [x, y, _] = t.shown.box_in_sensor.center_m;
        [x, y]
    });
    Ok(Some(DrawnScene {
        caption: format!("{}, frame {}", test.setting.name(), test.set.names()[index]),
        points: test.set.points(index)?,
        truth: truths.into_iter().map(|t| t.shown).collect(),
        panels,
        target_m,
    }))
}

/// The objects of a frame with a score high enough to be drawn.
fn shown(evaluated: &Evaluated, index: usize) -> Vec<SensorDetection> {
    let unknown_min = evaluated.unknown_score_min.unwrap_or(f64::INFINITY);
    let mut objects = evaluated.objects[index].clone();
    objects.retain(|object| match object.kind {
        ObjectKind::Known => object.score >= KNOWN_SCORE_MIN,
        ObjectKind::Unknown => object.score >= unknown_min,
    });
    objects
}
