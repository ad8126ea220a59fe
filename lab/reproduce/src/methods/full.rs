//! Our whole method: boxes of the classes that the logit of the unknown doubts, and boxes without a class; each refined by the
//! range-scaled clustering, ranked by objectness x P(unknown) x the score of its cluster, sizes of no road user last.
//!
//! The product's own gate and refiner do it: with every part this is what `mluc up` runs. A known object is removed only
//! where the gate fires and P(unknown) is one half or more.

use super::{MethodInput, Swept};
use crate::ReproduceError;
use mluc_evaluate::pipeline::{DetectedFrame, ModelGate, THRESHOLDS, objects_at};
use mluc_model::{HeadKind, LOOKS, Model};
use mluc_refiner::{Settings, Study, Variant};

/// The parts, one by one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FullSettings {
    /// The head's logit of the unknown; else the distance to the nearest prototype.
    pub logit: bool,
    /// Boxes of anchors without a class.
    pub generic: bool,
    /// Refine boxes by clustering; else the network's boxes stay.
    pub refine: bool,
    /// Rank sizes of no road user last.
    pub sizes: bool,
    /// Rank boxes by the score of the cluster that they lie on too, where the model has learned it.
    pub cluster_score: bool,
}

impl Default for FullSettings {
    fn default() -> FullSettings {
        FullSettings {
            logit: true,
            generic: true,
            refine: true,
            sizes: true,
            cluster_score: true,
        }
    }
}

/// The ablation: every step adds one part to the one before. The last is what `model` is run with.
pub fn full_steps(model: &Model) -> Vec<(&'static str, FullSettings)> {
    let mut steps = vec![
        "delta, boxes as they are",
        "+ logit of the unknown",
        "+ anchors without a class",
        "+ range-scaled clustering",
        "+ sizes of road users",
    ];
    if scores_clusters(model) {
        steps.push("+ score of the cluster");
    }
    let with_parts = |count: usize| FullSettings {
        logit: count > 0,
        generic: count > 1,
        refine: count > 2,
        sizes: count > 3,
        cluster_score: count > 4,
    };
    let steps = steps.into_iter().enumerate();
    steps.map(|(at, name)| (name, with_parts(at))).collect()
}

/// Whether a model has learned to score clusters.
fn scores_clusters(model: &Model) -> bool {
    model.weights.find(LOOKS).is_some()
}

impl FullSettings {
    fn refiner(&self, model: &Model) -> Settings {
        Settings {
            variant: if self.refine {
                Variant::RangeScaled
            } else {
                Variant::None
            },
            study: Study {
                scores_clusters: Some(self.cluster_score && scores_clusters(model)),
                ranks_sizes: Some(self.sizes),
                ..Study::default()
            },
            ..Settings::default()
        }
    }
}

pub(super) fn run(input: &MethodInput) -> Result<Swept, ReproduceError> {
    // Without P(unknown) of its own a network is treated as an open one whose P(unknown) is made of the distance.
    let (mut model, settings) = (input.model.clone(), input.full);
    let has_logit = model.manifest.network.head == HeadKind::Open && settings.logit;
    model.manifest.network.head = HeadKind::Open;
    let prepare = |frame: &DetectedFrame| {
        let mut frame = if settings.generic {
            frame.clone()
        } else {
            frame.with_class()
        };
        if !has_logit {
            let boxes = frame.detections.iter_mut();
            boxes.for_each(|d| d.unknown_probability = probability_by_distance(d.delta));
        }
        frame
    };
    let frames: Vec<DetectedFrame> = input.frames.iter().map(prepare).collect();
    let gate = ModelGate::of(&model);
    let boxes = frames.iter().flat_map(|frame| &frame.detections);
    let values = boxes.map(|d| gate.value(d)).filter(|v| gate.may_be(*v));
    let thresholds = input.thresholds_over(values, THRESHOLDS);
    let asked: Vec<f32> = thresholds.iter().map(|t| *t as f32).collect();
    let refiner = settings.refiner(&model);
    let objects = objects_at(&model, input.set, &frames, &refiner, &asked, input.step)?;
    Ok((thresholds, objects))
}

/// Distances to the nearest prototype around which a box is as likely known as not, and the width of that step: between the
/// prototype's 0 and the midpoint's 0.5.
const DELTA_HALF: f32 = 0.25;
const DELTA_WIDTH: f32 = 0.08;

/// P(unknown) from the distance to the nearest prototype.
fn probability_by_distance(delta: f32) -> f32 {
    1.0 / (1.0 + (-(delta - DELTA_HALF) / DELTA_WIDTH).exp())
}
