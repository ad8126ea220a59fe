//! Box voting: a kept box becomes the mean of itself and the boxes that it suppresses (Gidaris and Komodakis, "Object
//! detection via a multi-region & semantic segmentation-aware CNN model", section 4.3). Neighbouring anchors see the same
//! object, each with its own error; their logits of the unknown have errors too.

use crate::candidates::Candidate;
use mluc_geometry::{Box3, limit_period};
use std::f64::consts::{FRAC_PI_4, PI};

/// Minimum overlap, seen from above, at which a suppressed box may vote.
pub(crate) const VOTE_IOU_MIN: f64 = 0.5;

/// Sums, weighted by objectness, of the differences from a kept box (centre, logarithms of the sizes, yaw), and of the logits of the unknown.
#[derive(Clone, Debug)]
pub(crate) struct Votes {
    kept: Box3,
    class: usize,
    weight: f64,
    sums: [f64; 7],
    unknown: Option<f64>,
}

impl Votes {
    /// The vote of the kept box itself.
    pub(crate) fn of(candidate: &Candidate, kept: &Box3) -> Votes {
        let weight = f64::from(candidate.objectness);
        Votes {
            kept: *kept,
            class: candidate.class(),
            weight,
            sums: [0.0; 7],
            unknown: candidate.unknown.map(|logit| weight * f64::from(logit)),
        }
    }

    /// Adds a voter. A voter turned by half a turn is the same box. A voter of another class or across has no vote: its length is a width.
    pub(crate) fn add(&mut self, candidate: &Candidate, voter: &Box3) {
        let kept = &self.kept;
        let turn = limit_period(voter.yaw_rad - kept.yaw_rad, 0.5, PI);
        if candidate.class() != self.class || turn.abs() > FRAC_PI_4 {
            return;
        }
        let weight = f64::from(candidate.objectness);
        let [x, y, z] = [0, 1, 2].map(|i| voter.center_m[i] - kept.center_m[i]);
        let [l, w, h] = [0, 1, 2].map(|i| (voter.size_m[i] / kept.size_m[i]).ln());
        for (sum, difference) in self.sums.iter_mut().zip([x, y, z, l, w, h, turn]) {
            *sum += weight * difference;
        }
        if let (Some(sum), Some(logit)) = (&mut self.unknown, candidate.unknown) {
            *sum += weight * f64::from(logit);
        }
        self.weight += weight;
    }

    /// The mean box and its mean logit.
    pub(crate) fn mean(&self) -> (Box3, Option<f32>) {
        let kept = &self.kept;
        let [x, y, z, l, w, h, turn] = self.sums.map(|sum| sum / self.weight);
        let (moved, grown) = ([x, y, z], [l, w, h].map(f64::exp));
        let mean = Box3 {
            center_m: [0, 1, 2].map(|i| kept.center_m[i] + moved[i]),
            size_m: [0, 1, 2].map(|i| kept.size_m[i] * grown[i]),
            yaw_rad: limit_period(kept.yaw_rad + turn, 0.5, 2.0 * PI),
        };
        (mean, self.unknown.map(|sum| (sum / self.weight) as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_lies_between_by_weight_and_no_box_of_another_class_or_across_counts() {
        let candidate = |objectness, anchor, unknown| Candidate {
            objectness,
            row: 0,
            anchor,
            place: 0,
            unknown: Some(unknown),
        };
        let kept = Box3::new([20.0, 5.0, -0.8, 4.0, 1.6, 1.5, PI - 0.1]);
        let mut votes = Votes::of(&candidate(0.9, 0, 1.0), &kept);
        assert_eq!(votes.mean(), (kept, Some(1.0)));
        // A third of the weight, half a turn and 0.3 rad further on.
        let other = Box3::new([20.4, 5.0, -0.8, 4.4, 1.6, 1.5, 0.2]);
        votes.add(&candidate(0.45, 1, -2.0), &other);
        let across = Box3::new([22.0, 5.0, -0.8, 4.0, 1.6, 1.5, PI / 2.0]);
        votes.add(&candidate(0.9, 1, 9.0), &across);
        votes.add(&candidate(0.9, 2, 9.0), &other);
        let (mean, unknown) = votes.mean();
        let expected = [20.0 + 0.4 / 3.0, 5.0, -0.8, 4.0 * 1.1f64.powf(1.0 / 3.0)];
        let [x, y, z] = mean.center_m;
        for (found, expected) in [x, y, z, mean.size_m[0]].into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{mean:?}");
        }
        assert!((mean.yaw_rad.abs() - PI).abs() < 1e-6, "{mean:?}");
        assert!(unknown.is_some_and(|logit| logit.abs() < 1e-6));
    }
}
