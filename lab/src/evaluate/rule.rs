//! Which labels and detections count for a class.

use super::{Detection, Difficulty, EvaluateError, Frame, Kind};
use crate::dataset::{Label, is_heard_of};
use std::collections::BTreeSet;

/// Name of the class into which all unknown classes are merged.
pub const UNKNOWN: &str = "unknown";

/// The devkit's classes with the overlap that it asks for.
const KITTI_CLASSES: [(&str, f64); 3] = [("car", 0.7), ("pedestrian", 0.5), ("cyclist", 0.5)];

/// Labelled classes that are never taken for known unless they are named: KITTI ignores them or counts them as
/// background.
const NEVER_KNOWN_UNASKED: [&str; 6] =
    ["dontcare", "misc", "tram", "van", "person_sitting", UNKNOWN];

/// What a class' look-alikes are to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NeighbourPolicy {
    /// As the devkit: a van found as a car, or a sitting person found as a pedestrian, is neither right nor wrong.
    #[default]
    Official,
    /// Such a detection is wrong.
    Strict,
}

/// What an unknown object may be found on, besides labels of unknown classes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UnknownProtocol {
    /// Nothing: whatever else is found is wrong.
    #[default]
    Literal,
    /// Trams, sitting persons and what is labelled Misc; and things where nobody labelled. None of them is right or wrong.
    Fair,
}

impl UnknownProtocol {
    /// Label classes that may be found or not.
    fn ignored(self) -> &'static [&'static str] {
        match self {
            UnknownProtocol::Literal => &[],
            UnknownProtocol::Fair => &["tram", "misc", "person_sitting"],
        }
    }

    /// A detection more than this share of which lies in a DontCare region of the image is not wrong.
    fn dont_care_max(self) -> Option<f64> {
        (self == UnknownProtocol::Fair).then_some(0.5)
    }
}

/// How one class is judged.
#[derive(Clone, Debug, PartialEq)]
pub struct ClassRule {
    /// Its name in reports, lower case.
    pub name: String,
    /// Known or unknown: which detections are of this class.
    pub kind: Kind,
    /// Label classes that are to be found, lower case.
    pub valid: Vec<String>,
    /// Label classes that may be found or not, lower case.
    pub ignored: Vec<String>,
    /// The overlap of a match must be greater.
    pub iou_min: f64,
    /// A detection more than this share of which lies in a DontCare region is not wrong, whatever the metric; in the image's
    /// metric the devkit asks for more than `iou_min` anyway. `None`: the devkit's rule alone.
    pub dont_care_max: Option<f64>,
}

fn contains(names: &[String], class: &str) -> bool {
    names.iter().any(|name| name.eq_ignore_ascii_case(class))
}

impl ClassRule {
    /// A known class.
    pub fn known(name: &str, iou_min: f64, policy: NeighbourPolicy) -> ClassRule {
        let name = name.to_ascii_lowercase();
        let neighbour = match (policy, name.as_str()) {
            (NeighbourPolicy::Official, "car") => Some("van"),
            (NeighbourPolicy::Official, "pedestrian") => Some("person_sitting"),
            _ => None,
        };
        let ignored = neighbour.into_iter().map(str::to_owned).collect();
        ClassRule {
            valid: vec![name.clone()],
            name,
            kind: Kind::Known,
            ignored,
            iou_min,
            dont_care_max: None,
        }
    }

    /// The class of everything unknown: labels of `classes` merged into one.
    pub fn unknown(classes: &[String], iou_min: f64, protocol: UnknownProtocol) -> ClassRule {
        let valid: Vec<String> = classes
            .iter()
            .map(|class| class.to_ascii_lowercase())
            .collect();
        let ignored = protocol.ignored().iter().map(|class| (*class).to_owned());
        let ignored = ignored.filter(|class| !valid.contains(class)).collect();
        ClassRule {
            name: UNKNOWN.to_owned(),
            kind: Kind::Unknown,
            valid,
            ignored,
            iou_min,
            dont_care_max: protocol.dont_care_max(),
        }
    }

    /// `Some(true)` for a label that is to be found, `Some(false)` for one that may be, `None` for any other.
    pub(crate) fn label_counts(&self, label: &Label) -> Option<bool> {
        if contains(&self.valid, &label.class) {
            Some(true)
        } else {
            contains(&self.ignored, &label.class).then_some(false)
        }
    }

    /// Whether a label is to be found and easy enough to count as missed when it is not.
    pub(crate) fn counts_at(&self, label: &Label, difficulty: Difficulty) -> bool {
        self.label_counts(label) == Some(true) && difficulty.takes(label)
    }

