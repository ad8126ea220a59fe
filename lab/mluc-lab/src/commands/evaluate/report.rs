//! The outcome as JSON and as a table.

use mluc_evaluate::pipeline::{Choice, MissRow, MissTable, ModelJudgement};
use mluc_evaluate::{ClassReport, SweepPoint, best_index};
use mluc_model::Model;
use serde_json::{Value, json};
use std::fmt::Write as _;

/// Everything that was found out.
pub(super) struct Outcome {
    pub(super) model: Model,
    pub(super) data: String,
    pub(super) frames: usize,
    pub(super) judgement: ModelJudgement,
    /// The closed set first.
    pub(super) sweep: Option<Vec<SweepPoint>>,
    pub(super) choice: Option<Choice>,
}

fn point_json(point: &SweepPoint) -> Value {
    json!({
        "threshold": point.threshold, "map_known": point.map_known, "recall_unknown": point.recall_unknown,
        "ap_unknown": point.ap_unknown, "map_harm": point.map_harm(),
    })
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
            "boxes_per_frame": self.boxes_per_frame(),
            "threshold": judgement.threshold,
            "closed": judgement.closed.to_json(),
            "gated": judgement.gated.to_json(),
            "map_known_closed": self.judgement.closed.map_known().r40,
            "separation": judgement.separation,
            "unknown_labels": judgement.unknown_labels(),
            "unknown_as_known": judgement.unknown_as_known,
            "unknown_as_known_closed": judgement.unknown_as_known_closed,
            "labels_closed": judgement.misses,
        });
        if let Some(sweep) = &self.sweep {
            object["sweep"] = sweep.iter().map(point_json).collect();
            object["best"] = point_json(&sweep[best_index(sweep)]);
        }
        if let Some(choice) = &self.choice {
            object["threshold_choice"] = json!(choice.reason);
        }
        object
    }

    fn boxes_per_frame(&self) -> f64 {
        self.judgement.boxes as f64 / self.frames.max(1) as f64
    }

    pub(super) fn to_table(&self) -> String {
        let (model, judgement) = (&self.model.manifest, &self.judgement);
        let mut text = String::new();
        // Writing to a String does not fail.
        let _ = writeln!(
            text,
            "model {}, {} steps; {}; {:.1} boxes a frame\n",
            model.name,
            model.provenance.steps,
            self.data,
            self.boxes_per_frame()
        );
        self.write_classes(&mut text);
        self.write_separation(&mut text);
        write_misses(&mut text, &judgement.misses);
        self.write_sweep(&mut text);
        text
    }

    fn write_classes(&self, text: &mut String) {
        let judgement = &self.judgement;
        let _ = writeln!(
            text,
            "3d, moderate                  closed set, %                     at threshold {:.4}, %",
            judgement.threshold
        );
        let heads = format!("{:>7} {:>7} {:>7} {:>7}", "R40", "R11", "all", "recall");
        let _ = writeln!(
            text,
            "{:<12} {:>5} {:>7}  {heads}   {heads}",
            "class", "IoU >", "labels"
        );
        for (closed, gated) in judgement
            .closed
            .classes
            .iter()
            .zip(&judgement.gated.classes)
        {
            let labels = closed.main().truth_count;
            let _ = writeln!(
                text,
                "{:<12} {:>5.2} {labels:>7}  {}   {}",
                closed.rule.name,
                closed.rule.iou_min,
                figures(closed),
                figures(gated)
            );
        }
        let _ = writeln!(
            text,
            "mAP of the known, closed set, R40: {:.2}",
            self.judgement.closed.map_known().r40
        );
        if let Some(unknown) = judgement.gated.unknown() {
            let (known, unknown) = (judgement.gated.map_known(), unknown.main());
            let _ = writeln!(
                text,
                "at the threshold: mAP known {:.2}, recall unknown {:.2}, AP unknown {:.2}, harmonic mean {:.2}",
                known.r40,
                unknown.recall_percent,
                unknown.ap.r40,
                known.harmonic(unknown.ap).r40
            );
            let _ = writeln!(
                text,
                "unknown objects taken for known ones: {} of {} (closed set: {})",
                judgement.unknown_as_known,
                judgement.unknown_labels(),
                judgement.unknown_as_known_closed
            );
        }
    }

    fn write_separation(&self, text: &mut String) {
        let Some(first) = self.judgement.separation.first() else {
            return;
        };
        let _ = writeln!(
            text,
            "\nunknown from known and from background, on {} known, {} unknown and {} boxes that touch no label",
            first.known, first.unknown, first.background
        );
        let _ = writeln!(
            text,
            "{:<12} {:>7} {:>10} {:>19}",
            "score", "AUROC", "FPR at 95%", "AUROC of background"
        );
        let number =
            |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"));
        for s in &self.judgement.separation {
            let [auroc, fpr95, background] = [s.auroc, s.fpr95, s.auroc_background].map(number);
            let _ = writeln!(
                text,
                "{:<12} {auroc:>7} {fpr95:>10} {background:>19}",
                s.score
            );
        }
    }

    fn write_sweep(&self, text: &mut String) {
        let Some(sweep) = &self.sweep else {
            return;
        };
        let _ = writeln!(
            text,
            "\n{:>10}  {:>9}  {:>14}  {:>10}  {:>13}",
            "threshold", "mAP known", "recall unknown", "AP unknown", "harmonic mean"
        );
        let line = |text: &mut String, p: &SweepPoint, mark: &str| {
            let _ = writeln!(
                text,
                "{:>10.4}  {:>9.2}  {:>14.2}  {:>10.2}  {:>13.2}{mark}",
                p.threshold,
                p.map_known,
                p.recall_unknown,
                p.ap_unknown,
                p.map_harm()
            );
        };
        let best = best_index(sweep);
        for (at, point) in sweep.iter().enumerate() {
            line(text, point, if at == best { "  best" } else { "" });
        }
        if let Some(choice) = &self.choice {
            let _ = writeln!(
                text,
                "\nwritten: threshold {:.6}, {}",
                choice.threshold, choice.reason
            );
        }
    }
}

fn figures(class: &ClassReport) -> String {
    let entry = class.main();
    let ap = entry.ap;
    format!(
        "{:>7.2} {:>7.2} {:>7.2} {:>7.2}",
        ap.r40, ap.r11, ap.all, entry.recall_percent
    )
}

fn write_misses(text: &mut String, tables: &[MissTable]) {
    let _ = writeln!(
        text,
        "\nclosed set, labels at moderate: found (score 0.3 or more) / weak (less) / displaced / other class / missed"
    );
    let _ = writeln!(
        text,
        "{:<12} {:>24} {:>24} {:>24} {:>24}",
        "class", "below 15 m", "15 to 30 m", "30 to 45 m", "beyond"
    );
    let cell = |row: &MissRow| {
        let (a, b, c) = (row.found, row.weak, row.displaced);
        format!("{a} / {b} / {c} / {} / {}", row.other_class, row.missed)
    };
    for table in tables {
        let [a, b, c, d] = table.by_range.each_ref().map(cell);
        let _ = writeln!(text, "{:<12} {a:>24} {b:>24} {c:>24} {d:>24}", table.class);
    }
    let _ = writeln!(
        text,
        "\ndetections of score 0.3 or more: {:>6} {:>10} {:>12} {:>11}",
        "right", "displaced", "other class", "background"
    );
    for table in tables {
        let a = &table.alarms;
        let _ = writeln!(
            text,
            "{:<12} {:>18} {:>7} {:>10} {:>12} {:>11}",
            table.class, a.detections, a.right, a.displaced, a.other_class, a.background
        );
    }
}
