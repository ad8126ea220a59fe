//! Which labels and detections count for a class.

use crate::{Difficulty, EvaluateError, LabelledFrame, ObjectKind, Result, UNKNOWN};
use clap::{Args, ValueEnum};
use mluc_dataset::{Label, is_recognized};
use std::collections::BTreeSet;

/// Overlaps for the unknown: the paper's 0.1 first, then two that show how well the boxes fit.
pub const UNKNOWN_IOUS: [f64; 3] = [0.1, 0.25, 0.5];
/// The devkit's classes with the overlap that it requires.
const KITTI_CLASSES: [(&str, f64); 3] = [("car", 0.7), ("pedestrian", 0.5), ("cyclist", 0.5)];

/// Labelled classes that are known only where they are named: KITTI ignores them or counts them as background.
const NEVER_KNOWN_UNASKED: [&str; 6] =
    ["dontcare", "misc", "tram", "van", "person_sitting", UNKNOWN];

/// What an unknown object may be found on, besides labels of unknown classes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum UnknownProtocol {
    /// Nothing: whatever else is found is wrong.
    #[default]
    Literal,
    /// Trams, sitting persons and what is labelled Misc; and things where nobody labelled. None of them is right or wrong.
    Fair,
}

/// The evaluation rule of one class.
#[derive(Clone, Debug, PartialEq)]
pub struct ClassRule {
    /// Its name in reports, lower case.
    pub name: String,
    /// Known or unknown: which detections are of this class.
    pub kind: ObjectKind,
    /// Label classes that have to be found, lower case.
    pub valid: Vec<String>,
    /// Label classes that may be found or not, lower case; a class that is also in `valid` has to be found.
    pub ignored: Vec<String>,
    /// The overlap of a match must be greater than this.
    pub iou_min: f64,
    /// A detection is not wrong when more than this share of its image box is in a DontCare region, whatever the metric. In the image
    /// metric the devkit also excuses a share above `iou_min`. `None`: the devkit's rule alone.
    pub dont_care_max: Option<f64>,
}

fn contains(names: &[String], class: &str) -> bool {
    names.iter().any(|name| name.eq_ignore_ascii_case(class))
}

impl ClassRule {
    /// A known class. As in the devkit, a van found as a car, or a sitting person found as a pedestrian, is neither right nor wrong.
    pub fn known(name: &str, iou_min: f64) -> ClassRule {
        let name = name.to_ascii_lowercase();
        let ignored: &[&str] = match name.as_str() {
            "car" => &["van"],
            "pedestrian" => &["person_sitting"],
            _ => &[],
        };
        ClassRule {
            valid: vec![name.clone()],
            name,
            kind: ObjectKind::Known,
            ignored: ignored.iter().map(|class| (*class).to_owned()).collect(),
            iou_min,
            dont_care_max: None,
        }
    }

    /// The class of all unknown objects: labels of `classes` merged into one class.
    pub fn unknown(classes: &[String], iou_min: f64, protocol: UnknownProtocol) -> ClassRule {
        let (ignored, dont_care_max): (&[&str], _) = match protocol {
            UnknownProtocol::Literal => (&[], None),
            UnknownProtocol::Fair => (&["tram", "misc", "person_sitting"], Some(0.5)),
        };
        let ignored = ignored.iter().map(|class| (*class).to_owned());
        ClassRule {
            name: UNKNOWN.to_owned(),
            kind: ObjectKind::Unknown,
            valid: classes.iter().map(|c| c.to_ascii_lowercase()).collect(),
            ignored: ignored.filter(|class| !contains(classes, class)).collect(),
            iou_min,
            dont_care_max,
        }
    }

    /// `Some(true)` for a label that has to be found, `Some(false)` for a label that may be found, `None` for any other.
    pub(crate) fn label_counts(&self, label: &Label) -> Option<bool> {
        if contains(&self.valid, &label.class) {
            Some(true)
        } else {
            contains(&self.ignored, &label.class).then_some(false)
        }
    }

    /// Whether a label has to be found and is easy enough to count as missed when it is not.
    pub(crate) fn counts_at(&self, label: &Label, difficulty: Difficulty) -> bool {
        self.label_counts(label) == Some(true) && difficulty.takes(label)
    }

    /// Whether a detection is of this class. A detector that was trained on unknown classes names them: its detections are merged like the labels.
    pub(crate) fn claims(&self, detection: &Label) -> bool {
        match self.kind {
            ObjectKind::Known => detection.is(&self.name),
            ObjectKind::Unknown => detection.is(UNKNOWN) || contains(&self.valid, &detection.class),
        }
    }
}

