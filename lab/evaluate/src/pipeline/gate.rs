//! The gate at any threshold: which boxes of a model are known and which go to the refiner.
//!
//! The network runs once with every box kept; this says what the head says at a threshold of its own. A threshold is always
//! one on a score that is low for the unknown, and 0 is the closed set.

use super::DetectedFrame;
use crate::sweep::{best_index_from, quantile_grid};
use crate::{SweepPoint, best_index};
use mluc_head::{Detection, gate};
use mluc_ipc_types::{DetectionKind, GateKind};
use mluc_model::{HeadKind, Model, Thresholds};

/// Thresholds tried beside the closed set.
pub const THRESHOLDS: usize = 60;

/// What a model's boxes are gated by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelGate {
    /// The normalised EDS (paper section 3.2).
    Eds,
    /// One minus the probability of being none of the known.
    Known,
    /// The largest class probability: the naive baseline's.
    Softmax,
}

impl ModelGate {
    /// Which point of a sweep (the closed set first) the threshold is taken from: the best harmonic mean, as in the paper. Of an open head it is the one that
    /// finds most unknown labels of those nearly as good: an operating profile limits false objects, so the gate need not.
    pub fn best_index(self, sweep: &[SweepPoint]) -> usize {
        const KNOWN_LOST_MAX: f64 = 0.15;
        const HARM_LOST_MAX: f64 = 0.5;
        if self != ModelGate::Known {
            return best_index(sweep);
        }
        let known_min = sweep[0].map_known - KNOWN_LOST_MAX;
        let best = best_index_from(sweep, known_min);
        let harm_min = sweep[best].map_harm() - HARM_LOST_MAX;
        let is_near =
            |at: &usize| sweep[*at].map_known >= known_min && sweep[*at].map_harm() >= harm_min;
        let recall = |at: &usize| sweep[*at].recall_unknown;
        let near = (0..sweep.len()).filter(is_near);
        near.max_by(|a, b| recall(a).total_cmp(&recall(b)))
            .unwrap_or(best)
    }

    /// That rule, in words.
    pub(super) fn rule(self) -> &'static str {
        match self {
            ModelGate::Known => {
                "most unknown labels found, of those with a harmonic mean of mAP known and AP unknown (R40, moderate) at most 0.5 \
                 below the best and mAP known at most 0.15 points below the closed set's"
            }
            _ => {
                "best harmonic mean of mAP known and AP unknown (R40, moderate), of those with mAP known at least 0.9 of the closed \
                 set's"
            }
        }
    }

    /// Of a model: by its head.
    pub fn of(model: &Model) -> ModelGate {
        match model.manifest.network.head {
            HeadKind::Open => ModelGate::Known,
            _ => ModelGate::Eds,
        }
    }

    /// In words.
    pub(super) fn describe(self) -> &'static str {
        match self {
            ModelGate::Eds => "normalised EDS",
            ModelGate::Known => "one minus P(unknown), below a half",
            ModelGate::Softmax => "largest class probability",
        }
    }

    /// What the threshold stands against.
    pub fn value(self, detection: &Detection) -> f32 {
        match self {
            ModelGate::Eds => detection.eds_normalised,
            ModelGate::Known => 1.0 - detection.unknown_probability,
            ModelGate::Softmax => detection.softmax_max,
        }
    }

    /// What orders unknown boxes among each other where nothing else does: the paper's 1 / EDS, or one minus the probability.
    pub fn rank(self, detection: &Detection) -> f32 {
        match self {
            ModelGate::Eds => 1.0 / detection.eds.max(1e-6),
            ModelGate::Known | ModelGate::Softmax => 1.0 - self.value(detection),
        }
    }

    /// 0, the closed set, then at most `count` thresholds that cut what the boxes have into equal parts, ascending.
    pub fn thresholds(self, frames: &[DetectedFrame], count: usize) -> Vec<f64> {
        let boxes = frames.iter().flat_map(|frame| &frame.detections);
        let values = boxes.map(|d| self.value(d)).filter(|v| self.may_be(*v));
        let values: Vec<f64> = values.map(f64::from).collect();
        let grid = quantile_grid(&values, count);
        [0.0].into_iter().chain(grid).collect()
    }

    /// Whether a sweep tries a threshold: a box that is more likely known than not is never gated by the logit.
    fn may_be(self, threshold: f32) -> bool {
        self != ModelGate::Known || (threshold > 0.0 && threshold <= 0.5)
    }

    /// The box with its kind at a threshold; `None` for one without a class (`is_generic`) that is not unknown.
    pub(super) fn apply(
        self,
        detection: &Detection,
        is_generic: bool,
        threshold: f32,
    ) -> Option<Detection> {
        let (gate_kind, threshold) = match self {
            ModelGate::Eds => (GateKind::Eds, threshold),
            ModelGate::Known => (GateKind::UnknownProbability, unknown_min(threshold)),
            ModelGate::Softmax => (GateKind::SoftmaxMax, threshold),
        };
        let is_unknown = match self {
            ModelGate::Known => gate::is_unknown(detection.unknown_probability, threshold),
            _ => self.value(detection) < threshold,
        };
        if is_generic && !is_unknown {
            return None;
        }
        let kind = if is_unknown {
            DetectionKind::Candidate
        } else {
            DetectionKind::Known
        };
        let eds = match self {
            // The paper's refiner ranks by 1 / EDS: there the box carries this gate's rank.
            ModelGate::Softmax => 1.0 / self.rank(detection).max(1e-6),
            _ => detection.eds,
        };
        Some(Detection {
            kind: kind as u32,
            gate: gate_kind as u32,
            threshold,
            eds,
            ..*detection
        })
    }

    /// A model's own threshold.
    pub(super) fn threshold(self, thresholds: &Thresholds) -> f32 {
        match self {
            ModelGate::Eds => thresholds.eds_normalised_max,
            ModelGate::Known if thresholds.unknown_min == 0.0 => 0.0,
            ModelGate::Known => 1.0 - thresholds.unknown_min,
            ModelGate::Softmax => thresholds.softmax_min,
        }
    }

    /// Puts a threshold into a model.
    pub fn set(self, thresholds: &mut Thresholds, threshold: f32) {
        match self {
            ModelGate::Eds => thresholds.eds_normalised_max = threshold,
            ModelGate::Known => thresholds.unknown_min = unknown_min(threshold),
            ModelGate::Softmax => thresholds.softmax_min = threshold,
        }
    }
}

/// Exact, both ways, for thresholds that are one minus a probability of a half or more.
fn unknown_min(threshold: f32) -> f32 {
    let least = 1.0 - threshold;
    if threshold > 0.0 { least } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_model::{Grid, Manifest, Network};

    fn with_logit(logit: f32) -> Detection {
        Detection {
            unknown_probability: 1.0 / (1.0 + (-logit).exp()),
            ..Detection::default()
        }
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
                let with_class = gate.apply(&detection, false, t).expect("stays");
                let kept = gate.apply(&detection, true, t).is_some();
                assert_eq!(kept, with_class.is_candidate());
                kept
            };
            assert!(candidate(own) && !candidate(0.9 * own) && !candidate(0.0));
        }
        assert!(!gate.may_be(gate.value(&with_logit(-0.1))));
    }
}
