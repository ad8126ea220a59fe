//! The outcome as JSON and as a table.

use mluc_evaluate::pipeline::{Choice, ModelJudgement, ScoreSeparation};
use mluc_evaluate::{ClassReport, SweepPoint, best_index};
use mluc_model::{Model, Profiles};
use serde_json::{Value, json};

pub(super) struct Outcome {
    pub(super) model: Model,
    pub(super) data: String,
    pub(super) frames: usize,
    pub(super) judgement: ModelJudgement,
    /// The closed set first.
    pub(super) sweep: Option<Vec<SweepPoint>>,
    pub(super) choice: Option<Choice>,
    pub(super) profiles: Option<Profiles>,
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
            object["best"] = point_json(&sweep[best_index(sweep)]);
        }
        if let Some(choice) = &self.choice {
            object["threshold_choice"] = json!(choice.reason);
        }
        if let Some(profiles) = &self.profiles {
            object["profiles"] = json!(profiles);
        }
        object
    }

    fn boxes_per_frame(&self) -> f64 {
        self.judgement.boxes as f64 / self.frames.max(1) as f64
    }

    pub(super) fn to_table(&self) -> String {
        let model = &self.model.manifest;
        let (steps, boxes) = (model.provenance.steps, self.boxes_per_frame());
        let mut text = format!(
            "model {}, {steps} steps; {}; {boxes:.1} boxes a frame\n\n",
            model.name, self.data
        );
        text += &self.classes();
        for breakdown in &self.judgement.breakdowns {
            text += &format!("\nat the threshold: {}", breakdown.to_table());
        }
        text += &separation(&self.judgement.separation);
        text += &self.thresholds();
        for (name, least) in self.profiles.iter().flat_map(Profiles::named) {
            let (unknown, known) = (least.unknown, least.known);
            text += &format!(
                "\nwritten: profile {name}, unknown from {unknown:.4}, known from {known:.4}"
            );
        }
        text
    }

    fn classes(&self) -> String {
        let ModelJudgement { closed, gated, .. } = &self.judgement;
        let mut text = format!(
            "3d, moderate                  closed set, %                     at threshold {:.4}, %\n",
            self.judgement.threshold
        );
        let heads = format!("{:>7} {:>7} {:>7} {:>7}", "R40", "R11", "all", "recall");
        text += &format!(
            "{:<12} {:>5} {:>7}  {heads}   {heads}\n",
            "class", "IoU >", "labels"
        );
        for (closed, gated) in closed.classes.iter().zip(&gated.classes) {
            let (rule, labels) = (&closed.rule, closed.main().truth_count);
            let figures = [closed, gated].map(figures).join("   ");
            text += &format!(
                "{:<12} {:>5.2} {labels:>7}  {figures}\n",
                rule.name, rule.iou_min
            );
        }
        let known = closed.map_known().r40;
        text += &format!("mAP of the known, closed set, R40: {known:.2}\n");
        if let Some(unknown) = gated.unknown() {
            let (known, unknown) = (gated.map_known(), unknown.main());
            text += &format!(
                "at the threshold: mAP known {:.2}, recall unknown {:.2}, AP unknown {:.2}, harmonic mean {:.2}\n",
                known.r40,
                unknown.recall_percent,
                unknown.ap.r40,
                known.harmonic(unknown.ap).r40
            );
            text += &format!(
                "unknown objects taken for known ones: {} of {} (closed set: {})\n",
                self.judgement.unknown_as_known,
                self.judgement.unknown_labels(),
                self.judgement.unknown_as_known_closed
            );
        }
        text
    }

    fn thresholds(&self) -> String {
        let Some(sweep) = &self.sweep else {
            return String::new();
        };
        let mut text = format!(
            "\n{:>10}  {:>9}  {:>14}  {:>10}  {:>13}\n",
            "threshold", "mAP known", "recall unknown", "AP unknown", "harmonic mean"
        );
        let best = best_index(sweep);
        for (at, point) in sweep.iter().enumerate() {
            text += &format!(
                "{:>10.4}  {:>9.2}  {:>14.2}  {:>10.2}  {:>13.2}{}\n",
                point.threshold,
                point.map_known,
                point.recall_unknown,
                point.ap_unknown,
                point.map_harm(),
                if at == best { "  best" } else { "" }
            );
        }
        if let Some(choice) = &self.choice {
            let (threshold, reason) = (choice.threshold, &choice.reason);
            text += &format!("\nwritten: threshold {threshold:.6}, {reason}\n");
        }
        text
    }
}

/// How well each score of a box tells unknown from known, and from background.
pub(super) fn separation(scores: &[ScoreSeparation]) -> String {
    let Some(first) = scores.first() else {
        return String::new();
    };
    let mut text = format!(
        "\nunknown from known and from background, on {} known, {} unknown and {} boxes that touch no label\n",
        first.known, first.unknown, first.background
    );
    let mut row = |[score, auroc, fpr95, background]: [&str; 4]| {
        text += &format!("{score:<12} {auroc:>7} {fpr95:>10} {background:>19}\n");
    };
    row(["score", "AUROC", "FPR at 95%", "AUROC of background"]);
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.3}"));
    for s in scores {
        let [auroc, fpr95, background] = [s.auroc, s.fpr95, s.auroc_background].map(number);
        row([&s.score, &auroc, &fpr95, &background]);
    }
    text
}

fn figures(class: &ClassReport) -> String {
    let (ap, recall) = (class.main().ap, class.main().recall_percent);
    [ap.r40, ap.r11, ap.all, recall]
        .map(|figure| format!("{figure:>7.2}"))
        .join(" ")
}
