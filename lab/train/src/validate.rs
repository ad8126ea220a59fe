//! How well a model file detects the known classes of a labelled folder.
//!
//! Runs the inference engine, the one of the vehicle, frame by frame, and judges as the paper does (section 4.1): 3-D
//! overlap, difficulty moderate, average precision at 40 positions.

use std::collections::BTreeMap;
use std::path::Path;

use mluc_backbone::Precision;
use mluc_evaluate::pipeline::{
    DetectedFrame, FrameSet, GatedObjects, class_names, detect_frames, paper_rules,
};
use mluc_evaluate::{ClassReport, EvaluateError, NeighbourPolicy, evaluate};
use mluc_model::Model;

/// Figures of one class, percent.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ClassFigures {
    /// The class.
    pub class: String,
    /// Overlap asked for.
    pub iou_min: f64,
    /// Average precision at 40 positions, moderate.
    pub ap_r40: f64,
    /// Over all points.
    pub ap_all: f64,
    /// Labels found by any detection.
    pub recall: f64,
    /// Labels.
    pub labels: usize,
}

/// Figures of a model.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Figures {
    /// Steps it was trained for.
    pub step: u64,
    /// Frames judged.
    pub frames: usize,
    /// Mean of the classes' AP at 40 positions.
    pub map_known: f64,
    /// Each class.
    pub classes: Vec<ClassFigures>,
    /// Boxes a frame.
    pub boxes_per_frame: f64,
}

impl Figures {
    /// By name, for the model file.
    pub fn metrics(&self) -> BTreeMap<String, f64> {
        let of_class = |c: &ClassFigures| (format!("{}/3d/moderate/ap_r40", c.class), c.ap_r40);
        let mut metrics: BTreeMap<String, f64> = self.classes.iter().map(of_class).collect();
        metrics.insert("map_known".into(), self.map_known);
        metrics.insert("validation_frames".into(), self.frames as f64);
        metrics
    }
}

/// Judges `model` on the first `frames` frames of a folder. Boxes without a class are no known objects.
pub fn validate(model: &Model, folder: &Path, frames: usize) -> Result<Figures, EvaluateError> {
    let set = FrameSet::open(folder, None, frames)?;
    let mut frames = detect_frames(Precision::default(), model, &set, || ())?;
    frames.iter_mut().for_each(DetectedFrame::drop_generic);
    let name = &model.manifest.name;
    let rules = paper_rules(name, &class_names(model), &[], NeighbourPolicy::Official)?;
    let found = GatedObjects::ungated(model, &frames);
    let report = evaluate(&found.labelled(&frames, 0), &rules);
    let figures = |class: &ClassReport| ClassFigures {
        class: class.rule.name.clone(),
        iou_min: class.rule.iou_min,
        ap_r40: class.main().ap.r40,
        ap_all: class.main().ap.all,
        recall: class.main().recall_percent,
        labels: class.main().truth_count,
    };
    let classes: Vec<ClassFigures> = report.classes.iter().map(figures).collect();
    let sum = classes.iter().map(|c| c.ap_r40).sum::<f64>();
    let boxes: usize = frames.iter().map(|frame| frame.detections.len()).sum();
    Ok(Figures {
        step: model.manifest.provenance.steps,
        frames: frames.len(),
        map_known: sum / classes.len().max(1) as f64,
        classes,
        boxes_per_frame: boxes as f64 / frames.len().max(1) as f64,
    })
}
