//! Reports as text: JSON for programs, a table for people.

use super::{AveragePrecision, Difficulty, Metric, Report};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fmt::Write as _;

impl Report {
    /// `{"car/3d/moderate": {"ap_r11": .., "ap_r40": .., "ap_all": ..}, ..}`, with the open-set figures at the top
    /// level where there are any, in percent; `unknown_confusion` holds counts.
    pub fn to_json(&self) -> Value {
        let mut object = Map::new();
        for class in &self.classes {
            for metric in Metric::ALL {
                for difficulty in Difficulty::ALL {
                    let AveragePrecision { r11, r40, all } = class.entry(metric, difficulty).ap;
                    let key = format!(
                        "{}/{}/{}",
                        class.rule.name,
                        metric.name(),
                        difficulty.name()
                    );
                    object.insert(key, json!({"ap_r11": r11, "ap_r40": r40, "ap_all": all}));
                }
            }
        }
        for (key, value) in self.summary_entries() {
            object.insert(key.to_owned(), json!(value));
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

    /// The open-set figures by name. Recall has no recall positions: its twin is the same number.
    fn summary_entries(&self) -> Vec<(&'static str, f64)> {
        let Some(s) = self.summary else {
            return Vec::new();
        };
        vec![
            ("map_known", s.map_known),
            ("recall_unknown", s.recall_unknown),
            ("ap_unknown", s.ap_unknown),
            ("map_harm", s.map_harm),
            ("map_known_all", s.map_known_all),
            ("recall_unknown_all", s.recall_unknown),
            ("ap_unknown_all", s.ap_unknown_all),
            ("map_harm_all", s.map_harm_all),
        ]
    }

    /// The same for people: easy / moderate / hard beside each other.
    pub fn to_table(&self) -> String {
        let mut text = String::new();
        // Writing to a String does not fail.
        let _ = writeln!(
            text,
            "{:<12} {:<4} {:>5}  {:^17}  {:^20}  {:^20}  {:^20}",
            "class", "", "IoU >", "labels", "AP R11, %", "AP R40, %", "AP all points, %"
        );
        let triple = "  easy    mod   hard";
        let _ = writeln!(
            text,
            "{:<24} {:>17}  {triple}  {triple}  {triple}",
            "", "easy   mod  hard"
        );
        for class in &self.classes {
            for metric in Metric::ALL {
                let entries = Difficulty::ALL.map(|difficulty| *class.entry(metric, difficulty));
                let name = if metric == Metric::Image {
                    class.rule.name.as_str()
                } else {
                    ""
                };
                let _ = write!(
                    text,
                    "{name:<12} {:<4} {:>5.2} ",
                    metric.name(),
                    class.rule.iou_min
                );
                let _ = write!(
                    text,
                    " {}",
                    entries.map(|e| format!("{:>5}", e.truth_count)).join(" ")
                );
                let aps: [fn(&AveragePrecision) -> f64; 3] =
                    [|ap| ap.r11, |ap| ap.r40, |ap| ap.all];
                for ap in aps {
                    let _ = write!(
                        text,
                        "  {}",
                        entries.map(|e| format!("{:>6.2}", ap(&e.ap))).join(" ")
                    );
                }
                let _ = writeln!(text);
            }
        }
        if let Some(s) = self.summary {
            let _ = writeln!(
                text,
                "\nopen set (3d, moderate, %)   mAP known  recall unknown  AP unknown  harmonic mean"
            );
            let recall = s.recall_unknown;
            for (name, known, unknown, harm) in [
                ("R40", s.map_known, s.ap_unknown, s.map_harm),
                (
                    "all points",
                    s.map_known_all,
                    s.ap_unknown_all,
                    s.map_harm_all,
                ),
            ] {
                let _ = writeln!(
                    text,
                    "  {name:<26} {known:>9.2}  {recall:>14.2}  {unknown:>10.2}  {harm:>13.2}"
                );
            }
        }
        if let Some(confusion) = &self.confusion {
            for (what, row) in [
                ("unknown labels, found as", &confusion.labels_found_as),
                ("best unknown detections, on", &confusion.detections_lie_on),
            ] {
                let _ = writeln!(text, "  {what:<28} {}", counts(row));
            }
        }
        text
    }
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