/// What an evaluation is asked for.
#[derive(Args, Clone, Debug, Default)]
pub struct RuleRequest {
    /// The known classes, exactly [default: KITTI's three, those with an overlap of their own, and any labelled class that a detection of kind known names].
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    pub classes: Vec<String>,
    /// Overlap a class: a match needs more than it [default: KITTI's, 0.7 for trucks and vans, 0.5 for others].
    #[arg(long = "iou", value_delimiter = ',', value_parser = class_overlap, value_name = "CLASS=IOU,..")]
    pub iou_min: Vec<(String, f64)>,
    /// Label classes that are unknown; they are merged into one class, `unknown`. unseen: those of `simulate --unseen`.
    #[arg(long, value_delimiter = ',', value_name = "CLASS,..")]
    pub unknown: Vec<String>,
    /// Overlap of the unknown class; the paper asks for 0.1.
    #[arg(long = "unknown-iou", default_value_t = 0.1, value_name = "IOU", requires = "unknown")]
    pub unknown_iou_min: f64,
    /// What may be found besides labels of these classes.
    #[arg(skip)]
    pub protocol: UnknownProtocol,
}

fn class_overlap(text: &str) -> std::result::Result<(String, f64), String> {
    let pair = text.split_once('=').filter(|(class, _)| !class.trim().is_empty());
    pair.and_then(|(class, iou)| Some((class.trim().to_owned(), iou.trim().parse().ok()?)))
        .ok_or_else(|| format!("expected CLASS=IOU such as car=0.5, found '{text}'"))
}

/// The rules of an evaluation: the known classes in order, then the unknown group if there is one.
pub fn rules(request: &RuleRequest, frames: &[LabelledFrame]) -> Result<Vec<ClassRule>> {
    let lower = |class: &String| class.to_ascii_lowercase();
    let unknown: Vec<String> = request.unknown.iter().map(lower).collect();
    let with_overlap = request.iou_min.iter().map(|(class, _)| class);
    let named = request.classes.iter().chain(with_overlap.clone());
    if let Some(class) = named.clone().find(|class| contains(&unknown, class)) {
        return Err(EvaluateError::Input(format!(
            "{class}: expected a class that is either known (of the model, --iou, --classes) or unknown (--unknown), found it in both"
        )));
    }
    let is_named = |class: &String| request.classes.is_empty() || contains(&request.classes, class);
    let is_known = |class: &String| !class.eq_ignore_ascii_case(UNKNOWN) && is_named(class);
    if let Some(class) = with_overlap.clone().find(|class| !is_known(class)) {
        let text = format!("--iou {class}: expected a known class of --classes, if it is given");
        return Err(EvaluateError::Input(text));
    }
    let mut known: Vec<String> = if request.classes.is_empty() {
        let kitti = KITTI_CLASSES.iter().map(|(class, _)| (*class).to_owned());
        let detections = frames.iter().flat_map(|frame| &frame.detections);
        let detected: BTreeSet<String> = detections.map(|d| lower(&d.class)).collect();
        let found = &labelled(frames) & &detected;
        kitti.chain(named.map(lower)).chain(found).collect()
    } else {
        request.classes.iter().map(lower).collect()
    };
    let mut seen: BTreeSet<String> = unknown.iter().cloned().collect();
    known.retain(|class| seen.insert(class.clone()));
    let mut rules = Vec::new();
    for class in known {
        let iou_min = checked(&class, overlap_of(&class, &request.iou_min))?;
        rules.push(ClassRule::known(&class, iou_min));
    }
    if !unknown.is_empty() {
        let iou_min = checked(UNKNOWN, request.unknown_iou_min)?;
        rules.push(ClassRule::unknown(&unknown, iou_min, request.protocol));
    }
    Ok(rules)
}

/// Label classes that the paper excludes from training in a model's setting (section 4.1); none where the paper has no such setting.
pub fn unknown_classes(model_name: &str) -> Vec<String> {
    let names: &[&str] = match model_name {
        "udi" => &["golf_cart", "forklift"],
        "kitti" => &["van", "truck"],
        "any" => &["van", "truck", "golf_cart", "forklift"],
        _ => &[],
    };
    names.iter().map(|name| (*name).to_owned()).collect()
}

/// One rule per known class at the paper's overlap in a model's setting (KITTI's, but 0.5 for cars elsewhere), then one for `unknown` if it has classes.
pub fn paper_rules(model: &str, known: &[String], unknown: &[String]) -> Result<Vec<ClassRule>> {
    let is_other = |class: &&String| class.eq_ignore_ascii_case("car") && model != "kitti";
    let cars = known.iter().filter(is_other);
    let request = RuleRequest {
        classes: known.to_vec(),
        iou_min: cars.map(|car| (car.clone(), 0.5)).collect(),
        unknown: unknown.to_vec(),
        unknown_iou_min: UNKNOWN_IOUS[0],
        ..RuleRequest::default()
    };
    // The classes are named, so no frames are needed to find them.
    rules(&request, &[])
}

