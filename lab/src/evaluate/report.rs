//! Every class, metric and difficulty at once.

use super::{
    AveragePrecision, ClassRule, Confusion, Difficulty, Frame, Kind, Metric, Summary, match_frames,
};
use rayon::prelude::*;

/// Figures of one class at one metric and difficulty.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Entry {
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
    pub entries: [[Entry; 3]; 3],
}

impl ClassReport {
    /// The figures at one metric and difficulty.
    pub fn entry(&self, metric: Metric, difficulty: Difficulty) -> &Entry {
        &self.entries[metric as usize][difficulty as usize]
    }
}

/// Outcome of an evaluation.
#[derive(Clone, Debug)]
pub struct Report {
    /// In the order of the rules.
    pub classes: Vec<ClassReport>,
    /// Open-set figures, where an unknown group was asked for.
    pub summary: Option<Summary>,
    /// What the unknown is confused with, where an unknown group was asked for.
    pub confusion: Option<Confusion>,
}

impl Report {
    /// Names of the classes of which no label counts at moderate.
    pub fn without_labels(&self) -> impl Iterator<Item = &str> {
        let empty = |class: &&ClassReport| {
            class.entry(Metric::Space, Difficulty::Moderate).truth_count == 0
        };
        self.classes
            .iter()
            .filter(empty)
            .map(|class| class.rule.name.as_str())
    }
}

/// Judges the frames by each rule. The frames' order matters only where scores are equal.
pub fn evaluate(frames: &[Frame], rules: &[ClassRule]) -> Report {
    let classes = rules.par_iter().map(|rule| ClassReport {
        rule: rule.clone(),
        entries: entries(frames, rule),
    });
    let unknown = rules.iter().find(|rule| rule.kind == Kind::Unknown);
    let mut report = Report {
        classes: classes.collect(),
        summary: None,
        confusion: unknown.map(|rule| Confusion::of(frames, rule)),
    };
    report.summary = Summary::of(&report);
    report
}

fn entries(frames: &[Frame], rule: &ClassRule) -> [[Entry; 3]; 3] {
    Metric::ALL
        .map(|metric| Difficulty::ALL.map(|difficulty| entry(frames, rule, metric, difficulty)))
}

/// The figures of one class at one metric and difficulty.
pub(crate) fn entry(
    frames: &[Frame],
    rule: &ClassRule,
    metric: Metric,
    difficulty: Difficulty,
) -> Entry {
    let curve = match_frames(frames, rule, metric, difficulty);
    let (truth_count, recall_percent) = (curve.truth_count, curve.recall_percent());
    Entry {
        ap: curve.average_precision(),
        truth_count,
        recall_percent,
    }
}
