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
mod tests {
    use super::*;
    use crate::train::random::Random;

    /// Compares a gradient with central differences of the value.
    fn check(x: &[f32], value: impl Fn(&[f32]) -> f64, gradient: &[f32]) {
        for i in 0..x.len() {
            let h = 2e-3;
            let at = |d: f32| {
                let mut x = x.to_vec();
                x[i] += d;
                value(&x)
            };
            let slope = (at(h) - at(-h)) / (2.0 * f64::from(h));
            let error = (slope - f64::from(gradient[i])).abs();
            assert!(
                error < 2e-3 * (1.0 + slope.abs()),
                "{i}: {slope} against {}",
                gradient[i]
            );
        }
    }

    fn batch() -> BatchTargets {
        let positive = |row, anchor, bin| RowPositive {
            row,
            anchor,
            codes: [0.1, -0.3, 0.2, 0.5, -0.1, 0.0, 0.9],
            bin,
            weight: 0.5,
        };
        BatchTargets {
            labels: vec![],
            labelled: vec![0, 1],
            frame_weight: vec![0.5],
            positives: vec![positive(0, 1, 0), positive(1, 0, 1)],
            cells: vec![
                RowClass {
                    row: 0,
                    class: 0,
                    weight: 0.7,
                    share: 0.5,
                },
                RowClass {
                    row: 1,
                    class: 1,
                    weight: 0.3,
                    share: 0.5,
                },
            ],
        }
    }

    fn draw(n: usize, scale: f64) -> Vec<f32> {
        let mut random = Random::new(3, &[n as u64]);
        (0..n).map(|_| (scale * random.normal()) as f32).collect()
    }

    #[test]
    fn focal_has_the_published_form_and_derivative() {
        for (x, positive) in [
            (0.3f32, true),
            (0.3, false),
            (-4.0, true),
            (-4.0, false),
            (6.0, false),
        ] {
            let p = 1.0 / (1.0 + (-f64::from(x)).exp());
            let expected = if positive {
                -0.25 * (1.0 - p).powi(2) * p.ln()
            } else {
                -0.75 * p * p * (1.0 - p).ln()
            };
            let (value, slope) = focal(x, positive);
            assert!(
                (f64::from(value) - expected).abs() < 1e-5 * (1.0 + expected),
                "{x} {positive}"
            );
            check(&[x], |x| f64::from(focal(x[0], positive).0), &[slope]);
        }
    }

    #[test]
    fn box_and_direction_gradients_are_those_of_their_values() {
        let targets = batch();
        let codes = draw(2 * 4 * 7, 1.0);
        check(
            &codes,
            |x| boxes(x, &targets, 4).0,
            &boxes(&codes, &targets, 4).1,
        );
        let logits = draw(2 * 4 * 2, 2.0);
        check(
            &logits,
            |x| direction(x, &targets, 4).0,
            &direction(&logits, &targets, 4).1,
        );
    }

    #[test]
    fn half_a_turn_costs_nothing_in_the_box_loss() {
        let targets = batch();
        let codes = draw(2 * 4 * 7, 1.0);
        let mut turned = codes.clone();
        turned
            .iter_mut()
            .skip(6)
            .step_by(7)
            .for_each(|a| *a += std::f32::consts::PI);
        assert!((boxes(&codes, &targets, 4).0 - boxes(&turned, &targets, 4).0).abs() < 1e-5);
    }

    #[test]
    fn metric_loss_is_the_papers_and_its_gradient_right() {
        let targets = batch();
        let settings = MetricSettings {
            prototype_scale: 1.5,
            variance_weight: 0.1,
        };
        let f = draw(4, 0.7);
        let (cross, spread, gradient) = metric(&f, &targets, settings, 2);
        check(
            &f,
            |x| {
                let (a, b, _) = metric(x, &targets, settings, 2);
                a + b
            },
            &gradient,
        );
        // Eq. 2 written with distances to the prototypes.
        let mut expected = (0.0, 0.0);
        for label in &targets.cells {
            let f = &f[2 * label.row as usize..][..2];
            let d = [0, 1].map(|m| {
                (0..2)
                    .map(|c| (f[c] - if c == m { 1.5 } else { 0.0 }).powi(2))
                    .sum::<f32>()
            });
            let own = d[label.class as usize];
            expected.0 += label.weight * (own + d.iter().map(|d| (-d).exp()).sum::<f32>().ln());
            expected.1 += 0.1 * label.share * own;
        }
        assert!(
            (cross - f64::from(expected.0)).abs() < 1e-5
                && (spread - f64::from(expected.1)).abs() < 1e-5
        );
    }

    #[test]
    fn objectness_equals_the_sum_over_every_cell() {
        // 2 x 2 frames of 4 x 4 cells; rows: 3 listed + 1 background, 1 listed half cell + background.
        let plan = MapPlan {
            shape: [1, 4, 4],
            scatter: vec![],
            map_rows: 0,
            block1: vec![],
            block2: vec![],
            identity: Default::default(),
            up1_row: (0..16).map(|c| if c < 3 { c } else { 3 }).collect(),
            up2_row: (0..16u32)
                .map(|c| 4 * u32::from(c / 4 / 2 != 0 || c % 4 / 2 != 0) + c / 4 % 2 * 2 + c % 2)
                .collect(),
        };
        let mut targets = batch();
        targets.labels = vec![0; 32];
        (targets.labels[1], targets.labels[2], targets.labels[31]) = (1, -1, -1);
        let (up1, up2) = (draw(8, 1.0), draw(16, 1.0));
        let run = |up1: &[f32], up2: &[f32]| {
            objectness(&[up1.to_vec(), up2.to_vec()], &plan, &targets, 2)
        };
        let (loss, [d1, d2]) = run(&up1, &up2);
        let mut expected = 0.0;
        for cell in 0..16 {
            for a in 0..2 {
                let label = targets.labels[cell * 2 + a];
                let x = up1[plan.up1_row[cell] as usize * 2 + a]
                    + up2[plan.up2_row[cell] as usize * 2 + a];
                if label >= 0 {
                    expected += 0.5 * f64::from(focal(x, label == 1).0);
                }
            }
        }
        assert!((loss - expected).abs() < 1e-5);
        check(&up1, |x| run(x, &up2).0, &d1);
        check(&up2, |x| run(&up1, x).0, &d2);
    }
}
