//! The probability that a cluster is something that drives or walks: a few dense layers on its measurements.
//!
//! A box says that an object may be there. The measurements of bushes, walls and posts differ from the measurements of bodies of any
//! class. The layers are fitted without any unknown class. Extension of the paper, which ranks by the embedding alone.

use crate::clusters::Measures;
use mluc_model::{CLUSTER_SCORER, CLUSTER_SCORER_VALUES, CLUSTER_SCORER_WIDTHS, WeightSet};

/// Number of measurements that are used.
pub const FEATURES: usize = CLUSTER_SCORER_WIDTHS[0];
/// Maximum width of a layer.
const WIDEST: usize = 32;

const _: () = {
    let [a, b, c, d] = CLUSTER_SCORER_WIDTHS;
    assert!(a <= WIDEST && b <= WIDEST && c <= WIDEST && d <= WIDEST);
};

/// The measurements scaled to about 1; the first three are the logarithms of the seen sizes.
pub fn features(m: &Measures) -> [f32; FEATURES] {
    let log = |v: f32| v.max(0.05).ln();
    let [l, w, h] = m.seen_m;
    [
        log(l),
        log(w),
        log(h),
        m.bottom_m,
        m.top_m / 2.0,
        2.0 * m.linearity - 1.0,
        2.0 * m.planarity - 1.0,
        4.0 * m.scattering,
        4.0 * m.residual_m,
        log(m.density),
        ((m.points.max(1) as f32).ln() - 4.0) / 2.0,
        m.range_m / 25.0 - 1.0,
        log(m.component_length_m) - 1.0,
        f32::from(m.is_cut),
    ]
}

/// The fitted layers, in the layout of [`CLUSTER_SCORER`].
#[derive(Clone, Debug, PartialEq)]
pub struct ClusterScorer {
    values: Vec<f32>,
}

impl ClusterScorer {
    /// `None` for another number of values than [`CLUSTER_SCORER_VALUES`].
    pub fn new(values: Vec<f32>) -> Option<ClusterScorer> {
        (values.len() == CLUSTER_SCORER_VALUES).then_some(ClusterScorer { values })
    }

    /// The scorer from a model's weights, if they have one.
    pub fn of_model(weights: &WeightSet) -> Option<ClusterScorer> {
        ClusterScorer::new(weights.find(CLUSTER_SCORER)?.data.clone())
    }

    /// Writes the scorer into a model's weights.
    pub fn write(&self, weights: &mut WeightSet) {
        let shape = vec![CLUSTER_SCORER_VALUES];
        weights.insert(CLUSTER_SCORER, shape, self.values.clone());
    }

    /// The score of one cluster, 0 to 1; 0 if the layers give NaN.
    pub fn score(&self, measures: &Measures) -> f32 {
        let score = 1.0 / (1.0 + (-self.logit(&features(measures))).exp());
        if score.is_nan() { 0.0 } else { score }
    }

    /// The output of the last layer for [`features`].
    pub fn logit(&self, features: &[f32; FEATURES]) -> f32 {
        let mut x = [0.0; WIDEST];
        x[..FEATURES].copy_from_slice(features);
        let mut rest = &self.values[..];
        for pair in CLUSTER_SCORER_WIDTHS.windows(2) {
            let (cin, cout) = (pair[0], pair[1]);
            let (weights, after) = rest.split_at(cin * cout);
            let (bias, after) = after.split_at(cout);
            rest = after;
            let mut y = [0.0; WIDEST];
            y[..cout].copy_from_slice(bias);
            for (x, weights) in x.iter().zip(weights.chunks_exact(cout)) {
                y.iter_mut().zip(weights).for_each(|(y, w)| *y += x * w);
            }
            if !rest.is_empty() {
                y.iter_mut().for_each(|y| *y = y.max(0.0));
            }
            x = y;
        }
        x[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_overflows_scores_like_nothing() {
        let mut values = vec![f32::MAX; CLUSTER_SCORER_VALUES];
        values[CLUSTER_SCORER_VALUES - 2] = f32::MIN;
        let score = ClusterScorer { values }.score(&Measures::default());
        assert!((0.0..=1.0).contains(&score), "{score}");
    }
}
