//! Ours: boxes of the classes that the logit of the unknown doubts, and boxes without a class; each refined by the range-scaled
//! clustering, ranked by objectness x P(unknown) x the looks of its cluster, within the sizes of road users.
//!
//! The product's own gate and refiner do it: with every lever pulled this is what `mluc up` runs. A known object is removed only
//! where the gate fires and P(unknown) is one half or more.

use super::{Input, MethodError, Swept};
use crate::pipeline::{DetectedFrame, Gate, THRESHOLDS, objects_at};
use mluc_head::Detection;
use mluc_model::{HeadKind, LOOKS, Model};
use mluc_refiner::{HullSettings, Mode, Settings};

/// The levers, one by one.
#[derive(Clone, Debug, PartialEq)]
pub struct ImprovedSettings {
    /// The head's logit of the unknown; else the distance to the nearest prototype.
    pub logit: bool,
    /// Boxes of anchors without a class.
    pub generic: bool,
    /// Refine boxes by clustering; else the network's boxes stay.
    pub refine: Option<Mode>,
    /// Sizes of road users only.
    pub hull: bool,
    /// Rank boxes by the looks of the cluster that they lie on too, where the model has learned it.
    pub looks: bool,
}

impl Default for ImprovedSettings {
    fn default() -> ImprovedSettings {
        ImprovedSettings {
            logit: true,
            generic: true,
            refine: Some(Mode::Distance),
            hull: true,
            looks: true,
        }
    }
}

/// The ablation: every step adds one lever to the one before. The last is what `model` is run with.
pub fn improved_steps(model: &Model) -> Vec<(&'static str, ImprovedSettings)> {
    let first = ImprovedSettings {
        logit: false,
        generic: false,
        refine: None,
        hull: false,
        looks: false,
    };
    let all = ImprovedSettings::default();
    let logit = ImprovedSettings {
        logit: true,
        ..first.clone()
    };
    let generic = ImprovedSettings {
        generic: true,
        ..logit.clone()
    };
    let refine = ImprovedSettings {
        refine: all.refine,
        ..generic.clone()
    };
    let hull = ImprovedSettings {
        hull: true,
        ..refine.clone()
    };
    let mut steps = vec![
        ("delta, boxes as they are", first),
        ("+ logit of the unknown", logit),
        ("+ anchors without a class", generic),
        ("+ range-scaled clustering", refine),
        ("+ sizes of road users", hull),
    ];
    if has_looks(model) {
        steps.push(("+ looks of the cluster", all));
    }
    steps
}

/// Whether a model has learned the looks of clusters.
fn has_looks(model: &Model) -> bool {
    model.weights.find(LOOKS).is_some()
}

impl ImprovedSettings {
    /// The refiner's, for a model that has learned the looks of clusters or not.
    fn refiner(&self, has_looks: bool) -> Settings {
        Settings {
            mode: self.refine.unwrap_or(Mode::None),
            looks: Some(self.looks && has_looks),
            hull: HullSettings {
                applies: Some(self.hull),
                ..HullSettings::default()
            },
            ..Settings::default()
        }
    }
}

pub(super) fn run(input: &Input, settings: &ImprovedSettings) -> Result<Swept, MethodError> {
    // Without a logit of its own a network is treated as an open one whose logit is made of the distance.
    let mut model = input.model.clone();
    let classes = model.manifest.classes.len();
    let has_logit = model.manifest.network.head == HeadKind::Open && settings.logit;
    model.manifest.network.head = HeadKind::Open;
    let prepare = |frame: &DetectedFrame| {
        let mut frame = match settings.generic {
            true => frame.clone(),
            false => frame.with_class(),
        };
        if !has_logit {
            let boxes = frame.detections.iter_mut();
            boxes.for_each(|d| make_logit(d, classes));
        }
        frame
    };
    let frames: Vec<DetectedFrame> = input.frames.iter().map(prepare).collect();
    let gate = Gate::of(&model);
    let boxes = frames.iter().flat_map(|frame| &frame.detections);
    let values = boxes.map(|d| gate.value(d)).filter(|v| gate.may_be(*v));
    let values: Vec<f64> = values.map(f64::from).collect();
    let thresholds = input.thresholds_over(&values, THRESHOLDS);
    let asked: Vec<f32> = thresholds.iter().map(|t| *t as f32).collect();
    let refiner = settings.refiner(has_looks(&model));
    let objects = objects_at(&model, input.set, &frames, &refiner, &asked, input.step)?;
    Ok((thresholds, objects))
}

/// Distances to the nearest prototype around which a box is as likely known as not, and the width of that step: between the
/// prototype's 0 and the midpoint's 0.5.
const DELTA_HALF: f32 = 0.25;
const DELTA_WIDTH: f32 = 0.08;

/// The logit of being none of the known, from the distance to the nearest prototype.
fn make_logit(detection: &mut Detection, classes: usize) {
    if let Some(logit) = detection.embedding.get_mut(classes) {
        *logit = (detection.delta - DELTA_HALF) / DELTA_WIDTH;
    }
}
