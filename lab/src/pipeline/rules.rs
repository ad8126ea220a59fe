//! Overlaps and unknown classes of the settings that the paper reports (section 4.1).

use super::PipelineError;
use crate::evaluate::{
    ClassRule, NeighbourPolicy, RuleRequest, UnknownProtocol, UnknownRequest, rules,
};
use mluc_model::Model;

/// The paper's overlap of an unknown.
const UNKNOWN_IOU_MIN: f64 = 0.1;

/// Overlap asked of a known class: KITTI's 0.7 for its cars, 0.5 in the industrial park; 0.7 for trucks and vans.
pub fn known_iou_min(model_name: &str, class: &str) -> f64 {
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

/// One rule a known class of the model, then one for `unknown` if there is any such class.
pub(super) fn class_rules(
    model: &Model,
    unknown: &[String],
    neighbours: NeighbourPolicy,
) -> Result<Vec<ClassRule>, PipelineError> {
    let manifest = &model.manifest;
    let classes: Vec<String> = manifest.classes.iter().map(|c| c.name.clone()).collect();
    let overlap = |class: &String| (class.clone(), known_iou_min(&manifest.name, class));
    let request = RuleRequest {
        iou_min: classes.iter().map(overlap).collect(),
        classes,
        unknown: (!unknown.is_empty()).then(|| UnknownRequest {
            classes: unknown.to_vec(),
            iou_min: UNKNOWN_IOU_MIN,
            protocol: UnknownProtocol::Literal,
        }),
        neighbours,
    };
    // The classes are named, so the frames are not asked for them.
    Ok(rules(&request, &[])?)
}
