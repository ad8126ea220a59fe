//! From matches to average precision.

/// Recall positions of the devkit: 0, 1/40, ..., 1.
const POSITIONS: usize = 41;

/// Average precision in percent, three ways.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AveragePrecision {
    /// Mean at the 11 recalls 0, 0.1, ..., 1.
    pub r11: f64,
    /// Mean at the 40 recalls 1/40, ..., 1. With fewer than 41 labels even a perfect detector stays below 100.
    pub r40: f64,
    /// Area under the whole curve; 100 for a perfect detector whatever the number of labels.
    pub all: f64,
}

impl AveragePrecision {
    fn each_way(figure: impl Fn(fn(&AveragePrecision) -> f64) -> f64) -> AveragePrecision {
        AveragePrecision {
            r11: figure(|ap| ap.r11),
            r40: figure(|ap| ap.r40),
            all: figure(|ap| ap.all),
        }
    }

    /// The mean of several values, separately for each way of averaging; 0 for an empty slice.
    pub fn mean(of: &[AveragePrecision]) -> AveragePrecision {
        let count = of.len().max(1) as f64;
        AveragePrecision::each_way(|way| of.iter().map(way).fold(0.0, |a, b| a + b) / count)
    }

    /// The harmonic mean of two values, separately for each way of averaging.
    pub fn harmonic(self, other: AveragePrecision) -> AveragePrecision {
        AveragePrecision::each_way(|way| harmonic_mean(way(&self), way(&other)))
    }
}

/// Harmonic mean of two percentages; 0 when both are 0.
pub fn harmonic_mean(known: f64, unknown: f64) -> f64 {
    let mean = 2.0 * known * unknown / (known + unknown);
    if known + unknown > 0.0 { mean } else { 0.0 }
}

/// Hits and false alarms as a function of the threshold, of one frame or of all frames that [`Curve::of`] joins. Frames are
/// matched one by one, so the curve of any choice of frames, also with repeats, follows from the curves of single frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Curve {
    /// Labels that count.
    pub(crate) truth_count: usize,
    /// Scores of the hits when every detection takes part; sorted from high to low over all frames.
    pub(crate) hit_scores: Vec<f64>,
    /// Of one frame: score, and the changes of hits and of false alarms at it. Over all frames: score, and the hits and false
    /// alarms at or above it, from high to low.
    pub(crate) steps: Vec<(f64, i64, i64)>,
}

impl Curve {
    /// Joins frames that were matched one by one; a frame given twice counts twice.
    pub(crate) fn of<'a>(frames: impl IntoIterator<Item = &'a Curve>) -> Curve {
        let mut curve = Curve::default();
        for frame in frames {
            curve.truth_count += frame.truth_count;
            curve.hit_scores.extend_from_slice(&frame.hit_scores);
            curve.steps.extend_from_slice(&frame.steps);
        }
        curve.hit_scores.sort_by(|a, b| b.total_cmp(a));
        curve.steps.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (mut hits, mut false_alarms) = (0, 0);
        for step in &mut curve.steps {
            hits += step.1;
            false_alarms += step.2;
            (step.1, step.2) = (hits, false_alarms);
        }
        // One entry per score: the last one includes all of its changes.
        curve.steps.dedup_by(|later, earlier| {
            let same = later.0 == earlier.0;
            if same {
                *earlier = *later;
            }
            same
        });
        curve
    }

    /// Share of the counting labels that are found when every detection takes part, percent; over all frames.
    pub(crate) fn recall_percent(&self) -> f64 {
        let hits = self.steps.last().map_or(0, |step| step.1);
        100.0 * hits as f64 / self.truth_count.max(1) as f64
    }

    /// Hits and false alarms when the detections at or above a score take part.
    pub(crate) fn counts_at(&self, score_min: f64) -> (i64, i64) {
        let count = self.steps.partition_point(|step| step.0 >= score_min);
        self.steps[..count].last().map_or((0, 0), |step| (step.1, step.2))
    }

    /// The lowest score at or above which there are at most `false_alarms_max` false alarms; `None` where even the highest score has more.
    pub(crate) fn score_at_false_alarms(&self, false_alarms_max: i64) -> Option<f64> {
        let within = |step: &&(f64, i64, i64)| step.2 <= false_alarms_max;
        self.steps.iter().rfind(within).map(|step| step.0)
    }

    /// Average precision; 0 without labels or detections.
    pub(crate) fn average_precision(&self) -> AveragePrecision {
        let precision = self.precision_at_positions();
        let r11: f64 = precision.iter().step_by(4).sum::<f64>() / 11.0;
        let r40: f64 = precision[1..].iter().sum::<f64>() / 40.0;
        AveragePrecision { r11: 100.0 * r11, r40: 100.0 * r40, all: 100.0 * self.area() }
    }

    /// The devkit's thresholds: the hit scores at which the recall is nearest to each position.
    fn thresholds(&self) -> Vec<f64> {
        let truths = self.truth_count as f64;
        let mut thresholds = Vec::with_capacity(POSITIONS);
        let mut wanted = 0.0;
        for (i, &score) in self.hit_scores.iter().enumerate() {
            let last = i + 1 == self.hit_scores.len();
            let here = (i + 1) as f64 / truths;
            let next = if last { here } else { (i + 2) as f64 / truths };
            if !last && next - wanted < wanted - here {
                continue;
            }
            thresholds.push(score);
            wanted += 1.0 / (POSITIONS as f64 - 1.0);
        }
        thresholds.truncate(POSITIONS);
        thresholds
    }

    /// Precision at the thresholds, 0 beyond them, made monotonic: each value is the maximum from there on.
    fn precision_at_positions(&self) -> [f64; POSITIONS] {
        let mut precision = [0.0; POSITIONS];
        for (value, threshold) in precision.iter_mut().zip(self.thresholds()) {
            *value = precision_of(self.counts_at(threshold));
        }
        for i in (0..POSITIONS - 1).rev() {
            precision[i] = f64::max(precision[i], precision[i + 1]);
        }
        precision
    }

    /// Area under the curve of precision over recall with every threshold, precision made monotonic.
    fn area(&self) -> f64 {
        let steps = self.steps.iter();
        let point = |&(_, hits, alarms)| (hits, precision_of((hits, alarms)));
        let mut points: Vec<(i64, f64)> = steps.map(point).collect();
        points.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let (mut area, mut best) = (0.0, 0.0f64);
        for i in (0..points.len()).rev() {
            best = best.max(points[i].1);
            let below = if i == 0 { 0 } else { points[i - 1].0 };
            area += best * (points[i].0 - below) as f64;
        }
        area / self.truth_count.max(1) as f64
    }
}

fn precision_of((hits, false_alarms): (i64, i64)) -> f64 {
    let precision = hits as f64 / (hits + false_alarms) as f64;
    if hits > 0 { precision } else { 0.0 }
}
