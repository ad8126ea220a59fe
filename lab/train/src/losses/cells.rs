//! Losses of the labelled cells: the embedding and the unknown logit.

use super::{Evaluation, LossSettings, softplus};
use crate::targets::CellClass;

/// Weight of the loss that pulls embeddings of synthetic unknown objects to the prototypes' centre: a guess.
const CENTER_WEIGHT: f32 = 0.5;

impl Evaluation<'_> {
    /// Cross entropy of softmax(-|f - m_t|^2) (paper section 3.2, eq. 2), which for one-hot prototypes equals that of softmax(2 T f); the variance loss
    /// |f - m_Y|^2; and two of ours, with the prototypes' centre c, where EDS is minimal: |f - c|^2 of synthetic unknown objects (center), and |f + c|^2
    /// of background (push). Eq. 2 does not change along the direction from c to -c, since it adds one number to every logit. EDS does change: it is,
    /// normalised, 1 + 4 / (C - 1) at -c, more than a known object's 2 while there are fewer than five classes.
    pub(super) fn metric(&mut self, settings: LossSettings, classes: usize) {
        let t = settings.prototype_scale;
        let centre = t / classes as f32;
        let (embedding, losses) = (&self.outputs.embedding, &mut self.losses);
        let gradient = &mut self.gradients.embedding;
        // A sigmoid head has no embedding.
        for label in self.targets.cells.iter().filter(|_| !embedding.is_empty()) {
            let range = label.row as usize * classes..(label.row as usize + 1) * classes;
            let (f, d) = (&embedding[range.clone()], &mut gradient[range]);
            let mut draw = |weight: f32, to: f32| {
                let pull = weight * label.weight;
                for (d, v) in d.iter_mut().zip(f) {
                    let off = v - to;
                    losses.center += f64::from(pull * off * off);
                    *d += 2.0 * pull * off;
                }
            };
            let own = match label.is {
                CellClass::Known(class) => class as usize,
                CellClass::Unknown => {
                    draw(CENTER_WEIGHT, centre);
                    continue;
                }
                CellClass::Background => {
                    draw(settings.push_weight, -centre);
                    continue;
                }
            };
            let most = f.iter().copied().fold(f32::MIN, f32::max);
            let sum: f32 = f.iter().map(|v| (2.0 * t * (v - most)).exp()).sum();
            losses.metric += f64::from(label.weight * (sum.ln() + 2.0 * t * (most - f[own])));
            let pull = settings.variance_weight * label.share;
            for (c, (d, v)) in d.iter_mut().zip(f).enumerate() {
                let is_own = if c == own { 1.0 } else { 0.0 };
                let p = (2.0 * t * (v - most)).exp() / sum;
                let off = v - t * is_own;
                losses.variance += f64::from(pull * off * off);
                *d += label.weight * 2.0 * t * (p - is_own) + 2.0 * pull * off;
            }
        }
    }

    /// Cross entropy of the unknown logit: synthetic unknown objects against known objects and background, every cell with its own weight.
    /// Objects have two thirds of the weight. With equal weights of the three groups known objects look unknown.
    pub(super) fn unknown(&mut self) {
        let (logits, gradient) = (&self.outputs.unknown, &mut self.gradients.unknown);
        for label in self.targets.cells.iter().filter(|_| !logits.is_empty()) {
            let is_unknown = label.is == CellClass::Unknown;
            let sign = if is_unknown { -1.0 } else { 1.0 };
            let (weight, x) = (label.weight, sign * logits[label.row as usize]);
            self.losses.unknown += f64::from(weight * softplus(x));
            gradient[label.row as usize] += sign * weight / (1.0 + (-x).exp());
        }
    }
}