    /// Whether a detection claims to be of this class. A detector that was trained on unknown classes names them: its
    /// detections are merged as the labels are.
    pub(crate) fn claims(&self, detection: &Detection) -> bool {
        match self.kind {
            Kind::Known => {
                detection.kind == Kind::Known && detection.class.eq_ignore_ascii_case(&self.name)
            }
            Kind::Unknown => {
                detection.kind == Kind::Unknown || contains(&self.valid, &detection.class)
            }
        }
    }
}

/// What the unknown group is asked to be.
#[derive(Clone, Debug)]
pub struct UnknownRequest {
    /// Label classes that are unknown.
    pub classes: Vec<String>,
    /// Overlap, more than which is a match; the paper asks for 0.1.
    pub iou_min: f64,
    /// What may be found besides labels of these classes.
    pub protocol: UnknownProtocol,
}

/// What an evaluation is asked for.
#[derive(Clone, Debug, Default)]
pub struct RuleRequest {
    /// Exactly these known classes; empty: KITTI's three, those with an overlap of their own, and any labelled class
    /// that a detection of kind known names.
    pub classes: Vec<String>,
    /// Overlaps of classes; the others keep KITTI's, or 0.7 for trucks and vans, or 0.5.
    pub iou_min: Vec<(String, f64)>,
    /// The unknown group, if any.
    pub unknown: Option<UnknownRequest>,
    /// What look-alikes are.
    pub neighbours: NeighbourPolicy,
}

/// The rules of an evaluation: the known classes in order, then the unknown group if there is one.
pub fn rules(request: &RuleRequest, frames: &[Frame]) -> Result<Vec<ClassRule>, EvaluateError> {
    let unknown: Vec<String> = request
        .unknown
        .iter()
        .flat_map(|u| &u.classes)
        .map(|c| c.to_ascii_lowercase())
        .collect();
    let named = request
        .classes
        .iter()
        .chain(request.iou_min.iter().map(|(class, _)| class));
    if let Some(class) = named.clone().find(|class| contains(&unknown, class)) {
        return Err(EvaluateError::KnownAndUnknown {
            class: class.clone(),
        });
    }
    let mut known: Vec<String> = Vec::new();
    let mut add = |class: &str| {
        let class = class.to_ascii_lowercase();
        if !known.contains(&class) && !unknown.contains(&class) {
            known.push(class);
        }
    };
    if request.classes.is_empty() {
        KITTI_CLASSES.iter().for_each(|(class, _)| add(class));
        named.for_each(|class| add(class));
        labelled_and_detected(frames)
            .iter()
            .for_each(|class| add(class));
    } else {
        request.classes.iter().for_each(|class| add(class));
    }
    let mut rules = Vec::new();
    for class in known {
        let iou_min = checked(&class, overlap_of(&class, &request.iou_min))?;
        rules.push(ClassRule::known(&class, iou_min, request.neighbours));
    }
    if let Some(group) = &request.unknown {
        rules.push(ClassRule::unknown(
            &unknown,
            checked(UNKNOWN, group.iou_min)?,
            group.protocol,
        ));
    }
    Ok(rules)
}

fn checked(class: &str, iou_min: f64) -> Result<f64, EvaluateError> {
    if (0.0..1.0).contains(&iou_min) {
        Ok(iou_min)
    } else {
        Err(EvaluateError::Overlap {
            class: class.to_owned(),
            found: iou_min,
        })
    }
}

fn overlap_of(class: &str, asked: &[(String, f64)]) -> f64 {
    let asked = asked
        .iter()
        .find(|(name, _)| name.eq_ignore_ascii_case(class))
        .map(|&(_, overlap)| overlap);
    let usual = || {
        KITTI_CLASSES
            .iter()
            .find(|(name, _)| *name == class)
            .map(|&(_, overlap)| overlap)
    };
    asked
        .or_else(usual)
        .unwrap_or(if matches!(class, "truck" | "van") {
            0.7
        } else {
            0.5
        })
}

/// Classes that occur in the labels and in detections of kind known, in alphabetical order.
fn labelled_and_detected(frames: &[Frame]) -> Vec<String> {
    let detections = frames
        .iter()
        .flat_map(|frame| &frame.detections)
        .filter(|d| d.kind == Kind::Known);
    let mut classes: Vec<String> = detections.map(|d| d.class.to_ascii_lowercase()).collect();
    classes.sort();
    classes.dedup();
    classes.retain(|class| !NEVER_KNOWN_UNASKED.contains(&class.as_str()));
    classes.retain(|class| {
        frames
            .iter()
            .any(|frame| frame.labels.iter().any(|label| label.is(class)))
    });
    classes
}

