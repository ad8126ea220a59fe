//! The gate between knowns and candidate unknowns (paper section 3.2).

use mluc_ipc_types::{DetectionKind, GateKind};
use mluc_model::Thresholds;

use crate::prototypes::Scores;

/// A box whose embedding lies near the prototypes' centre, e < threshold, belongs to no known class. e is never below 1:
/// a threshold of 1 or less is the closed-set detector.
pub fn gate(eds_normalised: f32, threshold: f32) -> DetectionKind {
    if eds_normalised < threshold {
        DetectionKind::Candidate
    } else {
        DetectionKind::Known
    }
}

/// On which side of which gate a box lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// The side.
    pub kind: DetectionKind,
    /// Of a candidate the gate that fired, of a known box the model's gate.
    pub gate: GateKind,
    /// That gate's threshold.
    pub threshold: f32,
}

impl Decision {
    fn of(kind: DetectionKind, gate: GateKind, thresholds: &Thresholds) -> Decision {
        Decision {
            kind,
            gate,
            threshold: match gate {
                GateKind::None => 0.0,
                GateKind::Eds => thresholds.eds_normalised_max,
                GateKind::UnknownProbability => thresholds.unknown_min,
                GateKind::SoftmaxMax => thresholds.softmax_min,
            },
        }
    }

    /// A box without a class: it is kept as a candidate by its probability alone.
    pub fn of_generic(thresholds: &Thresholds) -> Decision {
        let gate = GateKind::UnknownProbability;
        Decision::of(DetectionKind::Candidate, gate, thresholds)
    }
}

/// The gate that a model's candidates are told by, where several could: that of the probability of the unknown, of the
/// EDS, of the largest class probability. `is_open`: the head has a logit of the unknown.
pub fn main_gate(is_open: bool, thresholds: &Thresholds) -> GateKind {
    if is_open && thresholds.unknown_min > 0.0 {
        GateKind::UnknownProbability
    } else if thresholds.eds_normalised_max > 0.0 {
        GateKind::Eds
    } else if thresholds.softmax_min > 0.0 {
        GateKind::SoftmaxMax
    } else {
        GateKind::None
    }
}

/// By every threshold of a model: e is too small, or the largest class probability (the naive gate of a softmax). Where
/// the head has a logit of the unknown, its probability `unknown` alone may fire too, and the other two must have it
/// above one half: a known object is never lost to a doubt.
pub fn gate_by(scores: &Scores, unknown: Option<f32>, thresholds: &Thresholds) -> Decision {
    let eds = gate(scores.eds_normalised, thresholds.eds_normalised_max);
    let doubt = if eds == DetectionKind::Candidate {
        Some(GateKind::Eds)
    } else {
        (scores.softmax_max < thresholds.softmax_min).then_some(GateKind::SoftmaxMax)
    };
    let fired = match unknown {
        None => doubt,
        Some(p) if is_unknown(p, thresholds.unknown_min) => Some(GateKind::UnknownProbability),
        Some(p) => doubt.filter(|_| p > 0.5),
    };
    match fired {
        Some(gate) => Decision::of(DetectionKind::Candidate, gate, thresholds),
        None => {
            let gate = main_gate(unknown.is_some(), thresholds);
            Decision::of(DetectionKind::Known, gate, thresholds)
        }
    }
}

/// Whether the probability of being none of the known reaches its threshold; a threshold of 0 is the closed-set detector.
pub fn is_unknown(unknown: f32, unknown_min: f32) -> bool {
    unknown_min > 0.0 && unknown >= unknown_min
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_model::{Grid, Manifest, Network};

    #[test]
    fn below_the_threshold_is_a_candidate() {
        assert_eq!(gate(1.2, 1.5), DetectionKind::Candidate);
        assert_eq!(gate(1.5, 1.5), DetectionKind::Known);
        assert_eq!(gate(1.0, 0.0), DetectionKind::Known);
    }

    #[test]
    fn a_doubt_needs_the_logit_of_the_unknown_where_there_is_one() {
        let network = Network::compact(Grid::udi(), 3);
        let mut thresholds = Manifest::untrained("t", network).thresholds;
        let scores = Scores {
            eds_normalised: 1.2,
            softmax_max: 0.4,
            ..Scores::default()
        };
        let (known, candidate) = (DetectionKind::Known, DetectionKind::Candidate);
        let decided = |unknown, thresholds: &Thresholds| {
            let decision = gate_by(&scores, unknown, thresholds);
            (decision.kind, decision.gate, decision.threshold)
        };
        assert_eq!(decided(None, &thresholds), (known, GateKind::None, 0.0));
        thresholds.softmax_min = 0.5;
        let softmax = GateKind::SoftmaxMax;
        assert_eq!(decided(None, &thresholds), (candidate, softmax, 0.5));
        assert_eq!(decided(Some(0.4), &thresholds), (known, softmax, 0.5));
        assert_eq!(decided(Some(0.6), &thresholds), (candidate, softmax, 0.5));
        thresholds.softmax_min = 0.0;
        assert_eq!(
            decided(Some(0.6), &thresholds),
            (known, GateKind::None, 0.0)
        );
        thresholds.eds_normalised_max = 1.3;
        assert_eq!(decided(None, &thresholds), (candidate, GateKind::Eds, 1.3));
        assert_eq!(decided(Some(0.4), &thresholds), (known, GateKind::Eds, 1.3));
        thresholds.unknown_min = 0.6;
        let probability = GateKind::UnknownProbability;
        assert_eq!(
            decided(Some(0.6), &thresholds),
            (candidate, probability, 0.6)
        );
        assert_eq!(decided(Some(0.4), &thresholds), (known, probability, 0.6));
    }
}
