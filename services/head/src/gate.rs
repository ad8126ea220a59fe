//! The gate between knowns and candidate unknowns (paper section 3.2).

use mluc_ipc_types::DetectionKind;
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

/// By every threshold of a model: e is too small, or the largest class probability (the naive gate of a softmax). Where
/// the head has a logit of the unknown, its probability `unknown` alone may fire too, and the other two must have it
/// above one half: a known object is never lost to a doubt.
pub fn gate_by(scores: &Scores, unknown: Option<f32>, thresholds: &Thresholds) -> DetectionKind {
    let doubt = gate(scores.eds_normalised, thresholds.eds_normalised_max)
        == DetectionKind::Candidate
        || scores.softmax_max < thresholds.softmax_min;
    let fires = unknown.map_or(doubt, |p| {
        (doubt && p > 0.5) || is_unknown(p, thresholds.unknown_min)
    });
    if fires {
        DetectionKind::Candidate
    } else {
        DetectionKind::Known
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
        assert_eq!(gate_by(&scores, None, &thresholds), known);
        thresholds.softmax_min = 0.5;
        assert_eq!(gate_by(&scores, None, &thresholds), candidate);
        assert_eq!(gate_by(&scores, Some(0.4), &thresholds), known);
        assert_eq!(gate_by(&scores, Some(0.6), &thresholds), candidate);
        thresholds.softmax_min = 0.0;
        assert_eq!(gate_by(&scores, Some(0.6), &thresholds), known);
        thresholds.unknown_min = 0.6;
        assert_eq!(gate_by(&scores, Some(0.6), &thresholds), candidate);
    }
}
