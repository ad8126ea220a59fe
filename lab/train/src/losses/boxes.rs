//! Losses of the positive anchors: box codes and direction bins.

use super::softplus;
use crate::batch_targets::BatchTargets;

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

/// Smooth L1 on the seven codes, the angle's as the sine of the difference.
pub(super) fn boxes(codes: &[f32], targets: &BatchTargets, anchors: usize) -> (f64, Vec<f32>) {
    let mut gradient = vec![0.0; codes.len()];
    let mut loss = 0.0;
    for p in &targets.positives {
        let first = (p.row as usize * anchors + p.anchor as usize) * 7;
        let weight = BOX_WEIGHT * p.weight;
        for i in 0..7 {
            let difference = codes[first + i] - p.codes[i];
            let (d, inner) = if i == 6 {
                (difference.sin(), difference.cos())
            } else {
                (difference, 1.0)
            };
            let (value, slope) = smooth_l1(d);
            loss += f64::from(weight * value);
            gradient[first + i] += weight * slope * inner;
        }
    }
    (loss, gradient)
}

/// Softmax cross entropy of two bins.
pub(super) fn direction(logits: &[f32], targets: &BatchTargets, anchors: usize) -> (f64, Vec<f32>) {
    let mut gradient = vec![0.0; logits.len()];
    let mut loss = 0.0;
    for p in &targets.positives {
        let first = (p.row as usize * anchors + p.anchor as usize) * 2;
        let bin = usize::from(p.bin);
        let (own, other) = (first + bin, first + 1 - bin);
        let weight = DIRECTION_WEIGHT * p.weight;
        // Two bins: the loss is softplus(other - own).
        let x = logits[other] - logits[own];
        let wrong = 1.0 / (1.0 + (-x).exp());
        loss += f64::from(weight * softplus(x));
        gradient[other] += weight * wrong;
        gradient[own] -= weight * wrong;
    }
    (loss, gradient)
}
