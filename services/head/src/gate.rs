//! The gate between knowns and candidate unknowns (paper section 3.2).

use mluc_ipc_types::{Detection, DetectionKind, GateKind};
use mluc_model::Thresholds;

/// A gate's threshold, in the gate's own unit; 0 without a gate.
pub fn threshold_of(gate: GateKind, thresholds: &Thresholds) -> f32 {
    match gate {
        GateKind::None => 0.0,
        GateKind::Eds => thresholds.eds_normalised_max,
        GateKind::UnknownProbability => thresholds.unknown_min,
        GateKind::SoftmaxMax => thresholds.softmax_min,
    }
}

/// A model's main gate: the first that has a threshold of probability of the unknown, EDS and largest class probability.
/// `is_open`: the head has a logit of the unknown.
pub fn main_gate(is_open: bool, thresholds: &Thresholds) -> GateKind {
    let first = is_open.then_some(GateKind::UnknownProbability).into_iter();
    let mut gates = first.chain([GateKind::Eds, GateKind::SoftmaxMax]);
    gates.find(|gate| threshold_of(*gate, thresholds) > 0.0).unwrap_or(GateKind::None)
}

/// Applies every threshold of a model. The gate fires if e is too small (the embedding lies near the prototypes' centre; e is never below 1, so a
/// threshold of 1 or less gives the closed-set detector), or if the largest class probability is too small (the naive gate of a softmax). If the head
/// has a logit of the unknown, its probability `unknown` alone may also fire, and the other two only fire if it is above one half: a known object is
/// never lost to a doubt. Returns the gate that fired, or for a known box the model's main gate.
pub fn gate_by(
    scores: &Detection,
    unknown: Option<f32>,
    thresholds: &Thresholds,
) -> (DetectionKind, GateKind) {
    let doubt = if scores.eds_normalised < thresholds.eds_normalised_max {
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
        Some(gate) => (DetectionKind::Candidate, gate),
        None => {
            let main = main_gate(unknown.is_some(), thresholds);
            (DetectionKind::Known, main)
        }
    }
}

/// Whether the probability of being none of the known classes reaches its threshold; a threshold of 0 gives the closed-set detector.
pub fn is_unknown(unknown: f32, unknown_min: f32) -> bool {
    unknown_min > 0.0 && unknown >= unknown_min
}

#[cfg(test)]
mod tests {
    use super::*;
    use mluc_model::{Grid, Manifest, Network};

    #[test]
    fn a_doubt_needs_the_logit_of_the_unknown_where_there_is_one() {
        use GateKind::{Eds, None as NoGate, SoftmaxMax, UnknownProbability as Logit};
        let scores = Detection { eds_normalised: 1.2, softmax_max: 0.4, ..Detection::default() };
        let network = Network::compact(Grid::udi(), 3);
        let mut thresholds = Manifest::untrained("t", network).thresholds;
        let (known, candidate) = (DetectionKind::Known, DetectionKind::Candidate);
        // softmax_min, eds_normalised_max, unknown_min; the probability of the unknown; kind, gate, threshold.
        for (limits, unknown, expected) in [
            ([0.0, 0.0, 0.0], None, (known, NoGate, 0.0)),
            ([0.5, 0.0, 0.0], None, (candidate, SoftmaxMax, 0.5)),
            ([0.5, 0.0, 0.0], Some(0.4), (known, SoftmaxMax, 0.5)),
            ([0.5, 0.0, 0.0], Some(0.6), (candidate, SoftmaxMax, 0.5)),
            ([0.0, 0.0, 0.0], Some(0.6), (known, NoGate, 0.0)),
            ([0.0, 1.2, 0.0], None, (known, Eds, 1.2)),
            ([0.0, 1.3, 0.0], None, (candidate, Eds, 1.3)),
            ([0.0, 1.3, 0.0], Some(0.4), (known, Eds, 1.3)),
            ([0.0, 1.3, 0.6], Some(0.6), (candidate, Logit, 0.6)),
            ([0.0, 1.3, 0.6], Some(0.4), (known, Logit, 0.6)),
        ] {
            let t = &mut thresholds;
            [t.softmax_min, t.eds_normalised_max, t.unknown_min] = limits;
            let (kind, gate) = gate_by(&scores, unknown, &thresholds);
            let found = (kind, gate, threshold_of(gate, &thresholds));
            assert_eq!(found, expected, "{limits:?}, {unknown:?}");
        }
    }
}
