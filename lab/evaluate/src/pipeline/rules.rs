//! Overlaps and unknown classes of the settings that the paper reports (section 4.1).

use crate::{
    ClassRule, EvaluateError, NeighbourPolicy, RuleRequest, UNKNOWN_IOUS, UnknownProtocol, rules,
};

/// Overlap asked of a known class: KITTI's 0.7 for its cars, 0.5 in the industrial park; 0.7 for trucks and vans.
fn known_iou_min(model_name: &str, class: &str) -> f64 {
    match (model_name, class) {
        ("kitti", "car") | (_, "truck" | "van") => 0.7,
        _ => 0.5,
    }
}

/// Label classes that the paper keeps from training in a model's setting; none where it has no such setting.
pub fn unknown_classes(model_name: &str) -> Vec<String> {
    let names: &[&str] = match model_name {
        "udi" => &["golf_cart", "forklift"],
        "kitti" => &["van", "truck"],
        _ => &[],
    };
    names.iter().map(|name| (*name).to_owned()).collect()
}

/// One rule a known class at the paper's overlap in a model's setting, then one for `unknown` if there is any such class.
pub fn paper_rules(
    model_name: &str,
    known: &[String],
    unknown: &[String],
    neighbours: NeighbourPolicy,
) -> Result<Vec<ClassRule>, EvaluateError> {
    let overlap = |class: &String| (class.clone(), known_iou_min(model_name, class));
    let request = RuleRequest {
        classes: known.to_vec(),
        iou_min: known.iter().map(overlap).collect(),
        unknown: unknown.to_vec(),
        unknown_iou_min: UNKNOWN_IOUS[0],
        protocol: UnknownProtocol::Literal,
        neighbours,
    };
    // The classes are named, so the frames are not asked for them.
    rules(&request, &[])
}
