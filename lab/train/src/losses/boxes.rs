//! Losses of the positive anchors: box codes and direction bins.

use super::{Evaluation, softplus};

const SMOOTH_L1_BETA: f32 = 1.0 / 9.0;
const BOX_WEIGHT: f32 = 2.0;
const DIRECTION_WEIGHT: f32 = 0.2;

/// Smooth L1 and its derivative.
fn smooth_l1(d: f32) -> (f32, f32) {
    if d.abs() < SMOOTH_L1_BETA {
        (0.5 * d * d / SMOOTH_L1_BETA, d / SMOOTH_L1_BETA)
    } else {
        (d.abs() - 0.5 * SMOOTH_L1_BETA, d.signum())
    }
}

impl Evaluation<'_> {
    /// Smooth L1 on the seven codes (the angle's as the sine of the difference), and softmax cross entropy of the two bins.
    pub(super) fn positives(&mut self) {
        let (outputs, losses, gradients) = (self.outputs, &mut self.losses, &mut self.gradients);
        let anchors = outputs.direction.len() / 2 / self.targets.labelled.len().max(1);
        for p in &self.targets.positives {
            let place = p.row as usize * anchors + p.anchor as usize;
            let codes = place * 7..place * 7 + 7;
            let (found, d) = (&outputs.boxes[codes.clone()], &mut gradients.boxes[codes]);
            let weight = BOX_WEIGHT * p.weight;
            for i in 0..7 {
                let difference = found[i] - p.codes[i];
                let (off, inner) =
                    if i == 6 { (difference.sin(), difference.cos()) } else { (difference, 1.0) };
                let (value, slope) = smooth_l1(off);
                losses.boxes += f64::from(weight * value);
                d[i] += weight * slope * inner;
            }
            let bin = usize::from(p.bin);
            let (own, other) = (place * 2 + bin, place * 2 + 1 - bin);
            let weight = DIRECTION_WEIGHT * p.weight;
            // Two bins: the loss is softplus(other - own).
            let x = outputs.direction[other] - outputs.direction[own];
            let wrong = 1.0 / (1.0 + (-x).exp());
            losses.direction += f64::from(weight * softplus(x));
            gradients.direction[other] += weight * wrong;
            gradients.direction[own] -= weight * wrong;
        }
    }
}
