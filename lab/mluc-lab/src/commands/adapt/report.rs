//! What an adaptation brought, for a person.

use std::collections::BTreeMap;

use mluc_evaluate::pipeline::ModelJudgement;
use mluc_model::Model;
use serde::{Deserialize, Serialize};

use super::plan::Plan;

/// Figures of a model on the validation scans, percent: volumes, moderate, AP over all points.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Figures {
    /// Of the model file.
    pub(super) fingerprint: u64,
    /// By class: labels that count, overlap, AP without the gate.
    classes: BTreeMap<String, (usize, f64, f64)>,
    /// At the model's threshold.
    map_known: f64,
    ap_unknown: f64,
    recall_unknown: f64,
    unknown_labels: usize,
}

impl Figures {
    pub(super) fn of(model: &Model, judgement: &ModelJudgement) -> Figures {
        let class = |c: &mluc_evaluate::ClassReport| {
            let main = c.main();
            (
                c.rule.name.clone(),
                (main.truth_count, c.rule.iou_min, main.ap.all),
            )
        };
        let unknown = judgement
            .gated
            .unknown()
            .map(|c| *c.main())
            .unwrap_or_default();
        Figures {
            fingerprint: model.fingerprint,
            classes: judgement.closed.known().map(class).collect(),
            map_known: judgement.gated.map_known().all,
            ap_unknown: unknown.ap.all,
            recall_unknown: unknown.recall_percent,
            unknown_labels: unknown.truth_count,
        }
    }
}

/// The report: what was made of what, and the figures before and after.
pub(super) fn markdown(plan: &Plan, model: &Model, before: &Figures, after: &Figures) -> String {
    let request = &plan.request;
    let sensor = &request.sensor;
    let mut text = format!(
        "# Adapted to {}\n\n\
         | | |\n|---|---|\n\
         | sensor | {} beams, columns {} degrees apart |\n\
         | known | {} |\n\
         | trained on | {} simulated scans of this sensor, {} steps of 4 |\n\
         | judged on | {} other simulated scans of it |\n\
         | threshold | {} |\n\
         | int8 ranges | {} |\n\n\
         AP before and after on the same scans: volumes, moderate, all points, %. The classes without the gate, `mAP known` and the unknown at\n\
         each model's own threshold. `-`: not known before.\n\n\
         | | labels | overlap | before | after |\n|---|---|---|---|---|\n",
        sensor.name,
        sensor.elevations_deg.len() * sensor.units.len().max(1),
        sensor.azimuth_step_deg,
        request.known.join(", "),
        plan.scans,
        plan.steps,
        plan.val_scans,
        model.manifest.provenance.threshold_choice,
        model.manifest.provenance.calibration,
    );
    for (class, (labels, iou, ap)) in &after.classes {
        let first = before.classes.get(class);
        let first = first.map_or("-".to_owned(), |(.., ap)| format!("{ap:.1}"));
        text += &format!("| {class} | {labels} | {iou} | {first} | {ap:.1} |\n");
    }
    let rows = [
        ("mAP known", "", before.map_known, after.map_known),
        ("AP unknown", "0.1", before.ap_unknown, after.ap_unknown),
        (
            "recall of unknown",
            "0.1",
            before.recall_unknown,
            after.recall_unknown,
        ),
    ];
    for (name, iou, before, after_value) in rows {
        let labels = if iou.is_empty() {
            String::new()
        } else {
            after.unknown_labels.to_string()
        };
        text += &format!("| {name} | {labels} | {iou} | {before:.1} | {after_value:.1} |\n");
    }
    text + "\nSimulated scans say what the network learned, not what it does on yours: judge it there with `mluc-lab evaluate ap`. The folder\n\
            `scans` can be removed.\n\n\
            ```sh\nmluc up --input DIR --model model.safetensors\n```\n"
}
