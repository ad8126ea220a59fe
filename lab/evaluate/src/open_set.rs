//! The open-set figures of any choice of frames (paper, section 4.1): mAP of the known, AP and recall of the unknown,
//! their harmonic mean, and the number of unknown objects detected as known ones (absolute open-set error; Dhamija et al., WACV 2020).

use crate::{AveragePrecision, ClassRule, Difficulty, LabelledFrame, Metric, ObjectKind};
use crate::{UNKNOWN_IOUS, curve::Curve, frame::score_of, matching::match_frame};
use mluc_dataset::Label;
use mluc_geometry::{Random, iou_3d, mean_and_spread, mix, resample};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Average precision of a known class (3D boxes, moderate).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClassPrecision {
    /// The class.
    pub class: String,
    /// Required overlap.
    pub iou_min: f64,
    /// Labels that count.
    pub labels: usize,
    /// Percent.
    pub ap: AveragePrecision,
}

/// Open-set figures in percent (3D boxes, moderate).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OpenSetFigures {
    /// Mean AP of the known classes that have labels.
    pub known: AveragePrecision,
    /// AP of the unknown at overlaps of 0.1 (the paper's), 0.25 and 0.5.
    pub unknown: [AveragePrecision; 3],
    /// Share of unknown labels found by any unknown detection, at the first overlap.
    pub recall_unknown: f64,
    /// Unknown labels that count.
    pub unknown_labels: usize,
    /// Number of unknown labels that a known detection overlaps (absolute open-set error).
    pub unknown_as_known: usize,
    /// AP of each known class.
    pub classes: Vec<ClassPrecision>,
}

impl OpenSetFigures {
    /// Harmonic mean of known and unknown, separately for each way of averaging.
    pub fn harmonic(&self) -> AveragePrecision {
        self.known.harmonic(self.unknown[0])
    }

    /// Every figure with its name in `report.json`; at 40 positions where the name does not say otherwise.
    pub fn named(&self) -> Vec<(String, f64)> {
        let [tenth, quarter, half] = self.unknown;
        let averaged = [
            ("map_known", self.known),
            ("ap_unknown", tenth),
            ("map_harm", self.harmonic()),
            ("ap_unknown_iou25", quarter),
            ("ap_unknown_iou50", half),
        ];
        let three_ways = averaged.iter().flat_map(|(name, ap)| {
            let ways = [("", ap.r40), ("_r11", ap.r11), ("_all", ap.all)];
            ways.map(|(way, value)| (format!("{name}{way}"), value))
        });
        let counted = [
            ("recall_unknown", self.recall_unknown),
            ("a_ose", self.unknown_as_known as f64),
            ("unknown_labels", self.unknown_labels as f64),
        ];
        let counted = counted.map(|(name, value)| (name.to_owned(), value));
        three_ways.chain(counted).collect()
    }
}

/// The contribution of one frame to every figure.
#[derive(Clone, Debug, Default)]
struct FrameParts {
    known: Vec<Curve>,
    unknown: Vec<Curve>,
    unknown_as_known: usize,
}

/// Frames matched one by one.
#[derive(Clone, Debug)]
pub struct JudgedFrames {
    known_rules: Vec<ClassRule>,
    frames: Vec<FrameParts>,
}

impl JudgedFrames {
    /// Matches every frame by every rule; the unknown rule uses overlaps of 0.1, 0.25 and 0.5 in place of its own.
    pub fn of(frames: &[LabelledFrame], rules: &[ClassRule]) -> JudgedFrames {
        let of_kind = |kind| rules.iter().filter(move |rule| rule.kind == kind);
        let known_rules: Vec<ClassRule> = of_kind(ObjectKind::Known).cloned().collect();
        let unknown = of_kind(ObjectKind::Unknown).take(1);
        let at_each_overlap =
            |rule: &ClassRule| UNKNOWN_IOUS.map(|iou_min| ClassRule { iou_min, ..rule.clone() });
        let unknown_rules: Vec<ClassRule> = unknown.flat_map(at_each_overlap).collect();
        let matched = |frame: &LabelledFrame, rules: &[ClassRule]| {
            let one = |rule| match_frame(frame, rule, Metric::Space, Difficulty::Moderate, None);
            rules.iter().map(one).collect()
        };
        let judged = frames.par_iter().map(|frame| FrameParts {
            known: matched(frame, &known_rules),
            unknown: matched(frame, &unknown_rules),
            unknown_as_known: unknown_as_known(std::slice::from_ref(frame), &unknown_rules),
        });
        JudgedFrames { frames: judged.collect(), known_rules }
    }

    /// Figures of all frames.
    pub fn all(&self) -> OpenSetFigures {
        let indices: Vec<usize> = (0..self.frames.len()).collect();
        self.figures(&indices)
    }

