//! The open-set figures of any choice of frames (paper, section 4.1): mAP of the known, AP and recall of the unknown,
//! their harmonic mean, and how many unknown objects were taken for known ones.

use super::open_set_error::in_frame;
use super::{
    AveragePrecision, ClassRule, Curve, Difficulty, Frame, FrameCurve, Kind, Metric, harmonic_mean,
    match_frame,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Overlaps at which the unknown are judged: the paper's 0.1 first, two more that show how well the boxes fit.
pub const UNKNOWN_IOUS: [f64; 3] = [0.1, 0.25, 0.5];

/// Average precision of a known class: volumes, moderate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClassPrecision {
    /// The class.
    pub class: String,
    /// Overlap asked for.
    pub iou_min: f64,
    /// Labels that count.
    pub labels: usize,
    /// Percent.
    pub ap: AveragePrecision,
}

/// Open-set figures in percent: volumes, moderate.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OpenSetFigures {
    /// Mean AP of the known classes that have labels.
    pub known: AveragePrecision,
    /// AP of the unknown at each of [`UNKNOWN_IOUS`].
    pub unknown: [AveragePrecision; 3],
    /// Unknown labels found by any unknown detection, at the first overlap.
    pub recall_unknown: f64,
    /// Unknown labels that count.
    pub unknown_labels: usize,
    /// Unknown labels that a known detection lies on (absolute open-set error).
    pub unknown_as_known: usize,
    /// Each known class.
    pub classes: Vec<ClassPrecision>,
}

impl OpenSetFigures {
    /// Harmonic mean of known and unknown, each way of averaging by itself.
    pub fn harmonic(&self) -> AveragePrecision {
        let (known, unknown) = (self.known, self.unknown[0]);
        AveragePrecision {
            r11: harmonic_mean(known.r11, unknown.r11),
            r40: harmonic_mean(known.r40, unknown.r40),
            all: harmonic_mean(known.all, unknown.all),
        }
    }

    /// Every figure by the name that it has in `report.json`; 40 positions where the name says nothing else.
    pub fn named(&self) -> [(&'static str, f64); 18] {
        let harm = self.harmonic();
        let [tenth, quarter, half] = self.unknown;
        [
            ("map_known", self.known.r40),
            ("ap_unknown", tenth.r40),
            ("map_harm", harm.r40),
            ("recall_unknown", self.recall_unknown),
            ("map_known_r11", self.known.r11),
            ("ap_unknown_r11", tenth.r11),
            ("map_harm_r11", harm.r11),
            ("map_known_all", self.known.all),
            ("ap_unknown_all", tenth.all),
            ("map_harm_all", harm.all),
            ("ap_unknown_iou25", quarter.r40),
            ("ap_unknown_iou25_r11", quarter.r11),
            ("ap_unknown_iou25_all", quarter.all),
            ("ap_unknown_iou50", half.r40),
            ("ap_unknown_iou50_r11", half.r11),
            ("ap_unknown_iou50_all", half.all),
            ("a_ose", self.unknown_as_known as f64),
            ("unknown_labels", self.unknown_labels as f64),
        ]
    }
}

/// One frame's part of every figure.
#[derive(Clone, Debug, Default)]
struct JudgedFrame {
    known: Vec<FrameCurve>,
    unknown: Vec<FrameCurve>,
    unknown_as_known: usize,
}

/// Frames matched one by one.
#[derive(Clone, Debug)]
pub struct JudgedFrames {
    known_rules: Vec<ClassRule>,
    frames: Vec<JudgedFrame>,
}

impl JudgedFrames {
    /// Matches every frame by every rule; the unknown rule at each of [`UNKNOWN_IOUS`] in place of its own overlap.
    pub fn of(frames: &[Frame], rules: &[ClassRule]) -> JudgedFrames {
        let of_kind = |kind| rules.iter().filter(move |rule| rule.kind == kind);
        let known_rules: Vec<ClassRule> = of_kind(Kind::Known).cloned().collect();
        let unknown_rules: Vec<ClassRule> = of_kind(Kind::Unknown)
            .take(1)
            .flat_map(|rule| {
                UNKNOWN_IOUS.map(|iou_min| ClassRule {
                    iou_min,
                    ..rule.clone()
                })
            })
            .collect();
        let matched = |frame: &Frame, rules: &[ClassRule]| {
            let one =
                |rule: &ClassRule| match_frame(frame, rule, Metric::Space, Difficulty::Moderate);
            rules.iter().map(one).collect()
        };
        let judged = frames.par_iter().map(|frame| JudgedFrame {
            known: matched(frame, &known_rules),
            unknown: matched(frame, &unknown_rules),
            unknown_as_known: unknown_rules
                .first()
                .map_or(0, |rule| in_frame(frame, rule)),
        });
        JudgedFrames {
            frames: judged.collect(),
            known_rules,
        }
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Figures of all frames.
    pub fn all(&self) -> OpenSetFigures {
        let indices: Vec<usize> = (0..self.len()).collect();
        self.figures(&indices)
    }

    /// The lowest score of an unknown detection at or above which there is at most one false alarm a frame, at the first overlap: a
    /// fair place to cut for pictures, since every method is granted the same number of false alarms. `None` without such.
    pub fn unknown_score_min(&self) -> Option<f64> {
        let parts = self.frames.iter().filter_map(|frame| frame.unknown.first());
        Curve::of(parts).score_at_false_alarms(self.len() as i64)
    }

    /// Figures of the frames of these indices (each below [`JudgedFrames::len`], others are passed over); one named twice
    /// counts twice.
    pub fn figures(&self, indices: &[usize]) -> OpenSetFigures {
        let frames: Vec<&JudgedFrame> =
            indices.iter().filter_map(|i| self.frames.get(*i)).collect();
        let classes: Vec<ClassPrecision> = self
            .known_rules
            .iter()
            .enumerate()
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
        let mut figures = OpenSetFigures {
            known: mean(&classes),
            classes,
            unknown_as_known: frames.iter().map(|frame| frame.unknown_as_known).sum(),
            ..OpenSetFigures::default()
        };
        if frames.iter().all(|frame| frame.unknown.is_empty()) {
            return figures;
        }
        for (at, ap) in figures.unknown.iter_mut().enumerate() {
            let curve = Curve::of(frames.iter().map(|frame| &frame.unknown[at]));
            *ap = curve.average_precision();
            if at == 0 {
                figures.recall_unknown = curve.recall_percent();
                figures.unknown_labels = curve.truth_count;
            }
        }
        figures
    }
}

/// Over the classes that have labels.
fn mean(classes: &[ClassPrecision]) -> AveragePrecision {
    let labelled: Vec<AveragePrecision> = classes
        .iter()
        .filter(|class| class.labels > 0)
        .map(|class| class.ap)
        .collect();
    let mean = |of: fn(&AveragePrecision) -> f64| {
        labelled.iter().map(of).sum::<f64>() / labelled.len().max(1) as f64
    };
    AveragePrecision {
        r11: mean(|ap| ap.r11),
        r40: mean(|ap| ap.r40),
        all: mean(|ap| ap.all),
    }
}
