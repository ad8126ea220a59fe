//! The threshold of the gate: open-set figures for many, and the choice of one (paper, section 4.3): the paper's way (on the test frames
//! themselves, an oracle) and the honest one (on one half of the frames, judged on the other, and swapped).

use crate::{ClassRule, FrameTruth, JudgedFrames, OpenSetFigures, SensorDetection, harmonic_mean};
use mluc_geometry::mean_and_spread;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Part of the closed set's mean AP that a threshold may not fall below: "not reduced by more than 10 %", read as
/// relative, which fits the paper's second table (63.8 beside a closed set of 70.5).
pub const KNOWN_KEPT_MIN: f64 = 0.9;

/// Open-set figures at one threshold: percent, volumes, moderate, 40 positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SweepPoint {
    /// The threshold.
    pub threshold: f64,
    /// Unknown labels found by any unknown detection.
    pub recall_unknown: f64,
    /// AP of the unknown.
    pub ap_unknown: f64,
    /// Mean AP of the known classes that have labels.
    pub map_known: f64,
}

impl SweepPoint {
    /// Harmonic mean of known and unknown.
    pub fn map_harm(&self) -> f64 {
        harmonic_mean(self.map_known, self.ap_unknown)
    }
}

/// Figures at one threshold, of several parts of the data.
#[derive(Clone, Debug, PartialEq)]
pub struct JudgedPoint {
    /// The threshold.
    pub threshold: f64,
    /// One entry a part, in their order.
    pub parts: Vec<OpenSetFigures>,
}

impl JudgedPoint {
    /// The main figures of one part.
    pub fn of_part(&self, part: usize) -> SweepPoint {
        let figures = &self.parts[part];
        SweepPoint {
            threshold: self.threshold,
            recall_unknown: figures.recall_unknown,
            ap_unknown: figures.unknown[0].r40,
            map_known: figures.known.r40,
        }
    }
}

/// Judges every threshold on every part (a part is a list of frame indices). `detect(frame, at)` gives what is detected in that
/// frame at the threshold of index `at`; it is called from many threads and must depend on its arguments alone. The result does not
/// depend on their number.
pub fn judged_sweep(
    truths: &[FrameTruth],
    rules: &[ClassRule],
    thresholds: &[f64],
    parts: &[Vec<usize>],
    detect: impl Fn(usize, usize) -> Vec<SensorDetection> + Sync,
) -> Vec<JudgedPoint> {
    let point = |(at, threshold): (usize, &f64)| {
        let with = |(i, truth): (usize, &FrameTruth)| truth.with(&detect(i, at));
        let frames: Vec<_> = truths.iter().enumerate().map(with).collect();
        let judged = JudgedFrames::of(&frames, rules);
        JudgedPoint {
            threshold: *threshold,
            parts: parts.iter().map(|part| judged.figures(part)).collect(),
        }
    };
    thresholds.par_iter().enumerate().map(point).collect()
}

/// The main figures of all frames at every threshold, in their order; `detect` as in [`judged_sweep`].
pub fn sweep(
    truths: &[FrameTruth],
    rules: &[ClassRule],
    thresholds: &[f64],
    detect: impl Fn(usize, usize) -> Vec<SensorDetection> + Sync,
) -> Vec<SweepPoint> {
    let all = [(0..truths.len()).collect()];
    let points = judged_sweep(truths, rules, thresholds, &all, detect);
    points.iter().map(|point| point.of_part(0)).collect()
}

/// The point with the best harmonic mean among those that keep nine tenths of the closed set's mean AP; the first of
/// equal ones; `None` when no point keeps them.
pub fn best_point(points: &[SweepPoint], closed_map_known: f64) -> Option<SweepPoint> {
    let least = KNOWN_KEPT_MIN * closed_map_known;
    let kept = points.iter().filter(|point| point.map_known >= least);
    let better = |best: SweepPoint, point: SweepPoint| {
        if point.map_harm() > best.map_harm() {
            point
        } else {
            best
        }
    };
    kept.copied().reduce(better)
}

/// Index of the best point on one part, the closed set being the first point. `None` without points.
pub fn best_index(points: &[JudgedPoint], part: usize) -> Option<usize> {
    let of_part: Vec<SweepPoint> = points.iter().map(|point| point.of_part(part)).collect();
    let best = best_point(&of_part, of_part.first()?.map_known)?;
    of_part.iter().position(|point| *point == best)
}

/// Frames of even and of odd index.
pub fn halves(frames: usize) -> [Vec<usize>; 2] {
    [0, 1].map(|first| (first..frames).step_by(2).collect())
}

/// Outcome of the honest protocol.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Honest {
    /// Thresholds chosen on the even and on the odd frames.
    pub thresholds: [f64; 2],
    /// Each figure's mean over the two halves, each judged at the threshold that the other chose. Counts are means too.
    pub figures: BTreeMap<String, f64>,
}

/// Chooses on each half and judges on the other; `parts` are the indices of the halves among the points' parts.
pub fn honest(points: &[JudgedPoint], parts: [usize; 2]) -> Option<Honest> {
    let [even, odd] = parts;
    let (chosen_even, chosen_odd) = (best_index(points, even)?, best_index(points, odd)?);
    let of_even = points[chosen_odd].parts[even].named();
    let of_odd = points[chosen_even].parts[odd].named();
    let pairs = of_even.iter().zip(&of_odd);
    let mean = |((name, a), (_, b)): (&(&str, f64), &(&str, f64))| {
        ((*name).to_owned(), mean_and_spread(&[*a, *b])[0])
    };
    Some(Honest {
        thresholds: [points[chosen_even].threshold, points[chosen_odd].threshold],
        figures: pairs.map(mean).collect(),
    })
}

/// At most `count` thresholds that cut the values into equal parts, ascending, without repeats; values that are not
/// finite are left out.
pub fn quantile_grid(values: &[f64], count: usize) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else {
        return Vec::new();
    };
    let at = |i: usize| sorted[((2 * i + 1) * sorted.len() / (2 * count)).min(last)];
    let mut grid: Vec<f64> = (0..count).map(at).collect();
    grid.dedup();
    grid
}
