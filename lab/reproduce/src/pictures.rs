//! Scenes for the figures: which frames are shown, and what each row found in them.

use crate::evaluate::setting_rules;
use crate::evaluated::Evaluated;
use crate::methods::MethodRow;
use crate::options::TestFrames;
use crate::report::{DrawnScene, Panel, SceneBox};
use mluc_evaluate::{Difficulty, EvaluateError, NeighbourPolicy, ObjectKind, SensorDetection};
use mluc_geometry::{Box3, iou_3d};
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// Columns of figure 6 beside the labels, as far as they were evaluated; of two with one title the first.
const SHOWN: [(&str, &str); 6] = [
    ("closed-set", "Closed set"),
    ("naive", "Naive"),
    ("osis", "OSIS"),
    ("osis-geo", "OSIS"),
    ("paper-corrected", "MLUC"),
    ("mluc-full", "MLUC full"),
];
/// Known objects of a lower score are left out of pictures.
const KNOWN_SCORE_MIN: f32 = 0.3;
/// Objects further away are hard to see in a picture, m.
const NEAR_M: f64 = 32.0;
/// A detection that overlaps a label by more has found it.
const FOUND_IOU: f64 = 0.1;
/// Frames on the page of the worst.
const WORST: usize = 6;

/// A label as it is drawn.
struct Truth {
    shown: SceneBox,
    /// Of a class that is judged, and easy enough.
    counts: bool,
    range_m: f64,
}

/// Labels of a frame that are seen at all (in view of the camera where there is one).
fn truths(test: &TestFrames, index: usize) -> Result<Vec<Truth>, EvaluateError> {
    let rules = setting_rules(test.setting, NeighbourPolicy::Official)?;
    let truth = test.set.truth(index)?;
    let seen = truth.labels.iter().filter(|label| !label.is_dont_care());
    let drawn = seen.map(|label| {
        let mut rules = rules.iter();
        let rule = rules.find(|rule| rule.valid.iter().any(|class| label.is(class)));
        let calibration = &truth.calibration;
        let bounds = calibration.box_in_sensor_from_label(&label.camera_box);
        Truth {
            counts: rule.is_some() && Difficulty::Moderate.takes(label),
            range_m: bounds.center_m[0].hypot(bounds.center_m[1]),
            shown: SceneBox {
                class: label.class.clone(),
                unknown: rule.is_some_and(|rule| rule.kind == ObjectKind::Unknown),
                bounds,
            },
        }
    });
    Ok(drawn.collect())
}

/// The scene of figure 6: of the frames with an unknown object that counts within 32 m, the one with most of them, then with most
/// known objects as near; chosen by labels alone. `None` where there is none such, or nothing was evaluated.
pub(crate) fn figure6_scene(
    test: &TestFrames,
    evaluated: &BTreeMap<&'static str, Vec<Evaluated>>,
) -> Result<Option<DrawnScene>, EvaluateError> {
    let mut best: Option<([usize; 2], usize)> = None;
    for index in 0..test.set.len() {
        let truths = truths(test, index)?;
        let near = truths.iter().filter(|t| t.counts && t.range_m < NEAR_M);
        let (unknown, known): (Vec<_>, Vec<_>) = near.partition(|t| t.shown.unknown);
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
        if let Some(first) = first.filter(|_| panels.iter().all(|panel| panel.title != title)) {
            panels.push(panel(first, index, title));
        }
    }
    let caption = format!("{}, frame {}", test.setting.name(), test.set.names()[index]);
    scene(test, index, caption, panels).map(Some)
}

fn panel(evaluated: &Evaluated, index: usize, title: &str) -> Panel {
    let objects = evaluated.objects[index].iter();
    let shown = objects.filter(|object| is_shown(evaluated, object));
    let scene_box = |object: &SensorDetection| SceneBox {
        class: object.class.clone(),
        unknown: object.kind == ObjectKind::Unknown,
        bounds: object.box_in_sensor,
    };
    Panel {
        title: title.to_owned(),
        boxes: shown.map(scene_box).collect(),
    }
}

