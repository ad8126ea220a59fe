//! The losses: each returns its value and its gradient with respect to the logits.
//!
//! L = objectness + metric + variance_weight * variance + 0.5 center + push_weight * push + unknown +
//! 2 * box + 0.2 * direction; the mean over frames. Objectness, box and direction are sums over a frame's anchors divided by its
//! positives (at least 1), as in the public SECOND. Center, push (logged together as center) and unknown are ours.

mod boxes;
mod cells;
mod objectness;

use crate::{batch_targets::BatchTargets, network::Outputs, plan::MapPlan};

/// The settings of the losses on cells (paper section 3.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct LossSettings {
    /// T: prototype t is T times the t-th unit vector.
    pub prototype_scale: f32,
    /// Weight of the variance loss; 0 in the paper.
    pub variance_weight: f32,
    /// Weight of the loss that pulls the embeddings of background to the centre's mirror image.
    pub push_weight: f32,
}

/// Weighted losses of a batch, averaged over frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Losses {
    /// Focal loss, per anchor.
    pub objectness: f64,
    /// Cross entropy of the embedding.
    pub metric: f64,
    /// Distance of embeddings to their prototypes.
    pub variance: f64,
    /// Smooth L1 of the box codes.
    pub boxes: f64,
    /// Cross entropy of the direction bins.
    pub direction: f64,
    /// Distance of synthetic unknown objects to the centre, and of background to its mirror image.
    pub center: f64,
    /// Cross entropy of the unknown logit.
    pub unknown: f64,
}

impl Losses {
    /// Each loss with its name.
    pub fn named_mut(&mut self) -> [(&'static str, &mut f64); 7] {
        [
            ("objectness", &mut self.objectness),
            ("metric", &mut self.metric),
            ("variance", &mut self.variance),
            ("box", &mut self.boxes),
            ("direction", &mut self.direction),
            ("center", &mut self.center),
            ("unknown", &mut self.unknown),
        ]
    }

    /// The sum, which is minimised.
    pub fn total(&self) -> f64 {
        let cells = self.metric + self.variance + self.center + self.unknown;
        self.objectness + cells + self.boxes + self.direction
    }
}

/// Inputs of a batch's losses, and the sums so far.
struct Evaluation<'a> {
    outputs: &'a Outputs,
    targets: &'a BatchTargets,
    losses: Losses,
    gradients: Outputs,
}

/// Every loss and the gradients of the network's outputs.
pub fn evaluate(
    outputs: &Outputs,
    plan: &MapPlan,
    targets: &BatchTargets,
    settings: LossSettings,
    classes: usize,
) -> (Losses, Outputs) {
    let zeros = |values: &Vec<f32>| vec![0.0; values.len()];
    let mut all = Evaluation {
        outputs,
        targets,
        losses: Losses::default(),
        gradients: Outputs {
            presence: outputs.presence.each_ref().map(zeros),
            embedding: zeros(&outputs.embedding),
            boxes: zeros(&outputs.boxes),
            direction: zeros(&outputs.direction),
            unknown: zeros(&outputs.unknown),
        },
    };
    all.objectness(plan);
    all.metric(settings, classes);
    all.unknown();
    all.positives();
    (all.losses, all.gradients)
}

/// ln(1 + exp(x)) without overflow.
fn softplus(x: f32) -> f32 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests;
