//! The losses: each returns its value and its gradient with respect to the logits.
//!
//! L = objectness + metric + variance_weight * variance + pull_weight * pull + push_weight * push + unknown_weight * unknown +
//! 2 * box + 0.2 * direction; the mean over frames. Objectness, box and direction are sums over a frame's anchors divided by its
//! positives (at least 1), as in the public SECOND. Pull, push (told together as pull) and unknown are ours.

use rayon::prelude::*;

use super::network::{OutputGradients, Pass};
use super::plan::MapPlan;
use super::targets::{CellClass, Targets};

const FOCAL_ALPHA: f32 = 0.25;
const SMOOTH_L1_BETA: f32 = 1.0 / 9.0;
const BOX_WEIGHT: f32 = 2.0;
const DIRECTION_WEIGHT: f32 = 0.2;

/// The settings of the losses on cells (paper section 3.2).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MetricSettings {
    /// T: prototype t is T times the t-th unit vector.
    pub prototype_scale: f32,
    /// Weight of the variance loss; 0 in the paper.
    pub variance_weight: f32,
    /// Weight of the loss that draws the embeddings of made-up unknown objects to the prototypes' centre.
    pub pull_weight: f32,
    /// Weight of the loss that draws the embeddings of background to the centre's mirror image.
    pub push_weight: f32,
    /// Weight of the logit of the unknown.
    pub unknown_weight: f32,
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
    /// Distance of made-up unknown objects to the centre, and of background to its mirror image.
    pub pull: f64,
    /// Cross entropy of the logit of the unknown.
    pub unknown: f64,
}

impl Losses {
    /// Each, by name.
    pub fn named_mut(&mut self) -> [(&'static str, &mut f64); 7] {
        [
            ("objectness", &mut self.objectness),
            ("metric", &mut self.metric),
            ("variance", &mut self.variance),
            ("box", &mut self.boxes),
            ("direction", &mut self.direction),
            ("pull", &mut self.pull),
            ("unknown", &mut self.unknown),
        ]
    }

    /// What is minimised.
    pub fn total(&self) -> f64 {
        let cells = self.metric + self.variance + self.pull + self.unknown;
        self.objectness + cells + self.boxes + self.direction
    }
}

/// Labels of a batch.
#[derive(Clone, Debug, Default)]
pub struct BatchTargets {
    /// For each anchor of the batch (of a sigmoid head: anchor and class): 1 positive, 0 negative, -1 ignored.
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
    is: CellClass,
    weight: f32,
    /// 1 / (frames * labelled cells of its frame).
    share: f32,
}

impl BatchTargets {
    /// Puts frames together. `cells`: of one frame's map; `anchors`: of a cell; `classes`: logits of an anchor, 1 but for
    /// a sigmoid head.
    pub fn new(frames: &[Targets], cells: usize, anchors: usize, classes: usize) -> BatchTargets {
        let logits = cells * anchors * classes;
        let mut batch = BatchTargets {
            labels: vec![0; frames.len() * logits],
            ..BatchTargets::default()
        };
        for (frame, targets) in frames.iter().enumerate() {
            let labels = frame * logits..(frame + 1) * logits;
            batch.add(
                targets,
                (frame * cells) as u32,
                labels,
                anchors,
                classes,
                frames.len(),
            );
        }
        batch
    }

