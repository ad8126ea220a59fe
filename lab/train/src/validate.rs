//! How well a model file detects the known classes of a labelled folder.
//!
//! Runs the inference engine, the one of the vehicle, frame by frame, and judges as the paper does (section 4.1): 3-D
//! overlap, difficulty moderate, average precision at 40 positions.

use std::path::Path;

use mluc_backbone::Precision;
use mluc_evaluate::pipeline::{DetectedFrame, FrameSet, GatedObjects, detect_frames, paper_rules};
use mluc_evaluate::{ApReport, EvaluateError, evaluate};
use mluc_model::Model;

/// Judges `model` on the first `most` frames of a folder; returns also how many frames and boxes there were. Boxes without a class are no known objects.
pub(crate) fn validate(
    model: &Model,
    folder: &Path,
    most: usize,
) -> Result<(ApReport, usize, usize), EvaluateError> {
    let set = FrameSet::open(folder, None, most)?;
    let mut frames = detect_frames(Precision::default(), model, &set, || ())?;
    frames.iter_mut().for_each(DetectedFrame::drop_generic);
    let name = &model.manifest.name;
    let rules = paper_rules(name, &model.manifest.class_names(), &[])?;
    let found = GatedObjects::ungated(model, &frames);
    let report = evaluate(&found.labelled(&frames, 0), &rules);
    let boxes = frames.iter().map(|frame| frame.detections.len()).sum();
    Ok((report, frames.len(), boxes))
}
