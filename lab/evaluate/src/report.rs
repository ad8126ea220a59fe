//! Figures for every class, metric and difficulty: as JSON for programs, as a table for people.

use crate::{AveragePrecision, ClassRule, Difficulty, LabelledFrame, Metric, ObjectKind};
use crate::{curve::Curve, matching::match_frame};
use minijinja::{Environment, value::Serde};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value, json};

/// Figures of one class at one metric and difficulty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ApEntry {
    /// Average precision, percent.
    pub ap: AveragePrecision,
    /// Labels that count.
    pub truth_count: usize,
    /// Share of labels found when every detection takes part, percent.
    pub recall_percent: f64,
}

impl ApEntry {
    pub(crate) fn of(curve: &Curve) -> ApEntry {
        ApEntry {
            ap: curve.average_precision(),
            truth_count: curve.truth_count,
            recall_percent: curve.recall_percent(),
        }
    }
}

/// Figures of one class.
#[derive(Clone, Debug)]
pub struct ClassReport {
    /// The rule of the class.
    pub rule: ClassRule,
    /// Figures by metric, then by difficulty, in their order.
    pub entries: [[ApEntry; 3]; 3],
}

impl ClassReport {
    /// The figures of 3D boxes at moderate.
    pub fn main(&self) -> &ApEntry {
        &self.entries[Metric::Space as usize][Difficulty::Moderate as usize]
    }
}

/// Outcome of an evaluation.
#[derive(Clone, Debug)]
pub struct ApReport {
    /// The reports in the order of the rules.
    pub classes: Vec<ClassReport>,
}

impl ApReport {
    /// The known classes.
    pub fn known(&self) -> impl Iterator<Item = &ClassReport> {
        self.classes.iter().filter(|class| class.rule.kind == ObjectKind::Known)
    }

    /// Mean AP of the known classes that have labels (3D boxes, moderate).
    pub fn map_known(&self) -> AveragePrecision {
        let labelled = self.known().filter(|class| class.main().truth_count > 0);
        AveragePrecision::mean(&labelled.map(|class| class.main().ap).collect::<Vec<_>>())
    }

    /// The unknown class, where an unknown group was requested.
    pub fn unknown(&self) -> Option<&ClassReport> {
        self.classes.iter().find(|class| class.rule.kind == ObjectKind::Unknown)
    }

    /// `{"car/3d/moderate": {"ap_r11": .., "ap_r40": .., "ap_all": ..}, ..}`, with the open-set figures at the top level where there are any, in percent.
    pub fn to_json(&self) -> Value {
        let mut object = Map::new();
        for class in &self.classes {
            for (metric, entries) in Metric::ALL.iter().zip(&class.entries) {
                for (difficulty, entry) in Difficulty::ALL.iter().zip(entries) {
                    let AveragePrecision { r11, r40, all } = entry.ap;
                    let figures = json!({"ap_r11": r11, "ap_r40": r40, "ap_all": all});
                    let (class, metric) = (&class.rule.name, metric.name());
                    object.insert(format!("{class}/{metric}/{}", difficulty.name()), figures);
                }
            }
        }
        for (name, known, recall, unknown, harm) in self.open_set() {
            // Recall has no recall positions: both keys have the same number.
            let end = if name == "R40" { "" } else { "_all" };
            object.insert(format!("map_known{end}"), json!(known));
            object.insert(format!("recall_unknown{end}"), json!(recall));
            object.insert(format!("ap_unknown{end}"), json!(unknown));
            object.insert(format!("map_harm{end}"), json!(harm));
        }
        Value::Object(object)
    }

    /// At 40 positions and over all points, with an unknown group: mAP of the known, recall and AP of the unknown, and the harmonic mean.
    fn open_set(&self) -> Vec<(&'static str, f64, f64, f64, f64)> {
        let Some(unknown) = self.unknown().map(ClassReport::main) else {
            return Vec::new();
        };
        let known = self.map_known();
        let (harm, recall) = (known.harmonic(unknown.ap), unknown.recall_percent);
        vec![
            ("R40", known.r40, recall, unknown.ap.r40, harm.r40),
            ("all points", known.all, recall, unknown.ap.all, harm.all),
        ]
    }

    /// The same as a text table, with easy / moderate / hard in one row.
    pub fn to_table(&self) -> String {
        let classes = self.classes.iter();
        let classes = classes.map(|class| (&class.rule.name, class.rule.iou_min, class.entries));
        let values = json!({
            "names": Metric::ALL.map(Metric::name),
            "classes": classes.collect::<Vec<_>>(),
            "open_set": self.open_set(),
        });
        render(include_str!("report.txt"), values)
    }
}

/// Evaluates the frames by each rule. The frames' order matters only where scores are equal.
pub fn evaluate(frames: &[LabelledFrame], rules: &[ClassRule]) -> ApReport {
    let entry = |rule: &ClassRule, metric, difficulty| {
        let matched = |frame| match_frame(frame, rule, metric, difficulty, None);
        ApEntry::of(&Curve::of(&frames.iter().map(matched).collect::<Vec<_>>()))
    };
    let classes = rules.par_iter().map(|rule| ClassReport {
        rule: rule.clone(),
        entries: Metric::ALL.map(|metric| Difficulty::ALL.map(|d| entry(rule, metric, d))),
    });
    ApReport { classes: classes.collect() }
}

/// Renders a built-in template with its values.
pub fn render(template: &str, values: Value) -> String {
    Environment::new().render_str(template, Serde(values)).expect("a template that fits its values")
}