fn is_shown(evaluated: &Evaluated, object: &SensorDetection) -> bool {
    if object.kind == ObjectKind::Unknown {
        let least = evaluated.unknown_score_min;
        least.is_some_and(|least| object.score >= least)
    } else {
        object.score >= f64::from(KNOWN_SCORE_MIN)
    }
}

fn scene(
    test: &TestFrames,
    index: usize,
    caption: String,
    panels: Vec<Panel>,
) -> Result<DrawnScene, EvaluateError> {
    let (points, truths) = (test.set.points(index)?, truths(test, index)?);
    let near = truths.iter().filter(|t| t.shown.unknown && t.counts);
    let nearest = near.min_by(|a, b| a.range_m.total_cmp(&b.range_m));
    let target_m = nearest.map_or([15.0, 0.0], |t| {
        let [x, y, _] = t.shown.bounds.center_m;
        [x, y]
    });
    let points = points.iter().map(|p| [p.x_m, p.y_m, p.z_m, p.intensity]);
    Ok(DrawnScene {
        caption,
        points: points.collect(),
        truth: truths.into_iter().map(|t| t.shown).collect(),
        panels,
        target_m,
    })
}

/// Unknown objects of a frame that were missed, and false ones that would be shown.
struct Errors {
    missed: Vec<(String, f64)>,
    false_unknown: usize,
}

fn errors(test: &TestFrames, evaluated: &Evaluated, index: usize) -> Result<Errors, EvaluateError> {
    let truths = truths(test, index)?;
    let unknown: Vec<&Truth> = truths.iter().filter(|t| t.shown.unknown).collect();
    let objects = evaluated.objects[index].iter();
    let unknown_ones = objects.filter(|object| object.kind == ObjectKind::Unknown);
    let found = unknown_ones.filter(|object| is_shown(evaluated, object));
    let found: Vec<Box3> = found.map(|object| object.box_in_sensor).collect();
    let hits = |b: &Box3, t: &Truth| iou_3d(b, &t.shown.bounds) > FOUND_IOU;
    let is_missed = |t: &&&Truth| t.counts && !found.iter().any(|b| hits(b, t));
    let missed = unknown.iter().filter(is_missed);
    let is_false = |b: &&Box3| !unknown.iter().any(|t| hits(b, t));
    Ok(Errors {
        missed: missed.map(|t| (t.shown.class.clone(), t.range_m)).collect(),
        false_unknown: found.iter().filter(is_false).count(),
    })
}

/// The frames in which a row did worst: most errors (a missed unknown object, a false one) first.
pub(crate) fn worst_scenes(
    test: &TestFrames,
    evaluated: &Evaluated,
) -> Result<Vec<DrawnScene>, EvaluateError> {
    let mut ranked: Vec<(usize, Errors)> = (0..evaluated.objects.len())
        .map(|index| Ok((index, errors(test, evaluated, index)?)))
        .collect::<Result<_, EvaluateError>>()?;
    let count = |e: &Errors| 2 * e.missed.len() + e.false_unknown;
    ranked.sort_by_key(|(index, e)| (Reverse(count(e)), *index));
    let title = MethodRow::find(&evaluated.method).map_or("", |row| &row.title);
    let worst = ranked.into_iter().take(WORST).filter(|(_, e)| count(e) > 0);
    let drawn = worst.map(|(index, errors)| {
        let named = errors.missed.iter().take(3);
        let missed: Vec<String> = named
            .map(|(class, range)| format!("{class} at {range:.0} m"))
            .collect();
        let caption = format!(
            "{}, {title}, frame {}\nmissed {}{}{}, false {}",
            test.setting.name(),
            test.set.names()[index],
            errors.missed.len(),
            if missed.is_empty() { "" } else { ": " },
            missed.join(", "),
            errors.false_unknown
        );
        scene(test, index, caption, vec![panel(evaluated, index, title)])
    });
    drawn.collect()
}
