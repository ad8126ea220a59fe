//! The focal loss over every anchor of every cell.

use super::Evaluation;
use crate::plan::MapPlan;
use rayon::prelude::*;

const FOCAL_ALPHA: f32 = 0.25;

/// Sigmoid focal loss (gamma 2) of one logit, and its derivative.
pub(super) fn focal(x: f32, positive: bool) -> (f32, f32) {
    // The positive case is the negative one with x -> -x.
    let (x, sign, alpha) =
        if positive { (-x, -1.0, FOCAL_ALPHA) } else { (x, 1.0, 1.0 - FOCAL_ALPHA) };
    let e = (-x.abs()).exp();
    let numerator = if x >= 0.0 { 1.0 } else { e };
    let p = numerator / (1.0 + e);
    let s = x.max(0.0) + e.ln_1p();
    let slope = sign * alpha * p * p * (2.0 * (1.0 - p) * s + p);
    (alpha * p * p * s, slope)
}

/// The logits of a batch, by row of the two ups, and their targets.
struct Presence<'a> {
    ups: &'a [Vec<f32>; 2],
    plan: &'a MapPlan,
    labels: &'a [i8],
    anchors: usize,
    /// The row of up 1, and the first of four rows of up 2, that represent every cell without input from a voxel.
    backgrounds: [usize; 2],
}

impl Presence<'_> {
    fn labels(&self, cell: usize) -> &[i8] {
        &self.labels[cell * self.anchors..][..self.anchors]
    }

    /// Whether the cell has no input from a voxel and no label.
    fn is_background(&self, cell: usize) -> bool {
        let [row1, row2] = self.plan.up_rows(cell);
        row1 == self.backgrounds[0]
            && row2 >= self.backgrounds[1]
            && self.labels(cell).iter().all(|label| *label == 0)
    }

    /// The loss of a cell's anchors, and its gradient. A logit is the sum of the contributions of the two ups.
    fn cell(&self, [row1, row2]: [usize; 2], labels: &[i8], weight: f32, d: &mut [f32]) -> f64 {
        let ([up1, up2], anchors) = (self.ups, self.anchors);
        let mut sum = 0.0;
        for (a, label) in labels.iter().enumerate() {
            let logit = up1[row1 * anchors + a] + up2[row2 * anchors + a];
            let (value, slope) = if *label < 0 { (0.0, 0.0) } else { focal(logit, *label == 1) };
            d[a] = weight * slope;
            sum += f64::from(weight * value);
        }
        sum
    }

    /// A line of the map: its loss, and its number of background cells at each place in the 2x2. Background cells at the same
    /// place are identical, so each place is computed once for all of them.
    fn line(&self, line: usize, weight: f32, d: &mut [f32]) -> (f64, [usize; 4]) {
        let (mut loss, mut alike) = (0.0, [0; 4]);
        for (x, d) in d.chunks_exact_mut(self.anchors).enumerate() {
            let cell = line * self.plan.shape[2] + x;
            let rows = self.plan.up_rows(cell);
            if self.is_background(cell) {
                alike[rows[1] - self.backgrounds[1]] += 1;
            } else {
                loss += self.cell(rows, self.labels(cell), weight, d);
            }
        }
        (loss, alike)
    }
}

impl Evaluation<'_> {
    /// The loss, and the gradient of the rows of both ups.
    pub(super) fn objectness(&mut self, plan: &MapPlan) {
        let (ups, targets) = (&self.outputs.presence, self.targets);
        let [_, rows, columns] = plan.shape;
        let anchors = targets.labels.len() / plan.cells().max(1);
        let presence = Presence {
            ups,
            plan,
            labels: &targets.labels,
            anchors,
            backgrounds: [ups[0].len() / anchors - 1, ups[1].len() / anchors - 4],
        };
        let mut gradient = vec![0.0f32; plan.cells() * anchors];
        let lines = gradient.par_chunks_mut(columns * anchors).enumerate();
        let weights = &targets.frame_weight;
        let line = |(line, d): (usize, &mut [f32])| presence.line(line, weights[line / rows], d);
        let lines: Vec<(f64, [usize; 4])> = lines.map(line).collect();
        let back = &mut self.gradients.presence;
        let mut add = |rows: [usize; 2], d: &[f32], times: f32| {
            for (back, row) in back.iter_mut().zip(rows) {
                let to = &mut back[row * anchors..][..anchors];
                to.iter_mut().zip(d).for_each(|(to, d)| *to += times * d);
            }
        };
        let mut loss: f64 = lines.iter().map(|(loss, _)| loss).sum();
        let none = vec![0; anchors];
        for (frame, &weight) in weights.iter().enumerate() {
            for place in 0..4 {
                let lines = &lines[frame * rows..][..rows];
                let count: usize = lines.iter().map(|(_, alike)| alike[place]).sum();
                let mut d = vec![0.0; anchors];
                let rows = [presence.backgrounds[0], presence.backgrounds[1] + place];
                loss += count as f64 * presence.cell(rows, &none, weight, &mut d);
                add(rows, &d, count as f32);
            }
        }
        for (cell, d) in gradient.chunks_exact(anchors).enumerate() {
            if !presence.is_background(cell) {
                add(plan.up_rows(cell), d, 1.0);
            }
        }
        self.losses.objectness = loss;
    }
}
