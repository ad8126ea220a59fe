//! How the threshold is chosen: the paper's way (on the test frames themselves, an oracle) and the honest one (on one
//! half of the frames, judged on the other, and swapped).

use super::{
    ClassRule, JudgedFrames, OpenSetFigures, SensorDetection, SweepPoint, TruthFrame, best_point,
    mean_and_spread,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Figures at one threshold, of several parts of the data.
#[derive(Clone, Debug, PartialEq)]
pub struct JudgedPoint {
    /// The threshold.
    pub threshold: f64,
    /// One entry a part, in their order.
    pub parts: Vec<OpenSetFigures>,
}

impl JudgedPoint {
    fn of_part(&self, part: usize) -> SweepPoint {
        let figures = &self.parts[part];
        SweepPoint {
            threshold: self.threshold,
            map_known: figures.known.r40,
            recall_unknown: figures.recall_unknown,
            ap_unknown: figures.unknown[0].r40,
            map_harm: figures.harmonic().r40,
        }
    }
}

/// Judges every threshold on every part (a part is a list of frame indices). `detect(frame, at)` gives what is detected in that
/// frame at the threshold of index `at`; it is called from many threads and must depend on its arguments alone.
pub fn judged_sweep(
    truths: &[TruthFrame],
    rules: &[ClassRule],
    thresholds: &[f64],
    parts: &[Vec<usize>],
    detect: impl Fn(usize, usize) -> Vec<SensorDetection> + Sync,
) -> Vec<JudgedPoint> {
    let point = |(at, threshold): (usize, &f64)| {
        let with = |(i, truth): (usize, &TruthFrame)| truth.with(&detect(i, at));
        let frames: Vec<_> = truths.iter().enumerate().map(with).collect();
        let judged = JudgedFrames::of(&frames, rules);
        JudgedPoint {
            threshold: *threshold,
            parts: parts.iter().map(|part| judged.figures(part)).collect(),
        }
    };
    thresholds.par_iter().enumerate().map(point).collect()
}

/// Frames of even and of odd index.
pub fn halves(frames: usize) -> [Vec<usize>; 2] {
    [0, 1].map(|first| (first..frames).step_by(2).collect())
}

/// Index of the best point on one part: the highest harmonic mean of those that keep nine tenths of the closed set's mAP, which is
/// the first point's. `None` without points.
pub fn best_index(points: &[JudgedPoint], part: usize) -> Option<usize> {
    let of_part: Vec<SweepPoint> = points.iter().map(|point| point.of_part(part)).collect();
    let closed = of_part.first()?.map_known;
    let best = best_point(&of_part, closed)?;
    of_part.iter().position(|point| *point == best)
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
    let judged = [
        points[chosen_odd].parts[even].named(),
        points[chosen_even].parts[odd].named(),
    ];
    let mean = |at: usize| mean_and_spread(&[judged[0][at].1, judged[1][at].1])[0];
    let named = judged[0].iter().enumerate();
    Some(Honest {
        thresholds: [points[chosen_even].threshold, points[chosen_odd].threshold],
        figures: named
            .map(|(at, (name, _))| ((*name).to_owned(), mean(at)))
            .collect(),
    })
}