fn checked(class: &str, iou_min: f64) -> Result<f64> {
    if (0.0..1.0).contains(&iou_min) {
        return Ok(iou_min);
    }
    Err(EvaluateError::Input(format!(
        "overlap of {class}: expected a number from 0 up to and without 1, found {iou_min}"
    )))
}

/// The requested overlap, else KITTI's, else 0.7 for trucks and vans and 0.5 for others.
fn overlap_of(class: &str, asked: &[(String, f64)]) -> f64 {
    let known = asked.iter().map(|(name, iou)| (name.as_str(), *iou)).chain(KITTI_CLASSES);
    let mut known = known.chain([("truck", 0.7), ("van", 0.7)]);
    known.find(|(name, _)| name.eq_ignore_ascii_case(class)).map_or(0.5, |(_, iou)| iou)
}

/// Labelled classes that KITTI does not ignore.
fn labelled(frames: &[LabelledFrame]) -> BTreeSet<String> {
    let labels = frames.iter().flat_map(|frame| frame.labels.iter());
    let classes = labels.map(|label| label.class.to_ascii_lowercase());
    let counts = |class: &String| !NEVER_KNOWN_UNASKED.contains(&class.as_str());
    classes.filter(counts).collect()
}

fn is_judged(class: &str, rules: &[ClassRule]) -> bool {
    rules.iter().any(|rule| contains(&rule.valid, class) || contains(&rule.ignored, class))
}

/// Classes of labels that no rule covers and that are neither KITTI's nor the simulator's, in alphabetical order: probably misspelt.
pub fn unrecognized<'a>(all: impl Iterator<Item = &'a Label>, rules: &[ClassRule]) -> Vec<String> {
    let classes: BTreeSet<&str> = all.map(|label| label.class.as_str()).collect();
    let unrecognized = |class: &&str| !is_recognized(class) && !is_judged(class, rules);
    classes.into_iter().filter(unrecognized).map(str::to_owned).collect()
}

/// Labelled classes that no rule covers and that KITTI does not ignore, in alphabetical order: their labels count as background,
/// which may not be intended.
pub fn unevaluated(frames: &[LabelledFrame], rules: &[ClassRule]) -> Vec<String> {
    labelled(frames).into_iter().filter(|class| !is_judged(class, rules)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{found_at, frame, label};

    fn frames(labels: &[&str], detections: &[&str]) -> Vec<LabelledFrame> {
        let label = |class: &&str| label(class, 0.0);
        let found = |class: &&str| found_at(0.0, class, 0.5);
        let labels = labels.iter().map(label).collect();
        vec![frame(labels, detections.iter().map(found).collect())]
    }

    fn names(rules: &[ClassRule]) -> Vec<(&str, f64)> {
        rules.iter().map(|r| (&*r.name, r.iou_min)).collect()
    }

    #[test]
    fn misspelt_classes_are_unrecognized() {
        let classes = ["Car", "Carr", "golf_cart", "DontCare", "Barrier", "Carr"];
        let frames = frames(&classes, &[]);
        let request = RuleRequest { unknown: vec!["barrier".to_owned()], ..RuleRequest::default() };
        let rules = rules(&request, &frames).expect("rules");
        assert_eq!(unrecognized(frames[0].labels.iter(), &rules), ["Carr"]);
        let others = unrecognized(frames[0].labels.iter(), &[]);
        assert_eq!(others, ["Barrier", "Carr"]);
    }

    #[test]
    fn known_classes_are_kittis_and_those_labelled_and_detected_or_those_named() {
        let frames = frames(
            &["Car", "Truck", "Van", "Golf_cart", "Bus"],
            &["truck", "van", "golf_cart", "plane"],
        );
        let request = RuleRequest {
            iou_min: vec![("Car".to_owned(), 0.5)],
            unknown: vec!["golf_cart".to_owned()],
            unknown_iou_min: 0.1,
            ..RuleRequest::default()
        };
        let found = rules(&request, &frames).expect("rules");
        let expected =
            [("car", 0.5), ("pedestrian", 0.5), ("cyclist", 0.5), ("truck", 0.7), ("unknown", 0.1)];
        assert_eq!(names(&found), expected);
        assert_eq!(unevaluated(&frames, &found), ["bus"]);
        let request = RuleRequest { classes: vec!["Van".into()], ..RuleRequest::default() };
        let found = rules(&request, &frames).expect("rules");
        assert_eq!(names(&found), [("van", 0.7)]);
    }
}
