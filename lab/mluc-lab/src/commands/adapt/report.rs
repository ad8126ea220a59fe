//! What an adaptation brought, for a person.

use mluc_evaluate::ClassReport;
use mluc_evaluate::pipeline::ModelJudgement;
use mluc_model::Model;
use serde::{Deserialize, Serialize};

use super::plan::Plan;

/// What, labels that count, overlap, percent.
type Row = (String, usize, f64, f64);

/// Figures of a model on the validation scans: volumes, moderate, AP over all points.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Figures {
    /// Of the model file.
    pub(super) fingerprint: u64,
    rows: Vec<Row>,
}

impl Figures {
    /// Each known class without the gate; then the unknown at the model's threshold.
    pub(super) fn of(model: &Model, judgement: &ModelJudgement) -> Figures {
        let row = |name: &str, class: &ClassReport, percent: f64| {
            let (labels, iou_min) = (class.main().truth_count, class.rule.iou_min);
            (name.to_owned(), labels, iou_min, percent)
        };
        let known = judgement.closed.known();
        let mut rows: Vec<Row> = known
            .map(|c| row(&c.rule.name, c, c.main().ap.all))
            .collect();
        if let Some(class) = judgement.gated.unknown() {
            let main = class.main();
            rows.push(row("unknown, AP", class, main.ap.all));
            rows.push(row("unknown, recall", class, main.recall_percent));
        }
        Figures {
            fingerprint: model.fingerprint,
            rows,
        }
    }
}

/// The report: what was made of what, and the figures before and after.
pub(super) fn markdown(plan: &Plan, model: &Model, before: &Figures, after: &Figures) -> String {
    let (request, from) = (&plan.request, &model.manifest.provenance);
    let sensor = &request.sensor;
    let mut text = format!(
        "# Adapted to {}\n\n\
         | | |\n|---|---|\n\
         | sensor | {} beams, columns {} degrees apart |\n\
         | known | {} |\n\
         | trained on | {} simulated scans of this sensor, {} steps |\n\
         | judged on | {} other simulated scans of it |\n\
         | threshold | {} |\n\
         | int8 ranges | {} |\n\n\
         AP before and after on the same scans: volumes, moderate, all points, %. Known classes without the gate, the unknown at each model's\n\
         own threshold. `-`: not known before.\n\n\
         | | labels | overlap | before | after |\n|---|---|---|---|---|\n",
        sensor.name,
        sensor.elevations_deg.len() * sensor.units.len().max(1),
        sensor.azimuth_step_deg,
        request.known.join(", "),
        plan.scans,
        plan.steps,
        plan.val_scans,
        from.threshold_choice,
        from.calibration,
    );
    for (name, labels, iou, percent) in &after.rows {
        let first = before.rows.iter().find(|row| row.0 == *name);
        let first = first.map_or("-".to_owned(), |row| format!("{:.1}", row.3));
        text += &format!("| {name} | {labels} | {iou} | {first} | {percent:.1} |\n");
    }
    text + "\nSimulated scans say what the network learned, not what it does on yours: judge it there with `mluc-lab evaluate ap`. The folder\n\
            `scans` can be removed.\n\n\
            ```sh\nmluc up --input DIR --model model.safetensors\n```\n"
}
