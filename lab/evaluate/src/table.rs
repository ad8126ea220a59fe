//! Reports as text: JSON for programs, a table for people.

use crate::{ApReport, AveragePrecision, Difficulty, Metric};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

impl ApReport {
    /// `{"car/3d/moderate": {"ap_r11": .., "ap_r40": .., "ap_all": ..}, ..}`, with the open-set figures at the top
    /// level where there are any, in percent; `unknown_confusion` holds counts.
    pub fn to_json(&self) -> Value {
        let mut object = Map::new();
        for class in &self.classes {
            for (metric, difficulty) in metrics_and_difficulties() {
                let AveragePrecision { r11, r40, all } = class.entry(metric, difficulty).ap;
                let (name, metric, difficulty) =
                    (&class.rule.name, metric.name(), difficulty.name());
                let figures = json!({"ap_r11": r11, "ap_r40": r40, "ap_all": all});
                object.insert(format!("{name}/{metric}/{difficulty}"), figures);
            }
        }
        if let Some(s) = self.summary() {
            let harm = s.harmonic();
            // Recall has no recall positions: its twin is the same number.
            for (end, known, unknown, harm) in [
                ("", s.known.r40, s.unknown.r40, harm.r40),
                ("_all", s.known.all, s.unknown.all, harm.all),
            ] {
                object.insert(format!("map_known{end}"), json!(known));
                object.insert(format!("recall_unknown{end}"), json!(s.recall_unknown));
                object.insert(format!("ap_unknown{end}"), json!(unknown));
                object.insert(format!("map_harm{end}"), json!(harm));
            }
        }
        if let Some(confusion) = &self.confusion {
            let rows = json!({
                "labels_found_as": confusion.labels_found_as,
                "detections_lie_on": confusion.detections_lie_on,
            });
            object.insert("unknown_confusion".to_owned(), rows);
        }
        Value::Object(object)
    }

    /// The same for people: easy / moderate / hard beside each other.
    pub fn to_table(&self) -> String {
        let triple = "  easy    mod   hard";
        let mut text = format!(
            "{:<12} {:<4} {:>5}  {:^17}  {:^20}  {:^20}  {:^20}\n",
            "class", "", "IoU >", "labels", "AP R11, %", "AP R40, %", "AP all points, %"
        );
        text += &format!(
            "{:<24} {:>17}  {triple}  {triple}  {triple}\n",
            "", "easy   mod  hard"
        );
        for class in &self.classes {
            for metric in Metric::ALL {
                let entries = Difficulty::ALL.map(|difficulty| *class.entry(metric, difficulty));
                let is_first = metric == Metric::ALL[0];
                let name = if is_first { &class.rule.name } else { "" };
                let counts = entries.map(|e| format!("{:>5}", e.truth_count)).join(" ");
                let [metric, iou] = [
                    metric.name().to_owned(),
                    format!("{:.2}", class.rule.iou_min),
                ];
                text += &format!("{name:<12} {metric:<4} {iou:>5}  {counts}");
                let aps: [fn(&AveragePrecision) -> f64; 3] =
                    [|ap| ap.r11, |ap| ap.r40, |ap| ap.all];
                for ap in aps {
                    let three = entries.map(|e| format!("{:>6.2}", ap(&e.ap)));
                    text += &format!("  {}", three.join(" "));
                }
                text.push('\n');
            }
        }
        if let Some(s) = self.summary() {
            text += "\nopen set (3d, moderate, %)   mAP known  recall unknown  AP unknown  harmonic mean\n";
            let (recall, harm) = (s.recall_unknown, s.harmonic());
            for (name, known, unknown, harm) in [
                ("R40", s.known.r40, s.unknown.r40, harm.r40),
                ("all points", s.known.all, s.unknown.all, harm.all),
            ] {
                text += &format!(
                    "  {name:<26} {known:>9.2}  {recall:>14.2}  {unknown:>10.2}  {harm:>13.2}\n"
                );
            }
        }
        if let Some(confusion) = &self.confusion {
            for (what, row) in [
                ("unknown labels, found as", &confusion.labels_found_as),
                ("best unknown detections, on", &confusion.detections_lie_on),
            ] {
                text += &format!("  {what:<28} {}\n", counts(row));
            }
        }
        text
    }
}

fn metrics_and_difficulties() -> impl Iterator<Item = (Metric, Difficulty)> {
    let metrics = Metric::ALL.into_iter();
    metrics.flat_map(|metric| Difficulty::ALL.map(|difficulty| (metric, difficulty)))
}

/// `58 unknown, 11 car, 2 nothing`: most first; `none` of an empty row.
fn counts(row: &BTreeMap<String, usize>) -> String {
    if row.is_empty() {
        return "none".to_owned();
    }
    let mut row: Vec<(&String, &usize)> = row.iter().collect();
    row.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
    let row = row.iter().map(|(class, count)| format!("{count} {class}"));
    row.collect::<Vec<_>>().join(", ")
}
