//! Which labels and detections count for a class.

use crate::{CameraDetection, Difficulty, EvaluateError, LabelledFrame, ObjectKind};
use mluc_dataset::{Label, is_heard_of};
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
    pub kind: ObjectKind,
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
            kind: ObjectKind::Known,
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
            kind: ObjectKind::Unknown,
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
    pub(crate) fn claims(&self, detection: &CameraDetection) -> bool {
        let is_kind = detection.kind == self.kind;
        match self.kind {
            ObjectKind::Known => is_kind && detection.class.eq_ignore_ascii_case(&self.name),
            ObjectKind::Unknown => is_kind || contains(&self.valid, &detection.class),
        }
    }

    /// Whether labels of a class take part.
    fn judges(&self, class: &str) -> bool {
        contains(&self.valid, class) || contains(&self.ignored, class)
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
pub fn rules(
    request: &RuleRequest,
    frames: &[LabelledFrame],
) -> Result<Vec<ClassRule>, EvaluateError> {
    let unknown = request.unknown.iter().flat_map(|group| &group.classes);
    let unknown: Vec<String> = unknown.map(|c| c.to_ascii_lowercase()).collect();
    let with_overlap = request.iou_min.iter().map(|(class, _)| class);
    let named = request.classes.iter().chain(with_overlap);
    if let Some(class) = named.clone().find(|class| contains(&unknown, class)) {
        return Err(EvaluateError::Input(format!(
            "{class}: expected a class that is either known (--iou, --classes) or unknown (--unknown), found it in both"
        )));
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
        let found = labelled_and_detected(frames);
        found.iter().for_each(|class| add(class));
    } else {
        request.classes.iter().for_each(|class| add(class));
    }
    let mut rules = Vec::new();
    for class in known {
        let iou_min = checked(&class, overlap_of(&class, &request.iou_min))?;
        rules.push(ClassRule::known(&class, iou_min, request.neighbours));
    }
    if let Some(group) = &request.unknown {
        let iou_min = checked(UNKNOWN, group.iou_min)?;
        rules.push(ClassRule::unknown(&unknown, iou_min, group.protocol));
    }
    Ok(rules)
}

fn checked(class: &str, iou_min: f64) -> Result<f64, EvaluateError> {
    if (0.0..1.0).contains(&iou_min) {
        return Ok(iou_min);
    }
    Err(EvaluateError::Input(format!(
        "overlap of {class}: expected a number from 0 up to and without 1, found {iou_min}"
    )))
}

/// The overlap asked for, else KITTI's, else 0.7 for trucks and vans and 0.5 for others.
fn overlap_of(class: &str, asked: &[(String, f64)]) -> f64 {
    let mut asked = asked.iter().map(|(name, iou)| (name.as_str(), *iou));
    let mut defaults = KITTI_CLASSES
        .into_iter()
        .chain([("truck", 0.7), ("van", 0.7)]);
    let is_it = |(name, _): &(&str, f64)| name.eq_ignore_ascii_case(class);
    let found = asked.find(is_it).or_else(|| defaults.find(is_it));
    found.map_or(0.5, |(_, iou)| iou)
}

/// Classes that occur in the labels and in detections of kind known, in alphabetical order.
fn labelled_and_detected(frames: &[LabelledFrame]) -> BTreeSet<String> {
    let labels = frames.iter().flat_map(|frame| frame.labels.iter());
    let labelled: BTreeSet<String> = labels.map(|l| l.class.to_ascii_lowercase()).collect();
    let detections = frames.iter().flat_map(|frame| &frame.detections);
    let known = detections.filter(|d| d.kind == ObjectKind::Known);
    let detected: BTreeSet<String> = known.map(|d| d.class.to_ascii_lowercase()).collect();
    let mut both = &labelled & &detected;
    both.retain(|class| !NEVER_KNOWN_UNASKED.contains(&class.as_str()));
    both
}

/// Classes of labels that no rule judges and that are neither KITTI's nor the simulator's, in alphabetical order: misspelt ones, most likely.
pub fn unheard<'a>(labels: impl Iterator<Item = &'a Label>, rules: &[ClassRule]) -> Vec<String> {
    let classes: BTreeSet<&str> = labels.map(|label| label.class.as_str()).collect();
    let is_judged = |class: &str| rules.iter().any(|rule| rule.judges(class));
    let unheard = classes
        .into_iter()
        .filter(|c| !is_heard_of(c) && !is_judged(c));
    unheard.map(str::to_owned).collect()
}

/// Labelled classes that no rule judges and that KITTI does not leave out either, in alphabetical order: their labels
/// are background, which a person may not have meant.
pub fn unjudged(frames: &[LabelledFrame], rules: &[ClassRule]) -> Vec<String> {
    let labels = frames.iter().flat_map(|frame| frame.labels.iter());
    let mut classes: BTreeSet<String> = labels.map(|l| l.class.to_ascii_lowercase()).collect();
    classes.retain(|class| !NEVER_KNOWN_UNASKED.contains(&class.as_str()));
    classes.retain(|class| !rules.iter().any(|rule| rule.judges(class)));
    classes.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{camera_detection, label};

    fn frames(labels: &[&str], detections: &[&str]) -> Vec<LabelledFrame> {
        let label = |class: &&str| label(class, 0.0);
        let found = |class: &&str| camera_detection(ObjectKind::Known, class, 0.0, 0.5);
        vec![LabelledFrame {
            labels: labels.iter().map(label).collect(),
            detections: detections.iter().map(found).collect(),
        }]
    }

    fn unknown(class: &str) -> Option<UnknownRequest> {
        Some(UnknownRequest {
            classes: vec![class.into()],
            iou_min: 0.1,
            protocol: UnknownProtocol::Literal,
        })
    }

    fn names(rules: &[ClassRule]) -> Vec<(&str, f64)> {
        rules
            .iter()
            .map(|rule| (rule.name.as_str(), rule.iou_min))
            .collect()
    }

    #[test]
    fn misspelt_classes_are_unheard_of() {
        let classes = ["Car", "Carr", "golf_cart", "DontCare", "Barrier", "Carr"];
        let frames = frames(&classes, &[]);
        let request = RuleRequest {
            unknown: unknown("barrier"),
            ..RuleRequest::default()
        };
        let rules = rules(&request, &frames).expect("rules");
        assert_eq!(unheard(frames[0].labels.iter(), &rules), ["Carr"]);
        assert_eq!(unheard(frames[0].labels.iter(), &[]), ["Barrier", "Carr"]);
    }

    #[test]
    fn known_classes_are_kittis_and_those_labelled_and_detected_or_those_named() {
        let frames = frames(
            &["Car", "Truck", "Van", "Golf_cart", "Bus"],
            &["truck", "van", "golf_cart", "plane"],
        );
        let request = RuleRequest {
            iou_min: vec![("Car".to_owned(), 0.5)],
            unknown: unknown("golf_cart"),
            ..RuleRequest::default()
        };
        let found = rules(&request, &frames).expect("rules");
        let expected = [
            ("car", 0.5),
            ("pedestrian", 0.5),
            ("cyclist", 0.5),
            ("truck", 0.7),
            ("unknown", 0.1),
        ];
        assert_eq!(names(&found), expected);
        assert_eq!(unjudged(&frames, &found), ["bus"]);
        let request = RuleRequest {
            classes: vec!["Van".into()],
            ..RuleRequest::default()
        };
        let found = rules(&request, &frames).expect("rules");
        assert_eq!(names(&found), [("van", 0.7)]);
    }
}
