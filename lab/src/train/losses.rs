//! The losses: each returns its value and its gradient with respect to the logits.
//!
//! L = objectness + metric + variance_weight * variance + 2 * box + 0.2 * direction; the mean over frames. Objectness,
//! box and direction are sums over a frame's anchors divided by its positives (at least 1), as in the public SECOND.

use rayon::prelude::*;

use super::network::{OutputGradients, Pass};
use super::plan::MapPlan;
use super::targets::Targets;

const FOCAL_ALPHA: f32 = 0.25;
const SMOOTH_L1_BETA: f32 = 1.0 / 9.0;
const BOX_WEIGHT: f32 = 2.0;
const DIRECTION_WEIGHT: f32 = 0.2;

/// The metric loss's settings (paper section 3.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MetricSettings {
    /// T: prototype t is T times the t-th unit vector.
    pub prototype_scale: f32,
    /// Weight of the variance loss; 0 in the paper.
    pub variance_weight: f32,
}

/// Values of the losses, weighted as in the sum, averaged over frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Losses {
    /// Focal, per anchor.
    pub objectness: f64,
    /// Cross entropy of the embedding.
    pub metric: f64,
    /// Distance of embeddings to their prototypes.
    pub variance: f64,
    /// Smooth L1 of the box codes.
    pub boxes: f64,
    /// Cross entropy of the direction bins.
    pub direction: f64,
}

impl Losses {
    /// What is minimised.
    pub fn total(&self) -> f64 {
        self.objectness + self.metric + self.variance + self.boxes + self.direction
    }
}

/// Labels of a batch.
#[derive(Clone, Debug, Default)]
pub struct BatchTargets {
    /// For each anchor of the batch: 1 positive, 0 negative, -1 ignored.
    pub labels: Vec<i8>,
    /// Cells with a positive anchor or a class, ascending, over the batch.
    pub labelled: Vec<u32>,
    /// 1 / (frames * positives) of each frame.
    frame_weight: Vec<f32>,
    positives: Vec<RowPositive>,
    cells: Vec<RowClass>,
}

/// A positive anchor by row of the labelled cells.
#[derive(Clone, Debug)]
struct RowPositive {
    row: u32,
    anchor: u32,
    codes: [f32; 7],
    bin: u8,
    weight: f32,
}

/// A class by row of the labelled cells.
#[derive(Clone, Debug)]
struct RowClass {
    row: u32,
    class: u32,
    weight: f32,
    /// 1 / (frames * labelled cells of its frame).
    share: f32,
}

impl BatchTargets {
    /// Puts frames together. `cells`: of one frame's map; `anchors`: of a cell.
    pub fn new(frames: &[Targets], cells: usize, anchors: usize) -> BatchTargets {
        let mut batch = BatchTargets {
            labels: vec![0; frames.len() * cells * anchors],
            ..BatchTargets::default()
        };
        let count = frames.len() as f32;
        for (frame, targets) in frames.iter().enumerate() {
            let first = (frame * cells) as u32;
            let labels = &mut batch.labels[frame * cells * anchors..][..cells * anchors];
            targets
                .ignored
                .iter()
                .for_each(|a| labels[*a as usize] = -1);
            let mut used: Vec<u32> = targets.cells.iter().map(|c| c.cell).collect();
            used.extend(targets.positives.iter().map(|p| p.cell));
            used.sort_unstable();
            used.dedup();
            let base = batch.labelled.len();
            let row = |cell: u32| (base + used.binary_search(&cell).unwrap_or(0)) as u32;
            let weight = 1.0 / (count * targets.positives.len().max(1) as f32);
            for p in &targets.positives {
                labels[(p.cell as usize) * anchors + p.anchor as usize] = 1;
                let (row, anchor, codes, bin) = (row(p.cell), p.anchor, p.codes, p.bin);
                batch.positives.push(RowPositive {
                    row,
                    anchor,
                    codes,
                    bin,
                    weight,
                });
            }
            let share = 1.0 / (count * targets.cells.len().max(1) as f32);
            batch.cells.extend(targets.cells.iter().map(|c| RowClass {
                row: row(c.cell),
                class: c.class,
                weight: c.weight / count,
                share,
            }));
            batch.frame_weight.push(weight);
            batch.labelled.extend(used.iter().map(|cell| first + cell));
        }
        batch
    }
}

