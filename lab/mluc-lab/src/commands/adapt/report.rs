//! The report of an adaptation, for a person.

use super::plan::Plan;
use mluc_evaluate::{ClassReport, pipeline::ModelJudgement, render};
use mluc_model::Model;
use serde::{Deserialize, Serialize};
use serde_json::json;

/// Name, labels that count, overlap, percent.
type Row = (String, usize, f64, f64);

/// Figures of a model on the validation scans: 3D boxes, moderate, AP over all points.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Figures {
    /// Fingerprint of the model file.
    pub(super) fingerprint: u64,
    rows: Vec<Row>,
}

impl Figures {
    /// Each known class without the gate, then the unknown at the model's threshold.
    pub(super) fn of(model: &Model, judgement: &ModelJudgement) -> Figures {
        let row = |name: &str, class: &ClassReport, percent: f64| {
            let (labels, iou_min) = (class.main().truth_count, class.rule.iou_min);
            (name.to_owned(), labels, iou_min, percent)
        };
        let known = judgement.closed.known().map(|c| row(&c.rule.name, c, c.main().ap.all));
        let mut rows: Vec<Row> = known.collect();
        if let Some(class) = judgement.gated.unknown() {
            let main = class.main();
            rows.push(row("unknown, AP", class, main.ap.all));
            rows.push(row("unknown, recall", class, main.recall_percent));
        }
        Figures { fingerprint: model.fingerprint, rows }
    }
}

/// The report: the inputs and the result, and the figures before and after.
pub(super) fn markdown(
    plan: &Plan,
    model: &Model,
    [before, after]: [&Figures; 2],
    command: &str,
) -> String {
    let sensor = &plan.request.sensor;
    let values = json!({
        "plan": plan, "command": command, "from": model.manifest.provenance, "thresholds": model.manifest.thresholds, "before": before, "after": after,
        "beams": sensor.elevations_deg.len() * sensor.units.len().max(1),
        "step_deg": sensor.azimuth_step_deg.to_string(),
    });
    render(include_str!("report.md"), values) + "\n"
}