/// Classes of labels that no rule judges and that are neither KITTI's nor the simulator's, in alphabetical order: misspelt ones, most likely.
pub fn unheard<'a>(labels: impl Iterator<Item = &'a Label>, rules: &[ClassRule]) -> Vec<String> {
    let is_judged = |class: &str| {
        let class = class.to_ascii_lowercase();
        let mut rules = rules.iter();
        rules.any(|rule| rule.valid.contains(&class) || rule.ignored.contains(&class))
    };
    let classes = labels.map(|label| label.class.as_str());
    let unheard: BTreeSet<&str> = classes
        .filter(|class| !is_heard_of(class) && !is_judged(class))
        .collect();
    unheard.into_iter().map(str::to_owned).collect()
}

/// Labelled classes that no rule judges and that KITTI does not leave out either, in alphabetical order: their labels
/// are background, which a person may not have meant.
pub fn unjudged(frames: &[Frame], rules: &[ClassRule]) -> Vec<String> {
    let judged = |class: &String| {
        NEVER_KNOWN_UNASKED.contains(&class.as_str())
            || rules
                .iter()
                .any(|rule| rule.valid.contains(class) || rule.ignored.contains(class))
    };
    let labels = frames.iter().flat_map(|frame| frame.labels.iter());
    let mut classes: Vec<String> = labels
        .map(|label| label.class.to_ascii_lowercase())
        .collect();
    classes.sort();
    classes.dedup();
    classes.retain(|class| !judged(class));
    classes
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_geometry::{Box3, CameraBox};

    fn frames(labels: &[&str], detections: &[&str]) -> Vec<Frame> {
        let camera_box = CameraBox {
            location_m: [0.0; 3],
            size_hwl_m: [1.0; 3],
            rotation_y_rad: 0.0,
        };
        let label = |class: &&str| Label {
            class: (*class).to_owned(),
            truncated: 0.0,
            occluded: 0,
            alpha_rad: 0.0,
            image_box_px: [0.0; 4],
            camera_box,
            score: None,
        };
        let detection = |class: &&str| Detection {
            kind: Kind::Known,
            class: (*class).to_owned(),
            score: 0.5,
            image_box_px: [0.0; 4],
            upright: Box3::new([0.0; 7]),
        };
        vec![Frame {
            labels: labels.iter().map(label).collect(),
            detections: detections.iter().map(detection).collect(),
        }]
    }

    fn names(request: &RuleRequest, frames: &[Frame]) -> Vec<(String, f64)> {
        rules(request, frames)
            .expect("rules")
            .into_iter()
            .map(|rule| (rule.name, rule.iou_min))
            .collect()
    }

    fn pairs(expected: &[(&str, f64)]) -> Vec<(String, f64)> {
        expected
            .iter()
            .map(|&(name, iou)| (name.to_owned(), iou))
            .collect()
    }

    #[test]
    fn misspelt_classes_are_unheard_of() {
        let frames = frames(
            &["Car", "Carr", "golf_cart", "DontCare", "Barrier", "Carr"],
            &[],
        );
        let request = RuleRequest {
            unknown: Some(UnknownRequest {
                classes: vec!["barrier".into()],
                iou_min: 0.1,
                protocol: UnknownProtocol::Literal,
            }),
            ..RuleRequest::default()
        };
        let rules = rules(&request, &frames).expect("rules");
        assert_eq!(unheard(frames[0].labels.iter(), &rules), ["Carr"]);
        assert_eq!(unheard(frames[0].labels.iter(), &[]), ["Barrier", "Carr"]);
    }

    #[test]
    fn known_classes_are_kittis_and_those_labelled_and_detected() {
        let frames = frames(
            &["Car", "Truck", "Van", "Golf_cart", "Bus"],
            &["truck", "van", "golf_cart", "plane"],
        );
        let unknown = UnknownRequest {
            classes: vec!["golf_cart".into()],
            iou_min: 0.1,
            protocol: UnknownProtocol::Literal,
        };
        let request = RuleRequest {
            iou_min: vec![("Car".to_owned(), 0.5)],
            unknown: Some(unknown),
            ..RuleRequest::default()
        };
        let expected = [
            ("car", 0.5),
            ("pedestrian", 0.5),
            ("cyclist", 0.5),
            ("truck", 0.7),
            ("unknown", 0.1),
        ];
        assert_eq!(names(&request, &frames), pairs(&expected));
        assert_eq!(
            unjudged(&frames, &rules(&request, &frames).expect("rules")),
            ["bus"]
        );
    }

    #[test]
    fn classes_can_be_named_exactly() {
        let request = RuleRequest {
            classes: vec!["Van".into()],
            ..RuleRequest::default()
        };
        assert_eq!(
            names(&request, &frames(&["Car"], &["car"])),
            pairs(&[("van", 0.7)])
        );
    }
}
