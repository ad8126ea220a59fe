//! Two models on the same scans: the AP of each, their difference, and confidence intervals (paired bootstrap).

use crate::{ClassRule, Difficulty, LabelledFrame, Metric, curve::Curve, matching::match_frame};
use mluc_geometry::{Random, quantile_of, resample};
use rayon::prelude::*;
use serde_json::{Value, json};

const DRAWS: u64 = 1000;

/// By class and difficulty: the labels that count, and AP over all points (3D boxes, percent) of the first model, of the second (`ap_beside`),
/// and first minus second; each figure is followed by its 95 % interval. Both models use the same resampled frames. Single frames are resampled:
/// for frames of one drive, which are correlated, the intervals are too narrow.
pub fn paired(pair: [&[LabelledFrame]; 2], rules: &[ClassRule]) -> Value {
    let count = pair[0].len();
    let draw = |number| resample(count, 1, &mut Random::new(1, &[number]));
    let draws: Vec<Vec<usize>> = (0..DRAWS).map(draw).collect();
    let one = |(rule, difficulty): (&ClassRule, Difficulty)| {
        let judged = pair.map(|frames| {
            let judge = |frame| match_frame(frame, rule, Metric::Space, difficulty, None);
            frames.par_iter().map(judge).collect::<Vec<_>>()
        });
        let figures = |indices: &[usize]| {
            let curve = |of: &Vec<Curve>| Curve::of(indices.iter().map(|&at| &of[at]));
            let [first, second] = judged.each_ref().map(curve);
            let [ap, beside] = [&first, &second].map(|curve| curve.average_precision().all);
            ([ap, beside, ap - beside], first.truth_count)
        };
        let (all, labels) = figures(&(0..count).collect::<Vec<_>>());
        // A resample without a label has no AP.
        let drawn = draws.par_iter().map(|draw| figures(draw));
        let drawn: Vec<_> = drawn.filter_map(|(of, labels)| (labels > 0).then_some(of)).collect();
        let bound = |at: usize, share| quantile_of(drawn.iter().map(|d| d[at]).collect(), share);
        let of = |at| json!([all[at], bound(at, 0.025), bound(at, 0.975)]);
        json!({"class": rule.name, "difficulty": difficulty.name(), "labels": labels, "ap": of(0), "ap_beside": of(1), "difference": of(2)})
    };
    rules.iter().flat_map(|rule| Difficulty::ALL.map(|level| (rule, level))).map(one).collect()
}