    fn add(
        &mut self,
        targets: &Targets,
        first: u32,
        labels: std::ops::Range<usize>,
        anchors: usize,
        classes: usize,
        frames: usize,
    ) {
        let labels = &mut self.labels[labels];
        for &anchor in &targets.ignored {
            labels[anchor as usize * classes..][..classes].fill(-1);
        }
        let mut used: Vec<u32> = targets.cells.iter().map(|c| c.cell).collect();
        used.extend(targets.positives.iter().map(|p| p.cell));
        used.sort_unstable();
        used.dedup();
        let base = self.labelled.len();
        let row = |cell: u32| (base + used.binary_search(&cell).unwrap_or(0)) as u32;
        let weight = 1.0 / (frames * targets.positives.len().max(1)) as f32;
        for p in &targets.positives {
            let at = p.cell as usize * anchors + p.anchor as usize;
            // An anchor is of one class: the other classes' logits of it are to be low.
            let own = if classes > 1 {
                p.anchor as usize / 2
            } else {
                0
            };
            labels[at * classes..][..classes].fill(0);
            labels[at * classes + own] = 1;
            let (row, anchor, codes, bin) = (row(p.cell), p.anchor, p.codes, p.bin);
            self.positives.push(RowPositive {
                row,
                anchor,
                codes,
                bin,
                weight,
            });
        }
        let objects = targets
            .cells
            .iter()
            .filter(|c| c.is != CellClass::Background);
        let share = 1.0 / (frames * objects.count().max(1)) as f32;
        self.cells.extend(targets.cells.iter().map(|c| RowClass {
            row: row(c.cell),
            is: c.is,
            weight: c.weight / frames as f32,
            share,
        }));
        self.frame_weight.push(weight);
        self.labelled.extend(used.iter().map(|cell| first + cell));
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
    let cells = plan.cells().max(1);
    let logits = targets.labels.len() / cells;
    let (objectness, presence) = objectness(&pass.presence, plan, targets, logits);
    let (metric, variance, pull, embedding) = metric(&pass.embedding, targets, settings, classes);
    let (unknown, d_unknown) = unknown(&pass.unknown, targets, settings.unknown_weight);
    let anchors = pass.direction.len() / 2 / targets.labelled.len().max(1);
    let (boxes, d_boxes) = boxes(&pass.boxes, targets, anchors);
    let (direction, d_direction) = direction(&pass.direction, targets, anchors);
    let losses = Losses {
        objectness,
        metric,
        variance,
        boxes,
        direction,
        pull,
        unknown,
    };
    let gradients = OutputGradients {
        presence,
        embedding,
        boxes: d_boxes,
        direction: d_direction,
        unknown: d_unknown,
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
/// softmax(2 T f); the variance loss |f - m_Y|^2; and two of ours: |f - c|^2 of made-up unknown objects, with the prototypes' centre c,
/// where EDS is least (pull), and |f + c|^2 of background (push). From c to -c leads the direction that eq. 2 does not see, since one
/// number is added to every logit; EDS does see it, and says 1 + 4 / (C - 1) there, normalised: more than a known object's 2 while
/// there are fewer than five classes.
fn metric(
    embedding: &[f32],
    targets: &BatchTargets,
    settings: MetricSettings,
    classes: usize,
) -> (f64, f64, f64, Vec<f32>) {
    let t = settings.prototype_scale;
    let (mut cross, mut spread, mut pulled) = (0.0, 0.0, 0.0);
    let mut gradient = vec![0.0; embedding.len()];
    // A sigmoid head has no embedding.
    for label in targets.cells.iter().filter(|_| !embedding.is_empty()) {
        let range = label.row as usize * classes..(label.row as usize + 1) * classes;
        let (f, d) = (&embedding[range.clone()], &mut gradient[range]);
        let own = match label.is {
            CellClass::Known(class) => class as usize,
            CellClass::Unknown | CellClass::Background => {
                let centre = t / classes as f32;
                let (weight, to) = if label.is == CellClass::Unknown {
                    (settings.pull_weight, centre)
                } else {
                    (settings.push_weight, -centre)
                };
                let pull = weight * label.weight;
                for (d, v) in d.iter_mut().zip(f) {
                    let off = v - to;
                    pulled += f64::from(pull * off * off);
                    *d += 2.0 * pull * off;
                }
                continue;
            }
        };
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
    (cross, spread, pulled, gradient)
}

/// Cross entropy of the logit of the unknown: made-up unknown objects against known ones and background, every cell with its own
/// weight. Background is most of it, so the logit says how rare an unknown object is; evening the kinds out was tried and makes
/// known objects look unknown.
fn unknown(logits: &[f32], targets: &BatchTargets, weight: f32) -> (f64, Vec<f32>) {
    let mut gradient = vec![0.0; logits.len()];
    let mut loss = 0.0;
    for label in targets.cells.iter().filter(|_| !logits.is_empty()) {
        let sign = if label.is == CellClass::Unknown {
            -1.0
        } else {
            1.0
        };
        let weight = weight * label.weight;
        let x = sign * logits[label.row as usize];
        loss += f64::from(weight * softplus(x));
        gradient[label.row as usize] += sign * weight / (1.0 + (-x).exp());
    }
    (loss, gradient)
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
