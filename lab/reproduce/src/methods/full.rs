//! Our whole method: boxes of known classes with a high unknown logit, and boxes without a class. Each is refined by the range-scaled
//! clustering and ranked by objectness x P(unknown)^3 x the score of its cluster; sizes that no road user has come last.
//!
//! It uses the product's own gate and refiner: with every part the method equals `mluc up`, except that each box is read once. A known object is removed
//! only where the gate fires and P(unknown) is one half or more.

use super::MethodInput;
use crate::Result;
use mluc_evaluate::pipeline::{DetectedFrame, GatedObjects, ModelGate};
use mluc_ipc_types::Detection;
use mluc_model::{CLUSTER_SCORER, HeadKind, Model};
use mluc_refiner::{Settings, Study, Variant};

/// The ablation: every step adds one part to the step before. The last step is the method that `model` runs.
pub fn full_steps(model: &Model) -> Vec<&'static str> {
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
    steps
}

fn scores_clusters(model: &Model) -> bool {
    model.weights.find(CLUSTER_SCORER).is_some()
}

pub(super) fn run(input: &MethodInput) -> Result<GatedObjects> {
    let [logit, generic, refine, ranks_sizes, cluster_score] =
        [1, 2, 3, 4, 5].map(|step| input.full_step >= step);
    // A network without its own P(unknown) is treated as an open one, with P(unknown) computed from the distance.
    let mut model = input.model.clone();
    let has_logit = model.manifest.network.head == HeadKind::Open && logit;
    model.manifest.network.head = HeadKind::Open;
    let prepare = |frame: &DetectedFrame| {
        let mut frame = frame.clone();
        if !generic {
            frame.drop_generic();
        }
        if !has_logit {
            let boxes = frame.detections.iter_mut();
            let p = |delta: f32| 1.0 / (1.0 + (-(delta - DELTA_HALF) / DELTA_WIDTH).exp());
            boxes.for_each(|d| d.unknown_probability = p(d.delta));
        }
        if !refine {
            // Without clustering the refiner ranks boxes by 1 / EDS: set it so that all steps rank by the same score.
            let score = |d: &Detection| d.objectness * d.unknown_probability.powi(3);
            frame.detections.iter_mut().for_each(|d| d.eds = 1.0 / score(d).max(1e-6));
        }
        frame
    };
    let frames: Vec<DetectedFrame> = input.frames.iter().map(prepare).collect();
    let variant = [Variant::None, Variant::RangeScaled][usize::from(refine)];
    let settings = Settings {
        variant,
        study: Study {
            scores_clusters: Some(cluster_score && scores_clusters(&model)),
            ranks_sizes: Some(ranks_sizes),
        },
        ..Settings::default()
    };
    input.refined(&model, ModelGate::Known, &frames, &settings)
}

/// Distance to the nearest prototype at which a box is equally likely known and unknown, and the width of the sigmoid: between the
/// distance 0 at the prototype and 0.5 at the midpoint.
const DELTA_HALF: f32 = 0.25;
const DELTA_WIDTH: f32 = 0.08;
