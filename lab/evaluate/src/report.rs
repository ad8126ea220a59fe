//! Every class, metric and difficulty at once.

use crate::matching::match_frames;
use crate::{
    AveragePrecision, ClassRule, Confusion, Difficulty, LabelledFrame, Metric, ObjectKind,
};
use rayon::prelude::*;

/// Figures of one class at one metric and difficulty.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ApEntry {
    /// Average precision, percent.
    pub ap: AveragePrecision,
    /// Labels that count.
    pub truth_count: usize,
    /// Labels found when every detection takes part, percent.
    pub recall_percent: f64,
}

/// Figures of one class.
#[derive(Clone, Debug)]
pub struct ClassReport {
    /// How it was judged.
    pub rule: ClassRule,
    /// By metric, then difficulty, in their order.
    pub entries: [[ApEntry; 3]; 3],
}

impl ClassReport {
    /// The figures at one metric and difficulty.
    pub fn entry(&self, metric: Metric, difficulty: Difficulty) -> &ApEntry {
        &self.entries[metric as usize][difficulty as usize]
    }

    /// The figures of volumes at moderate.
    pub fn main(&self) -> &ApEntry {
        self.entry(Metric::Space, Difficulty::Moderate)
    }
}

/// Outcome of an evaluation.
#[derive(Clone, Debug)]
pub struct ApReport {
    /// In the order of the rules.
    pub classes: Vec<ClassReport>,
    /// What the unknown is confused with, where an unknown group was asked for.
    pub confusion: Option<Confusion>,
}

impl ApReport {
    /// The known classes.
    pub fn known(&self) -> impl Iterator<Item = &ClassReport> {
        let classes = self.classes.iter();
        classes.filter(|class| class.rule.kind == ObjectKind::Known)
    }

    /// Mean AP of the known classes that have labels: volumes, moderate.
    pub fn map_known(&self) -> AveragePrecision {
        let labelled = self.known().filter(|class| class.main().truth_count > 0);
        AveragePrecision::mean(&labelled.map(|class| class.main().ap).collect::<Vec<_>>())
    }

    /// The unknown, where such a group was asked for.
    pub fn unknown(&self) -> Option<&ClassReport> {
        let mut classes = self.classes.iter();
        classes.find(|class| class.rule.kind == ObjectKind::Unknown)
    }

    /// Names of the classes of which no label counts at moderate.
    pub fn without_labels(&self) -> impl Iterator<Item = &str> {
        let empty = self.classes.iter().filter(|c| c.main().truth_count == 0);
        empty.map(|class| class.rule.name.as_str())
    }
}

/// Judges the frames by each rule. The frames' order matters only where scores are equal.
pub fn evaluate(frames: &[LabelledFrame], rules: &[ClassRule]) -> ApReport {
    let entry = |rule: &ClassRule, metric, difficulty| {
        let curve = match_frames(frames, rule, metric, difficulty);
        ApEntry {
            ap: curve.average_precision(),
            truth_count: curve.truth_count,
            recall_percent: curve.recall_percent(),
        }
    };
    let classes = rules.par_iter().map(|rule| ClassReport {
        rule: rule.clone(),
        entries: Metric::ALL.map(|metric| Difficulty::ALL.map(|d| entry(rule, metric, d))),
    });
    let unknown = rules.iter().find(|rule| rule.kind == ObjectKind::Unknown);
    ApReport {
        classes: classes.collect(),
        confusion: unknown.map(|rule| Confusion::of(frames, rule)),
    }
}
