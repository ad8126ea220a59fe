//! The gate at any threshold: which boxes of a model are known and which go to the refiner.
//!
//! The network runs once with every box kept; this says what the head says at a threshold of its own. A threshold is always
//! one on a score that is low for the unknown, and 0 is the closed set.

use mluc_head::{Detection, gate};
use mluc_ipc_types::DetectionKind;
use mluc_model::{HeadKind, Model, Thresholds};

/// What a model's boxes are gated by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gate {
    /// The normalised EDS (paper section 3.2).
    Eds,
    /// One minus the probability of being none of the known: of the logit at this place of the embedding.
    Known {
        /// The place.
        logit_at: usize,
    },
}

impl Gate {
    /// Of a model: by its head.
    pub fn of(model: &Model) -> Gate {
        match model.manifest.network.head {
            HeadKind::Open => Gate::Known {
                logit_at: model.manifest.classes.len(),
            },
            _ => Gate::Eds,
        }
    }

    /// In words.
    pub fn describe(self) -> &'static str {
        match self {
            Gate::Eds => "normalised EDS",
            Gate::Known { .. } => "one minus P(unknown), below a half",
        }
    }

    /// What the threshold stands against.
    pub fn value(self, detection: &Detection) -> f32 {
        match self {
            Gate::Eds => detection.eds_normalised,
            Gate::Known { logit_at } => 1.0 - probability(detection, logit_at),
        }
    }

    /// Whether a sweep looks at a threshold: a box that is more likely known than not is never gated by the logit.
    pub fn may_be(self, threshold: f32) -> bool {
        match self {
            Gate::Eds => true,
            Gate::Known { .. } => threshold > 0.0 && threshold <= 0.5,
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
            Gate::Eds => gate::gate(detection.eds_normalised, threshold),
            Gate::Known { logit_at } => {
                let unknown = probability(detection, logit_at);
                match gate::is_unknown(unknown, unknown_min(threshold)) {
                    true => DetectionKind::Candidate,
                    false => DetectionKind::Known,
                }
            }
        };
        let stays = !is_generic || kind == DetectionKind::Candidate;
        stays.then_some(Detection {
            kind: kind as u32,
            threshold: match self {
                Gate::Eds => threshold,
                Gate::Known { .. } => detection.threshold,
            },
            ..*detection
        })
    }

    /// A model's own threshold.
    pub fn threshold(self, thresholds: &Thresholds) -> f32 {
        match self {
            Gate::Eds => thresholds.eds_normalised_max,
            Gate::Known { .. } if thresholds.unknown_min == 0.0 => 0.0,
            Gate::Known { .. } => 1.0 - thresholds.unknown_min,
        }
    }

    /// Puts a threshold into a model.
    pub fn set(self, thresholds: &mut Thresholds, threshold: f32) {
        match self {
            Gate::Eds => thresholds.eds_normalised_max = threshold,
            Gate::Known { .. } => thresholds.unknown_min = unknown_min(threshold),
        }
    }
}

/// As the head computes it.
fn probability(detection: &Detection, logit_at: usize) -> f32 {
    let logit = detection.embedding.get(logit_at).copied().unwrap_or(0.0);
    1.0 / (1.0 + (-logit).exp())
}

/// Exact, both ways, for thresholds that are one minus a probability of a half or more.
fn unknown_min(threshold: f32) -> f32 {
    match threshold > 0.0 {
        true => 1.0 - threshold,
        false => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_logit(logit: f32) -> Detection {
        let mut detection = Detection::default();
        detection.embedding[3] = logit;
        detection
    }

    #[test]
    fn a_box_is_gated_at_its_own_value_and_not_below() {
        let gate = Gate::Known { logit_at: 3 };
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