    /// Every named figure of all frames, with its standard deviation over resampled frames (bootstrap). It estimates the change with
    /// another test set of the same size. The boxes of one frame stay together, since their errors are correlated.
    /// The same seed gives the same bits, with any number of threads; with fewer than two resamples or frames the deviation is 0.
    pub fn bootstrap(&self, resamples: usize, seed: u64) -> BTreeMap<String, [f64; 2]> {
        let figures = |draw| {
            let mut random = Random::from_state(mix(seed ^ mix(draw as u64)));
            let indices = resample(self.frames.len(), 1, &mut random);
            self.figures(&indices).named()
        };
        let draws: Vec<_> = (0..resamples).into_par_iter().map(figures).collect();
        let named = self.all().named().into_iter().enumerate();
        let with_spread = named.map(|(at, (name, value))| {
            let values: Vec<f64> = draws.iter().map(|draw| draw[at].1).collect();
            (name, [value, mean_and_spread(&values)[1]])
        });
        with_spread.collect()
    }

    /// The lowest score of an unknown detection at or above which there is at most one false alarm per frame, at the first overlap: a fair
    /// score limit for pictures, since every method gets the same number of false alarms. `None` where there is no such score.
    pub fn unknown_score_min(&self) -> Option<f64> {
        let parts = self.frames.iter().filter_map(|frame| frame.unknown.first());
        Curve::of(parts).score_at_false_alarms(self.frames.len() as i64)
    }

    /// Figures of the frames with these indices; indices out of range are skipped, and a repeated index counts twice.
    pub(crate) fn figures(&self, indices: &[usize]) -> OpenSetFigures {
        let frames: Vec<&FrameParts> = indices.iter().filter_map(|i| self.frames.get(*i)).collect();
        let rules = self.known_rules.iter().enumerate();
        let classes: Vec<ClassPrecision> = rules
            .map(|(at, rule)| {
                let curve = Curve::of(frames.iter().map(|frame| &frame.known[at]));
                ClassPrecision {
                    class: rule.name.clone(),
                    iou_min: rule.iou_min,
                    labels: curve.truth_count,
                    ap: curve.average_precision(),
                }
            })
            .collect();
        let labelled = classes.iter().filter(|class| class.labels > 0);
        let labelled: Vec<AveragePrecision> = labelled.map(|class| class.ap).collect();
        let of_overlap = |at| Curve::of(frames.iter().filter_map(|frame| frame.unknown.get(at)));
        let unknown: [Curve; 3] = [0, 1, 2].map(of_overlap);
        OpenSetFigures {
            known: AveragePrecision::mean(&labelled),
            unknown: unknown.each_ref().map(Curve::average_precision),
            recall_unknown: unknown[0].recall_percent(),
            unknown_labels: unknown[0].truth_count,
            unknown_as_known: frames.iter().map(|frame| frame.unknown_as_known).sum(),
            classes,
        }
    }
}

/// Number of unknown labels that count at moderate and that a detection of kind known overlaps by more than the unknown rule
/// requires. Labels are processed in file order and take the highest score; a detection matches one label. 0 without an unknown rule.
pub(crate) fn unknown_as_known(frames: &[LabelledFrame], rules: &[ClassRule]) -> usize {
    let Some(rule) = rules.iter().find(|rule| rule.kind == ObjectKind::Unknown) else {
        return 0;
    };
    let is_known = |d: &&Label| !rule.claims(d);
    let mut count = 0;
    for frame in frames {
        let mut known: Vec<&Label> = frame.detections.iter().filter(is_known).collect();
        known.sort_by(|a, b| score_of(b).total_cmp(&score_of(a)));
        let labels = frame.labels.iter();
        for label in labels.filter(|label| rule.counts_at(label, Difficulty::Moderate)) {
            let upright = label.camera_box.upright();
            let overlaps = |d: &&Label| iou_3d(&d.camera_box.upright(), &upright) > rule.iou_min;
            if let Some(index) = known.iter().position(overlaps) {
                known.remove(index);
                count += 1;
            }
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::UnknownProtocol;
    use crate::tests::{found_at, frame, label};

    #[test]
    fn a_known_detection_counts_once_and_an_unknown_one_does_not() {
        let labels = [("Van", 10.0), ("Van", 10.5), ("Van", 30.0), ("Car", 50.0)];
        let labels = labels.map(|(class, x_m)| label(class, x_m));
        let found = [(10.2, "car"), (30.0, "unknown"), (50.0, "car")];
        let found = found.map(|(x_m, class)| found_at(x_m, class, 0.5));
        let frame = frame(labels.into(), found.into());
        let rule = ClassRule::unknown(&["van".to_owned()], 0.1, UnknownProtocol::Literal);
        assert_eq!(unknown_as_known(std::slice::from_ref(&frame), &[rule]), 1);
        assert_eq!(unknown_as_known(&[frame], &[]), 0);
    }
}