/// ln(1 + exp(x)) without overflow.
fn softplus(x: f32) -> f32 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

/// Sigmoid focal loss (gamma 2) of one logit, and its derivative.
fn focal(x: f32, positive: bool) -> (f32, f32) {
    // The positive case mirrors the negative: x -> -x.
    let (x, sign, alpha) = if positive {
        (-x, -1.0, FOCAL_ALPHA)
    } else {
        (x, 1.0, 1.0 - FOCAL_ALPHA)
    };
    let e = (-x.abs()).exp();
    let p = if x >= 0.0 {
        1.0 / (1.0 + e)
    } else {
        e / (1.0 + e)
    };
    let s = x.max(0.0) + e.ln_1p();
    (
        alpha * p * p * s,
        sign * alpha * p * p * (2.0 * (1.0 - p) * s + p),
    )
}

/// Smooth L1 and its derivative.
fn smooth_l1(d: f32) -> (f32, f32) {
    if d.abs() < SMOOTH_L1_BETA {
        (0.5 * d * d / SMOOTH_L1_BETA, d / SMOOTH_L1_BETA)
    } else {
        (d.abs() - 0.5 * SMOOTH_L1_BETA, d.signum())
    }
}

/// Every loss and the gradients of the network's outputs.
pub fn evaluate(
    pass: &Pass,
    plan: &MapPlan,
    targets: &BatchTargets,
    settings: MetricSettings,
    classes: usize,
) -> (Losses, OutputGradients) {
    let anchors = 2 * classes;
    let (objectness, d_objectness) = objectness(&pass.objectness, plan, targets, anchors);
    let (metric, variance, embedding) = metric(&pass.embedding, targets, settings, classes);
    let (boxes, d_boxes) = boxes(&pass.boxes, targets, anchors);
    let (direction, d_direction) = direction(&pass.direction, targets, anchors);
    let losses = Losses {
        objectness,
        metric,
        variance,
        boxes,
        direction,
    };
    let gradients = OutputGradients {
        objectness: d_objectness,
        embedding,
        boxes: d_boxes,
        direction: d_direction,
    };
    (losses, gradients)
}

