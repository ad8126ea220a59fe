//! How well a model file detects the known classes of a labelled folder.
//!
//! Runs the inference engine, the one of the vehicle, frame by frame, and judges as the paper does (section 4.1): 3-D
//! overlap, difficulty moderate, average precision at 40 positions.

use std::collections::BTreeMap;

use mluc_backbone::Backbone;
use mluc_dataset::Dataset;
use mluc_evaluate::{
    ClassReport, ClassRule, Difficulty, FrameTruth, LabelledFrame, Metric, NeighbourPolicy,
    ObjectKind, SensorDetection, evaluate,
};
use mluc_geometry::{Box3, ImageSize};
use mluc_head::Head;
use mluc_model::Model;

use crate::error::TrainError;

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

/// The overlap that the paper asks of a class.
fn iou_min(model: &str, class: &str) -> f64 {
    match (model, class) {
        ("kitti", "car") | (_, "truck" | "van") => 0.7,
        _ => 0.5,
    }
}

/// Judges `model` on the first `frames` frames of a folder.
pub fn validate(model: &Model, dataset: &Dataset, frames: usize) -> Result<Figures, TrainError> {
    let mut backbone = Backbone::new(&model.manifest, &model.weights)?;
    let mut head = Head::new(&model.manifest, &model.weights)?;
    let names: Vec<&String> = dataset.names().iter().take(frames).collect();
    let mut judged: Vec<LabelledFrame> = Vec::with_capacity(names.len());
    let (mut cells, mut rows, mut boxes) = (vec![], vec![], vec![]);
    let mut count = 0;
    for name in &names {
        let frame = backbone.run(&dataset.scan(name)?);
        cells.resize(frame.rows, 0);
        rows.resize(frame.rows * backbone.feature_channels(), 0.0);
        backbone.write_rows(&mut cells, &mut rows)?;
        let counts = head.run(&cells, &rows, &mut boxes)?;
        // Boxes without a class are no known objects.
        boxes.truncate((counts.boxes - counts.generic) as usize);
        count += boxes.len();
        let found: Vec<SensorDetection> = boxes.iter().map(|b| known(model, b)).collect();
        let truth = FrameTruth {
            labels: dataset.labels(name)?.into(),
            calibration: dataset.calibration(name)?,
            image: ImageSize::KITTI,
        };
        judged.push(truth.with(&found));
    }
    Ok(figures(model, &judged, count))
}

fn known(model: &Model, found: &mluc_ipc_types::Detection) -> SensorDetection {
    SensorDetection {
        kind: ObjectKind::Known,
        class: model.manifest.classes[found.class_id as usize].name.clone(),
        score: f64::from(found.score),
        box_in_sensor: Box3 {
            center_m: found.center_m.map(f64::from),
            size_m: found.size_m.map(f64::from),
            yaw_rad: f64::from(found.yaw_rad),
        },
    }
}

fn figures(model: &Model, frames: &[LabelledFrame], boxes: usize) -> Figures {
    let manifest = &model.manifest;
    let names = manifest.classes.iter().map(|c| &c.name);
    let rules = names.map(|name| {
        let iou_min = iou_min(&manifest.name, name);
        ClassRule::known(name, iou_min, NeighbourPolicy::default())
    });
    let report = evaluate(frames, &rules.collect::<Vec<ClassRule>>());
    let figures = |class: &ClassReport| {
        let entry = class.entry(Metric::Space, Difficulty::Moderate);
        ClassFigures {
            class: class.rule.name.clone(),
            iou_min: class.rule.iou_min,
            ap_r40: entry.ap.r40,
            ap_all: entry.ap.all,
            recall: entry.recall_percent,
            labels: entry.truth_count,
        }
    };
    let classes: Vec<ClassFigures> = report.classes.iter().map(figures).collect();
    let sum = classes.iter().map(|c| c.ap_r40).sum::<f64>();
    Figures {
        step: manifest.provenance.steps,
        frames: frames.len(),
        map_known: sum / classes.len().max(1) as f64,
        classes,
        boxes_per_frame: boxes as f64 / frames.len().max(1) as f64,
    }
}
