//! The outcome as JSON and as a table.

use mluc_evaluate::pipeline::{Choice, ModelGate, ModelJudgement, ScoreChoice};
use mluc_evaluate::{Breakdown, ClassReport, SweepPoint, render};
use mluc_model::Model;
use serde_json::{Value, json};

pub(super) struct Outcome {
    pub(super) model: Model,
    pub(super) data: String,
    pub(super) frames: usize,
    pub(super) judgement: ModelJudgement,
    /// The points of the sweep, closed set first.
    pub(super) sweep: Option<Vec<SweepPoint>>,
    pub(super) choice: Option<Choice>,
    pub(super) profiles: Option<ScoreChoice>,
}

fn point_json(point: &SweepPoint) -> Value {
    let mut object = json!(point);
    object["map_harm"] = json!(point.map_harm());
    object
}

impl Outcome {
    pub(super) fn to_json(&self) -> Value {
        let (model, judgement) = (&self.model.manifest, &self.judgement);
        let mut object = json!({
            "model": model.name,
            "fingerprint": format!("{:016x}", self.model.fingerprint),
            "steps": model.provenance.steps,
            "data": self.data,
            "frames": self.frames,
            "boxes_per_frame": judgement.boxes as f64 / self.frames.max(1) as f64,
            "threshold": judgement.threshold,
            "closed": judgement.closed.to_json(),
            "gated": judgement.gated.to_json(),
            "map_known_closed": judgement.closed.map_known().r40,
            "separation": judgement.separation,
            "unknown_labels": judgement.unknown_labels(),
            "unknown_as_known": judgement.unknown_as_known,
            "unknown_as_known_closed": judgement.unknown_as_known_closed,
        });
        for breakdown in &judgement.breakdowns {
            object[format!("by_{}", breakdown.by)] = breakdown.to_json();
        }
        if let Some(sweep) = &self.sweep {
            object["sweep"] = sweep.iter().map(point_json).collect();
            object["best"] = point_json(&sweep[ModelGate::of(&self.model).best_index(sweep)]);
        }
        if let Some(choice) = &self.choice {
            object["threshold_choice"] = json!(choice.reason);
        }
        if let Some(chosen) = &self.profiles {
            object["profiles"] = json!(chosen.profiles);
            object["calibration_errors"] = json!(chosen.errors);
        }
        object
    }

    pub(super) fn to_table(&self) -> String {
        let ModelJudgement { closed, gated, .. } = &self.judgement;
        let mut values = self.to_json();
        let classes = closed.classes.iter().zip(&gated.classes);
        let class = |(closed, gated): (&ClassReport, &ClassReport)| {
            let (rule, labels) = (&closed.rule, closed.main().truth_count);
            let figures = [figures(closed), figures(gated)].concat();
            json!([rule.name, rule.iou_min, labels, figures])
        };
        values["classes"] = classes.map(class).collect();
        let breakdowns = self.judgement.breakdowns.iter();
        values["breakdowns"] = breakdowns.map(Breakdown::to_table).collect();
        // How well each score of a box separates unknown from known, and from background.
        let scores = json!({"scores": values["separation"]});
        values["separation"] = render(include_str!("separation.txt"), scores).into();
        let choice = self.choice.as_ref();
        values["choice"] = json!(choice.map(|choice| (choice.threshold, &choice.reason)));
        let written = self.profiles.iter().flat_map(|chosen| chosen.profiles.named());
        values["written"] = written.map(|named| json!(named)).collect();
        if let Some(sweep) = &self.sweep {
            let best = ModelGate::of(&self.model).best_index(sweep);
            values["sweep"][best]["is_best"] = json!(true);
        }
        render(include_str!("report.txt"), values)
    }
}

fn figures(class: &ClassReport) -> [f64; 4] {
    let ap = class.main().ap;
    [ap.r40, ap.r11, ap.all, class.main().recall_percent]
}
