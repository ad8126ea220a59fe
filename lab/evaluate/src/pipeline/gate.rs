//! The gate at any threshold: which boxes of a model are known and which the refiner processes.
//!
//! The network runs once and keeps every box; this module gives the head's decision at a given threshold. A threshold is always
//! for a score that is low for unknown objects, and 0 is the closed set.

use super::DetectedFrame;
use crate::{SweepPoint, best_index, sweep::quantile_grid};
use mluc_head::{Detection, gate};
use mluc_ipc_types::{DetectionKind, GateKind};
use mluc_model::{HeadKind, Model, Thresholds};

/// Number of thresholds tried in addition to the closed set.
pub const THRESHOLDS: usize = 60;

/// The score that the gate compares with its threshold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelGate {
    /// The normalised EDS (paper section 3.2).
    Eds,
    /// One minus the probability of being no known class.
    Known,
    /// The largest class probability, as in the naive baseline.
    Softmax,
}

impl ModelGate {
    /// Index of the point of a sweep (closed set first) that gives the threshold: the best harmonic mean, as in the paper. For an open head it is the
    /// last point, one half: its boxes are read both ways, and the scores of the profiles decide.
    pub fn best_index(self, sweep: &[SweepPoint]) -> usize {
        match self {
            ModelGate::Known => sweep.len().saturating_sub(1),
            _ => best_index(sweep),
        }
    }

    /// The gate of a model, by its head.
    pub fn of(model: &Model) -> ModelGate {
        match model.manifest.network.head {
            HeadKind::Open => ModelGate::Known,
            _ => ModelGate::Eds,
        }
    }

    /// How a threshold is chosen, in words.
    pub(super) fn rule(self) -> &'static str {
        match self {
            ModelGate::Known => "P(unknown) of one half: more likely unknown than known",
            _ => {
                "best harmonic mean of mAP known and AP unknown (R40, moderate), of those with mAP known at least 0.9 of the closed set's"
            }
        }
    }

    /// The value that is compared with the threshold.
    pub fn value(self, detection: &Detection) -> f32 {
        match self {
            ModelGate::Eds => detection.eds_normalised,
            ModelGate::Known => 1.0 - detection.unknown_probability,
            ModelGate::Softmax => detection.softmax_max,
        }
    }

    /// Rank of unknown boxes where no other score exists: the paper's 1 / EDS, or one minus the probability.
    pub fn rank(self, detection: &Detection) -> f32 {
        match self {
            ModelGate::Eds => 1.0 / detection.eds.max(1e-6),
            ModelGate::Known | ModelGate::Softmax => 1.0 - self.value(detection),
        }
    }

    /// 0, the closed set, then at most `count` thresholds at quantiles of the boxes' values, ascending; for an open head also one half.
    pub fn thresholds(self, frames: &[DetectedFrame], count: usize) -> Vec<f64> {
        let boxes = frames.iter().flat_map(|frame| &frame.detections);
        let values = boxes.map(|d| self.value(d)).filter(|v| self.may_be(*v));
        let values: Vec<f64> = values.map(f64::from).collect();
        let grid = quantile_grid(&values, count);
        let half = (self == ModelGate::Known).then_some(0.5);
        let below = grid.into_iter().filter(|t| half != Some(*t));
        [0.0].into_iter().chain(below).chain(half).collect()
    }

    /// Whether a sweep tries a threshold: in the gate `Known`, a box that is more likely known than unknown never becomes a candidate.
    fn may_be(self, threshold: f32) -> bool {
        self != ModelGate::Known || (threshold > 0.0 && threshold <= 0.5)
    }

    /// The box with its kind at a threshold; `None` for a box without a class that is not unknown.
    fn apply(self, detection: &Detection, threshold: f32) -> Option<Detection> {
        let (gate_kind, threshold) = match self {
            ModelGate::Eds => (GateKind::Eds, threshold),
            ModelGate::Known => (GateKind::UnknownProbability, complement(threshold)),
            ModelGate::Softmax => (GateKind::SoftmaxMax, threshold),
        };
        let is_unknown = match self {
            ModelGate::Known => gate::is_unknown(detection.unknown_probability, threshold),
            _ => self.value(detection) < threshold,
        };
        if !detection.has_class() && !is_unknown {
            return None;
        }
        let kind = if is_unknown { DetectionKind::Candidate } else { DetectionKind::Known };
        let eds = match self {
            // The paper's refiner ranks by 1 / EDS, so the box gets this gate's rank in the field `eds`.
            ModelGate::Softmax => 1.0 / self.rank(detection).max(1e-6),
            _ => detection.eds,
        };
        Some(Detection { kind: kind as u32, gate: gate_kind as u32, threshold, eds, ..*detection })
    }

    pub(super) fn threshold(self, thresholds: &Thresholds) -> f32 {
        match self {
            ModelGate::Eds => thresholds.eds_normalised_max,
            ModelGate::Known => complement(thresholds.unknown_min),
            ModelGate::Softmax => thresholds.softmax_min,
        }
    }

    /// Sets a model's threshold.
    pub fn set(self, thresholds: &mut Thresholds, threshold: f32) {
        match self {
            ModelGate::Eds => thresholds.eds_normalised_max = threshold,
            ModelGate::Known => thresholds.unknown_min = complement(threshold),
            ModelGate::Softmax => thresholds.softmax_min = threshold,
        }
    }
}

impl DetectedFrame {
    /// The boxes for the refiner at a threshold of the gate, in the refiner's order.
    pub fn gated(&self, gate: ModelGate, threshold: f32) -> Vec<Detection> {
        self.detections.iter().filter_map(|d| gate.apply(d, threshold)).collect()
    }
}

/// One minus a value; 0, the closed set, stays 0. Exact in both directions for thresholds that are one minus a probability of at least one half.
fn complement(value: f32) -> f32 {
    if value > 0.0 { 1.0 - value } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_model::{Grid, Manifest, Network};

    fn with_logit(logit: f32) -> Detection {
        Detection { unknown_probability: 1.0 / (1.0 + (-logit).exp()), ..Detection::default() }
    }

    #[test]
    fn a_box_is_gated_at_its_own_value_and_not_below() {
        let gate = ModelGate::Known;
        let manifest = Manifest::untrained("t", Network::compact(Grid::udi(), 3));
        let mut thresholds = manifest.thresholds;
        for i in 1..200 {
            let detection = with_logit(0.07 * i as f32);
            let own = gate.value(&detection);
            assert!(gate.may_be(own));
            gate.set(&mut thresholds, own);
            assert_eq!(gate.threshold(&thresholds), own, "comes back");
            let candidate = |t: f32| {
                let mut of_class = detection;
                of_class.probabilities[0] = 1.0;
                let with_class = gate.apply(&of_class, t).expect("stays");
                let kept = gate.apply(&detection, t).is_some();
                assert_eq!(kept, with_class.is_candidate());
                kept
            };
            assert!(candidate(own) && !candidate(0.9 * own) && !candidate(0.0));
        }
        assert!(!gate.may_be(gate.value(&with_logit(-0.1))));
    }
}
