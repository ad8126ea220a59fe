//! The threshold of the gate: open-set figures for many thresholds, and the choice of one (paper, section 4.3): the paper's way (on the test
//! frames themselves, an oracle) and an honest protocol (chosen on one half of the frames, evaluated on the other, then swapped).

use crate::{ClassRule, JudgedFrames, LabelledFrame, OpenSetFigures, harmonic_mean};
use mluc_geometry::mean_and_spread;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Minimum share of the closed set's mean AP at a threshold: "not reduced by more than 10 %", read as
/// relative, which fits the paper's second table (63.8 with a closed set of 70.5).
pub const KNOWN_KEPT_MIN: f64 = 0.9;

/// Open-set figures at one threshold: percent, 3D boxes, moderate, 40 positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SweepPoint {
    /// The threshold.
    pub threshold: f64,
    /// Share of unknown labels found by any unknown detection.
    pub recall_unknown: f64,
    /// AP of the unknown.
    pub ap_unknown: f64,
    /// Mean AP of the known classes that have labels.
    pub map_known: f64,
}

impl SweepPoint {
    fn of(threshold: f64, figures: &OpenSetFigures) -> SweepPoint {
        SweepPoint {
            threshold,
            recall_unknown: figures.recall_unknown,
            ap_unknown: figures.unknown[0].r40,
            map_known: figures.known.r40,
        }
    }

    /// Harmonic mean of known and unknown.
    pub fn map_harm(&self) -> f64 {
        harmonic_mean(self.map_known, self.ap_unknown)
    }
}

/// Figures at one threshold.
#[derive(Clone, Debug, PartialEq)]
pub struct JudgedPoint {
    /// The threshold.
    pub threshold: f64,
    /// Figures of all frames.
    pub all: OpenSetFigures,
    /// Figures of the frames of even and of odd index.
    pub halves: [OpenSetFigures; 2],
}

impl JudgedPoint {
    /// Evaluates the frames of a threshold.
    pub(crate) fn of(threshold: f64, frames: &[LabelledFrame], rules: &[ClassRule]) -> JudgedPoint {
        let judged = JudgedFrames::of(frames, rules);
        let half = |first: usize| (first..frames.len()).step_by(2).collect::<Vec<_>>();
        JudgedPoint {
            threshold,
            all: judged.all(),
            halves: [0, 1].map(|first| judged.figures(&half(first))),
        }
    }

    /// The main figures of all frames.
    pub fn main(&self) -> SweepPoint {
        SweepPoint::of(self.threshold, &self.all)
    }
}

/// Index of the point with the best harmonic mean among the points that keep nine tenths of the mean AP of the first point, the closed
/// set; the first one at equal values; 0 without points.
pub fn best_index(points: &[SweepPoint]) -> usize {
    let keeps = |i: &usize| points[*i].map_known >= KNOWN_KEPT_MIN * points[0].map_known;
    let harm = |i: usize| points[i].map_harm();
    let better = |best: usize, i: usize| if harm(i) > harm(best) { i } else { best };
    (0..points.len()).filter(keeps).fold(0, better)
}

/// Outcome of the honest protocol.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Honest {
    /// Thresholds chosen on the even and on the odd frames.
    pub thresholds: [f64; 2],
    /// Each figure's mean over the two halves, each evaluated at the threshold that the other half chose. Counts are means too.
    pub figures: BTreeMap<String, f64>,
}

/// Chooses on each half and evaluates on the other; `None` without points.
pub fn honest(points: &[JudgedPoint]) -> Option<Honest> {
    points.first()?;
    let [even, odd] = [0, 1].map(|half| {
        let of_half = points.iter().map(|p| SweepPoint::of(p.threshold, &p.halves[half]));
        best_index(&of_half.collect::<Vec<_>>())
    });
    let of_even = points[odd].halves[0].named().into_iter();
    let pairs = of_even.zip(points[even].halves[1].named());
    let means = pairs.map(|((name, a), (_, b))| (name, mean_and_spread(&[a, b])[0]));
    Some(Honest {
        thresholds: [points[even].threshold, points[odd].threshold],
        figures: means.collect(),
    })
}

/// At most `count` quantiles of the values, ascending, without repeats; non-finite values are left out.
pub(crate) fn quantile_grid(values: &[f64], count: usize) -> Vec<f64> {
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