/// Focal loss over every anchor of every cell; a cell's logits are the sum of what its rows of the two ups contribute.
fn objectness(
    [up1, up2]: &[Vec<f32>; 2],
    plan: &MapPlan,
    targets: &BatchTargets,
    anchors: usize,
) -> (f64, [Vec<f32>; 2]) {
    let [_, rows, columns] = plan.shape;
    let backgrounds = [up1.len() / anchors - 1, up2.len() / anchors - 4];
    let is_background = |cell: usize| {
        plan.up1_row[cell] as usize == backgrounds[0]
            && plan.up2_row[cell] as usize >= backgrounds[1]
            && targets.labels[cell * anchors..][..anchors]
                .iter()
                .all(|l| *l == 0)
    };
    let cell = |row1: usize, row2: usize, labels: &[i8], weight: f32, d: &mut [f32]| -> f64 {
        let mut sum = 0.0;
        for (a, label) in labels.iter().enumerate() {
            let logit = up1[row1 * anchors + a] + up2[row2 * anchors + a];
            let (value, slope) = if *label < 0 {
                (0.0, 0.0)
            } else {
                focal(logit, *label == 1)
            };
            d[a] = weight * slope;
            sum += f64::from(weight * value);
        }
        sum
    };
    let mut gradient = vec![0.0f32; plan.cells() * anchors];
    // Cells that nothing reaches are all alike but for their place in the 2x2: count them, and do each once.
    let lines: Vec<(f64, [usize; 4])> = gradient
        .par_chunks_mut(columns * anchors)
        .enumerate()
        .map(|(line, d)| {
            let (mut loss, mut alike) = (0.0, [0; 4]);
            let weight = targets.frame_weight[line / rows];
            for (x, d) in d.chunks_exact_mut(anchors).enumerate() {
                let at = line * columns + x;
                let (row1, row2) = (plan.up1_row[at] as usize, plan.up2_row[at] as usize);
                if is_background(at) {
                    alike[row2 - backgrounds[1]] += 1;
                } else {
                    loss += cell(
                        row1,
                        row2,
                        &targets.labels[at * anchors..][..anchors],
                        weight,
                        d,
                    );
                }
            }
            (loss, alike)
        })
        .collect();
    let mut d1 = vec![0.0f32; up1.len()];
    let mut d2 = vec![0.0f32; up2.len()];
    let mut add = |row1: usize, row2: usize, d: &[f32], times: f32| {
        for (a, d) in d.iter().enumerate() {
            d1[row1 * anchors + a] += times * d;
            d2[row2 * anchors + a] += times * d;
        }
    };
    let mut loss: f64 = lines.iter().map(|(loss, _)| loss).sum();
    for (frame, &weight) in targets.frame_weight.iter().enumerate() {
        for place in 0..4 {
            let count: usize = lines[frame * rows..][..rows]
                .iter()
                .map(|(_, alike)| alike[place])
                .sum();
            let mut d = vec![0.0; anchors];
            let (row1, row2) = (backgrounds[0], backgrounds[1] + place);
            loss += count as f64 * cell(row1, row2, &vec![0; anchors], weight, &mut d);
            add(row1, row2, &d, count as f32);
        }
    }
    for (at, d) in gradient.chunks_exact(anchors).enumerate() {
        if !is_background(at) {
            add(plan.up1_row[at] as usize, plan.up2_row[at] as usize, d, 1.0);
        }
    }
    (loss, [d1, d2])
}

/// Cross entropy of softmax(-|f - m_t|^2) (paper section 3.2, eq. 2), which for one-hot prototypes equals that of
/// softmax(2 T f), and the variance loss |f - m_Y|^2.
fn metric(
    embedding: &[f32],
    targets: &BatchTargets,
    settings: MetricSettings,
    classes: usize,
) -> (f64, f64, Vec<f32>) {
    let t = settings.prototype_scale;
    let (mut cross, mut spread) = (0.0, 0.0);
    let mut gradient = vec![0.0; embedding.len()];
    for label in &targets.cells {
        let range = label.row as usize * classes..(label.row as usize + 1) * classes;
        let (f, d) = (&embedding[range.clone()], &mut gradient[range]);
        let own = label.class as usize;
        let most = f.iter().copied().fold(f32::MIN, f32::max);
        let sum: f32 = f.iter().map(|v| (2.0 * t * (v - most)).exp()).sum();
        cross += f64::from(label.weight * (sum.ln() + 2.0 * t * (most - f[own])));
        let pull = settings.variance_weight * label.share;
        for (c, (d, v)) in d.iter_mut().zip(f).enumerate() {
            let is_own = if c == own { 1.0 } else { 0.0 };
            let p = (2.0 * t * (v - most)).exp() / sum;
            let off = v - t * is_own;
            spread += f64::from(pull * off * off);
            *d += label.weight * 2.0 * t * (p - is_own) + 2.0 * pull * off;
        }
    }
    (cross, spread, gradient)
}

/// Smooth L1 on the seven codes, the angle's as the sine of the difference.
fn boxes(codes: &[f32], targets: &BatchTargets, anchors: usize) -> (f64, Vec<f32>) {
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
fn direction(logits: &[f32], targets: &BatchTargets, anchors: usize) -> (f64, Vec<f32>) {
    let mut gradient = vec![0.0; logits.len()];
    let mut loss = 0.0;
    for p in &targets.positives {
        let first = (p.row as usize * anchors + p.anchor as usize) * 2;
        let (own, other) = (first + usize::from(p.bin), first + 1 - usize::from(p.bin));
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

#[cfg(test)]
#[path = "losses_tests.rs"]
mod tests;
