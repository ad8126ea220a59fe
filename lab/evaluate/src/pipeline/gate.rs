//! The gate at any threshold: which boxes of a model are known and which go to the refiner.
//!
//! The network runs once with every box kept; this says what the head says at a threshold of its own. A threshold is always
//! one on a score that is low for the unknown, and 0 is the closed set.

use mluc_head::{Detection, gate};
use mluc_ipc_types::{DetectionKind, GateKind};
use mluc_model::{HeadKind, Model, Thresholds};

/// What a model's boxes are gated by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelGate {
    /// The normalised EDS (paper section 3.2).
    Eds,
    /// One minus the probability of being none of the known.
    Known,
}

impl ModelGate {
    /// Of a model: by its head.
    pub fn of(model: &Model) -> ModelGate {
        match model.manifest.network.head {
            HeadKind::Open => ModelGate::Known,
            _ => ModelGate::Eds,
        }
    }

    /// In words.
    pub fn describe(self) -> &'static str {
        match self {
            ModelGate::Eds => "normalised EDS",
            ModelGate::Known => "one minus P(unknown), below a half",
        }
    }

    /// What the threshold stands against.
    pub fn value(self, detection: &Detection) -> f32 {
        match self {
            ModelGate::Eds => detection.eds_normalised,
            ModelGate::Known => 1.0 - detection.unknown_probability,
        }
    }

    /// Whether a sweep tries a threshold: a box that is more likely known than not is never gated by the logit.
    pub fn may_be(self, threshold: f32) -> bool {
        match self {
            ModelGate::Eds => true,
            ModelGate::Known => threshold > 0.0 && threshold <= 0.5,
        }
    }

    /// The box with its kind at a threshold; `None` for one without a class (`is_generic`) that is not unknown.
    pub fn apply(
        self,
        detection: &Detection,
        is_generic: bool,
        threshold: f32,
    ) -> Option<Detection> {
        let kind = match self {
            ModelGate::Eds => gate::gate(detection.eds_normalised, threshold),
            ModelGate::Known => {
                if gate::is_unknown(detection.unknown_probability, unknown_min(threshold)) {
                    DetectionKind::Candidate
                } else {
                    DetectionKind::Known
                }
            }
        };
        let stays = !is_generic || kind == DetectionKind::Candidate;
        stays.then_some(Detection {
            kind: kind as u32,
            gate: match self {
                ModelGate::Eds => GateKind::Eds,
                ModelGate::Known => GateKind::UnknownProbability,
            } as u32,
            threshold: match self {
                ModelGate::Eds => threshold,
                ModelGate::Known => unknown_min(threshold),
            },
            ..*detection
        })
    }

    /// A model's own threshold.
    pub fn threshold(self, thresholds: &Thresholds) -> f32 {
        match self {
            ModelGate::Eds => thresholds.eds_normalised_max,
            ModelGate::Known if thresholds.unknown_min == 0.0 => 0.0,
            ModelGate::Known => 1.0 - thresholds.unknown_min,
        }
    }

    /// Puts a threshold into a model.
    pub fn set(self, thresholds: &mut Thresholds, threshold: f32) {
        match self {
            ModelGate::Eds => thresholds.eds_normalised_max = threshold,
            ModelGate::Known => thresholds.unknown_min = unknown_min(threshold),
        }
    }
}

/// Exact, both ways, for thresholds that are one minus a probability of a half or more.
fn unknown_min(threshold: f32) -> f32 {
    if threshold > 0.0 {
        1.0 - threshold
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_logit(logit: f32) -> Detection {
        Detection {
            unknown_probability: 1.0 / (1.0 + (-logit).exp()),
            ..Detection::default()
        }
    }

    #[test]
    fn a_box_is_gated_at_its_own_value_and_not_below() {
        let gate = ModelGate::Known;
        let mut thresholds = mluc_model::Manifest::untrained(
            "t",
            mluc_model::Network::compact(mluc_model::Grid::udi(), 3),
        )
        .thresholds;
        for i in 1..200 {
            let detection = with_logit(0.07 * i as f32);
            let own = gate.value(&detection);
            assert!(gate.may_be(own));
            gate.set(&mut thresholds, own);
            assert_eq!(gate.threshold(&thresholds), own, "comes back");
            let candidate = |t: f32| {
                let kept = gate.apply(&detection, true, t);
                assert_eq!(
                    kept.is_some(),
                    gate.apply(&detection, false, t)
                        .is_some_and(|d| d.is_candidate())
                );
                kept.is_some()
            };
            assert!(candidate(own) && !candidate(0.9 * own) && !candidate(0.0));
        }
        assert!(!gate.may_be(gate.value(&with_logit(-0.1))));
    }
}
