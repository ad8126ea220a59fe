//! Scenes for the figures: which frames are shown, and what each row found in them.

use super::ReproduceError;
use super::evaluate::setting_rules;
use super::evaluated::{Evaluated, StoredObject};
use super::run::Test;
use crate::dataset::Label;
use crate::evaluate::{Difficulty, Kind};
use crate::report::{Panel, Scene, SceneBox, method_row};
use mluc_geometry::{Box3, iou_3d};
use std::collections::BTreeMap;

/// Columns of figure 6 beside the labels, as far as they were evaluated; of two with one title the first.
const SHOWN: [(&str, &str); 6] = [
    ("closed-set", "Closed set"),
    ("naive", "Naive"),
    ("osis", "OSIS"),
    ("osis-geo", "OSIS"),
    ("mluc-corrected", "MLUC"),
    ("improved", "Improved"),
];
/// Known objects of a lower score are left out of pictures.
const KNOWN_SCORE_MIN: f32 = 0.3;
/// Objects further away are hard to see in a picture, m.
const NEAR_M: f64 = 32.0;
/// A detection that overlaps a label by more has found it.
const FOUND_IOU: f64 = 0.1;
/// Frames on the page of the worst.
const WORST: usize = 6;

/// A label with its box in the sensor frame.
struct Truth {
    label: Label,
    bounds: Box3,
    unknown: bool,
    counts: bool,
}

/// Labels of a frame that are seen at all (in view of the camera where there is one).
fn truths(test: &Test, index: usize) -> Result<Vec<Truth>, ReproduceError> {
    let rules = setting_rules(test.setting)?;
    let truth = test.set.truth(index)?;
    let known = |label: &Label| {
        rules
            .iter()
            .find(|rule| rule.valid.iter().any(|class| label.is(class)))
    };
    let seen = truth.labels.iter().filter(|label| !label.is_dont_care());
    Ok(seen
        .map(|label| {
            let rule = known(label);
            Truth {
                bounds: truth
                    .view
                    .calibration
                    .box_in_sensor_from_label(&label.camera_box),
                unknown: rule.is_some_and(|rule| rule.kind == Kind::Unknown),
                counts: rule.is_some() && Difficulty::Moderate.takes(label),
                label: label.clone(),
            }
        })
        .collect())
}

fn range_m(bounds: &Box3) -> f64 {
    bounds.center_m[0].hypot(bounds.center_m[1])
}

/// The scene of figure 6: of the frames with an unknown object that counts within 32 m, the one with most of them, then with most
/// known objects as near; chosen by labels alone. `None` where there is none such, or nothing was evaluated.
pub(super) fn figure6_scene(
    test: &Test,
    evaluated: &BTreeMap<&'static str, Vec<Evaluated>>,
) -> Result<Option<Scene>, ReproduceError> {
    let mut best: Option<([usize; 2], usize)> = None;
    for index in 0..test.set.len() {
        let truths = truths(test, index)?;
        let near = truths
            .iter()
            .filter(|t| t.counts && range_m(&t.bounds) < NEAR_M);
        let (unknown, known): (Vec<_>, Vec<_>) = near.partition(|t| t.unknown);
        let worth = [unknown.len(), known.len()];
        if worth[0] > 0 && best.is_none_or(|(most, _)| worth > most) {
            best = Some((worth, index));
        }
    }
    let Some((_, index)) = best else {
        return Ok(None);
    };
    let mut panels = Vec::new();
    for (method, title) in SHOWN {
        let shown = panels.iter().any(|panel: &Panel| panel.title == title);
        if let (false, Some(evaluated)) =
            (shown, evaluated.get(method).and_then(|seeds| seeds.first()))
        {
            panels.push(panel(evaluated, index, title));
        }
    }
    let caption = format!("{}, frame {}", test.setting.name(), test.set.names()[index]);
    Ok(Some(scene(test, index, caption, panels)?))
}

fn panel(evaluated: &Evaluated, index: usize, title: &str) -> Panel {
    let shown = evaluated.objects[index]
        .iter()
        .filter(|object| is_shown(evaluated, object));
    Panel {
        title: title.to_owned(),
        boxes: shown
            .map(|object| SceneBox {
                class: object.1.clone(),
                unknown: object.0,
                bounds: object.bounds(),
            })
            .collect(),
    }
}

fn is_shown(evaluated: &Evaluated, object: &StoredObject) -> bool {
    match (object.0, evaluated.unknown_score_min) {
        (true, Some(least)) => f64::from(object.2) >= least,
        (true, None) => false,
        (false, _) => object.2 >= KNOWN_SCORE_MIN,
    }
}

fn scene(
    test: &Test,
    index: usize,
    caption: String,
    panels: Vec<Panel>,
) -> Result<Scene, ReproduceError> {
    let points = test.set.points(index)?;
    let truths = truths(test, index)?;
    let near = truths.iter().filter(|t| t.unknown && t.counts);
    let nearest = near.min_by(|a, b| range_m(&a.bounds).total_cmp(&range_m(&b.bounds)));
    let target = nearest.map_or([15.0, 0.0], |t| {
        [t.bounds.center_m[0], t.bounds.center_m[1]]
    });
    Ok(Scene {
        caption,
        points: points
            .iter()
            .map(|p| [p.x_m, p.y_m, p.z_m, p.intensity])
            .collect(),
        truth: truths
            .into_iter()
            .map(|t| SceneBox {
                class: t.label.class,
                unknown: t.unknown,
                bounds: t.bounds,
            })
            .collect(),
        panels,
        target_m: target,
    })
}

/// Unknown objects of a frame that were missed, and false ones that would be shown.
struct Errors {
    missed: Vec<(String, f64)>,
    false_unknown: usize,
}

fn errors(test: &Test, evaluated: &Evaluated, index: usize) -> Result<Errors, ReproduceError> {
    let truths = truths(test, index)?;
    let unknown: Vec<&Truth> = truths.iter().filter(|t| t.unknown).collect();
    let found: Vec<Box3> = evaluated.objects[index]
        .iter()
        .filter(|object| object.0 && is_shown(evaluated, object))
        .map(StoredObject::bounds)
        .collect();
    let hits = |truth: &Truth| found.iter().any(|b| iou_3d(b, &truth.bounds) > FOUND_IOU);
    let missed = unknown.iter().filter(|t| t.counts && !hits(t));
    let is_false = |b: &&Box3| unknown.iter().all(|t| iou_3d(b, &t.bounds) <= FOUND_IOU);
    Ok(Errors {
        missed: missed
            .map(|t| (t.label.class.clone(), range_m(&t.bounds)))
            .collect(),
        false_unknown: found.iter().filter(is_false).count(),
    })
}

/// The frames in which a row did worst: most errors (a missed unknown object, a false one) first.
pub(super) fn worst_scenes(
    test: &Test,
    evaluated: &Evaluated,
) -> Result<Vec<Scene>, ReproduceError> {
    let mut ranked: Vec<(usize, Errors)> = (0..evaluated.objects.len())
        .map(|index| Ok((index, errors(test, evaluated, index)?)))
        .collect::<Result<_, ReproduceError>>()?;
    ranked.sort_by_key(|(index, e)| {
        (
            std::cmp::Reverse(2 * e.missed.len() + e.false_unknown),
            *index,
        )
    });
    let title = method_row(&evaluated.method).map_or("", |row| row.title);
    let worst = ranked
        .into_iter()
        .take(WORST)
        .filter(|(_, e)| e.missed.len() + e.false_unknown > 0);
    worst
        .map(|(index, errors)| {
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
        })
        .collect()
}
