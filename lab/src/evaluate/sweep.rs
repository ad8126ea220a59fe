//! The threshold of the gate: open-set figures for many, and the choice of one (paper, section 4.3).

use super::report::entry;
use super::{ClassRule, Difficulty, Kind, Metric, SensorDetection, TruthFrame, harmonic_mean};
use rayon::prelude::*;

/// Part of the closed set's mean AP that a threshold may not fall below: "not reduced by more than 10 %", read as
/// relative, which fits the paper's second table (63.8 beside a closed set of 70.5).
const KNOWN_KEPT_MIN: f64 = 0.9;

/// Open-set figures at one threshold: percent, volumes, moderate, 40 positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepPoint {
    /// The threshold.
    pub threshold: f64,
    /// Mean AP of the known classes that have labels.
    pub map_known: f64,
    /// Unknown labels found by any unknown detection.
    pub recall_unknown: f64,
    /// AP of the unknown.
    pub ap_unknown: f64,
    /// Harmonic mean of known and unknown.
    pub map_harm: f64,
}

/// The figures at every threshold, in their order.
///
/// `detect(frame, threshold)` gives what is detected in the frame of that index when the gate has that threshold; it
/// is called from many threads and must depend on its arguments alone. The result does not depend on their number.
pub fn sweep(
    truths: &[TruthFrame],
    rules: &[ClassRule],
    thresholds: &[f64],
    detect: impl Fn(usize, f64) -> Vec<SensorDetection> + Sync,
) -> Vec<SweepPoint> {
    let point = |&threshold: &f64| {
        let frames: Vec<_> = truths
            .iter()
            .enumerate()
            .map(|(i, truth)| truth.with(&detect(i, threshold)))
            .collect();
        let (mut known_sum, mut known_count, mut ap_unknown, mut recall_unknown) =
            (0.0, 0, 0.0, 0.0);
        for rule in rules {
            let found = entry(&frames, rule, Metric::Space, Difficulty::Moderate);
            if rule.kind == Kind::Unknown {
                (ap_unknown, recall_unknown) = (found.ap.r40, found.recall_percent);
            } else if found.truth_count > 0 {
                known_sum += found.ap.r40;
                known_count += 1;
            }
        }
        let map_known = known_sum / f64::from(known_count.max(1));
        let map_harm = harmonic_mean(map_known, ap_unknown);
        SweepPoint {
            threshold,
            map_known,
            recall_unknown,
            ap_unknown,
            map_harm,
        }
    };
    thresholds.par_iter().map(point).collect()
}

/// The point with the best harmonic mean among those that keep nine tenths of the closed set's mean AP; the first of
/// equal ones; `None` when no point keeps them.
pub fn best_point(points: &[SweepPoint], closed_map_known: f64) -> Option<SweepPoint> {
    let kept = points
        .iter()
        .filter(|point| point.map_known >= KNOWN_KEPT_MIN * closed_map_known);
    kept.copied().reduce(|best, point| {
        if point.map_harm > best.map_harm {
            point
        } else {
            best
        }
    })
}

/// At most `count` thresholds that cut the values into equal parts, ascending, without repeats; values that are not
/// finite are left out.
pub fn quantile_grid(values: &[f64], count: usize) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    if sorted.is_empty() {
        return Vec::new();
    }
    let at = |i: usize| sorted[((2 * i + 1) * sorted.len() / (2 * count)).min(sorted.len() - 1)];
    let mut grid: Vec<f64> = (0..count).map(at).collect();
    grid.dedup();
    grid
}
