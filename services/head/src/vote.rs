//! Box voting: a kept box becomes the mean of the boxes around it (Gidaris and Komodakis, "Object detection via a
//! multi-region & semantic segmentation-aware CNN model", section 4.3). Neighbouring anchors see the same object, each
//! with an error of its own; so do their logits of the unknown.

use mluc_geometry::{Box3, limit_period};
use std::f64::consts::{FRAC_PI_4, PI};

/// Boxes of the same class that overlap a kept one by so much, seen from above, vote.
pub(crate) const VOTE_IOU_MIN: f64 = 0.5;

/// The weighted mean of what differs from the first box: its centre, the logarithms of its sizes, its yaw; and of the logits of the unknown.
pub(crate) struct Votes {
    first: Box3,
    weight: f64,
    sums: [f64; 7],
    unknown: f64,
}

impl Votes {
    pub(crate) fn around(first: Box3) -> Votes {
        Votes {
            first,
            weight: 0.0,
            sums: [0.0; 7],
            unknown: 0.0,
        }
    }

    /// A box that looks the other way is the same box; one that lies across has its length for a width, and no vote.
    pub(crate) fn add(&mut self, voter: &Box3, unknown: Option<f32>, weight: f64) {
        let first = &self.first;
        let turn = limit_period(voter.yaw_rad - first.yaw_rad, 0.5, PI);
        if turn.abs() > FRAC_PI_4 {
            return;
        }
        let [x, y, z] = [0, 1, 2].map(|i| voter.center_m[i] - first.center_m[i]);
        let [l, w, h] = [0, 1, 2].map(|i| (voter.size_m[i] / first.size_m[i]).ln());
        for (sum, difference) in self.sums.iter_mut().zip([x, y, z, l, w, h, turn]) {
            *sum += weight * difference;
        }
        self.unknown += weight * f64::from(unknown.unwrap_or(0.0));
        self.weight += weight;
    }

    /// Box and logit; `unknown`: the first box's, which has voted too.
    pub(crate) fn mean(&self, unknown: Option<f32>) -> (Box3, Option<f32>) {
        if self.weight <= 0.0 {
            return (self.first, unknown);
        }
        let [x, y, z, l, w, h, turn] = self.sums.map(|sum| sum / self.weight);
        let (moved, grown, first) = ([x, y, z], [l, w, h].map(f64::exp), &self.first);
        let mean = Box3 {
            center_m: [0, 1, 2].map(|i| first.center_m[i] + moved[i]),
            size_m: [0, 1, 2].map(|i| first.size_m[i] * grown[i]),
            yaw_rad: limit_period(first.yaw_rad + turn, 0.5, 2.0 * PI),
        };
        let logit = (self.unknown / self.weight) as f32;
        (mean, unknown.map(|_| logit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_lies_between_by_weight_and_no_box_that_lies_across_counts() {
        let first = Box3::new([20.0, 5.0, -0.8, 4.0, 1.6, 1.5, PI - 0.1]);
        let mut votes = Votes::around(first);
        votes.add(&first, Some(1.0), 0.9);
        assert_eq!(votes.mean(None), (first, None));
        // A third of the weight, half a turn and 0.3 rad further on.
        let other = Box3::new([20.4, 5.0, -0.8, 4.4, 1.6, 1.5, 0.2]);
        votes.add(&other, Some(-1.0), 0.45);
        let across = Box3::new([22.0, 5.0, -0.8, 4.0, 1.6, 1.5, PI / 2.0]);
        votes.add(&across, Some(9.0), 0.9);
        let (mean, unknown) = votes.mean(Some(1.0));
        let expected = [20.0 + 0.4 / 3.0, 5.0, -0.8, 4.0 * 1.1f64.powf(1.0 / 3.0)];
        let [x, y, z] = mean.center_m;
        for (found, expected) in [x, y, z, mean.size_m[0]].into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{mean:?}");
        }
        assert!((mean.yaw_rad.abs() - PI).abs() < 1e-6, "{mean:?}");
        assert!((unknown.unwrap() - 1.0 / 3.0).abs() < 1e-6);
    }
}
