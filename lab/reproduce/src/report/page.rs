//! The report as one Markdown page, with its figures beside it: `page.json` says which tables there are and what their cells hold.

use super::data::{MethodFigures, ReproductionReport, Rows, SpreadKind, present};
use crate::methods::MethodRow;
use serde::Deserialize;
use serde_json::{Value, json};

#[derive(Deserialize)]
struct Layout {
    intro: String,
    tables: Vec<Table>,
}

/// A table; it is left out where it has no rows.
#[derive(Deserialize)]
struct Table {
    title: String,
    /// Name of the rows, see [`rows`].
    rows: String,
    head: String,
    /// What [`fill`] makes a row of.
    line: String,
    #[serde(default)]
    note: String,
}

/// Writes the page. `pictures` are files beside it with what they show, in the order to be shown.
pub(crate) fn page(report: &ReproductionReport, pictures: &[(String, String)]) -> String {
    let layout: Layout = serde_json::from_str(include_str!("page.json")).expect("the layout");
    let mut text = fill(&layout.intro, &report.provenance);
    // The paper's order: the industrial park first.
    for (setting, methods) in report.settings.iter().rev() {
        let details = report.details.get(setting).unwrap_or(&Value::Null);
        text += &format!("\n## {setting}\n\n{}", labels(details));
        for table in &layout.tables {
            let rows = rows(&table.rows, setting, methods, details);
            let Some(first) = rows.first() else {
                continue;
            };
            let head = fill(&table.head, first);
            let rule = "---|".repeat(head.split(" | ").count());
            text += &format!("\n**{}**\n\n| {head} |\n|{rule}\n", table.title);
            for row in &rows {
                text += &format!("| {} |\n", fill(&table.line, row));
            }
            text += &table.note;
        }
    }
    text += "\n## Pictures\n";
    for (file, what) in pictures {
        text += &format!("\n{what}\n\n![{what}]({file})\n");
    }
    text
}

/// The entries of a list; none where it is missing.
fn entries<'a>(details: &'a Value, list: &str) -> impl Iterator<Item = &'a Value> + use<'a> {
    details[list].as_array().into_iter().flatten()
}

fn labels(details: &Value) -> String {
    let known = details["known_labels"].as_object().into_iter().flatten();
    let known: Vec<String> = known
        .map(|(class, count)| format!("{count} {class}"))
        .collect();
    let test = entries(details, "data").find(|data| data["split"] == "test");
    let frames = test.and_then(|data| data["frames"].as_u64()).unwrap_or(0);
    let (unknown, known) = (details["unknown_labels"].as_u64(), known.join(", "));
    let unknown = unknown.unwrap_or(0);
    format!(
        "{frames} test frames with {unknown} unknown objects and {known} that count at moderate.\n"
    )
}

/// The values of each row of a table, by name.
fn rows(name: &str, setting: &str, methods: &Rows, details: &Value) -> Vec<Value> {
    let methods = present(methods).map(|(row, figures)| method(row, figures, setting));
    match name {
        "methods" => methods.collect(),
        "methods of table 1" => methods.filter(|row| row.get("ml").is_some()).collect(),
        "methods on streets" => methods.filter(|_| setting.ends_with("kitti")).collect(),
        "separation" => {
            let of_network = |n: &Value| -> Vec<Value> {
                let scores = entries(n, "separation");
                scores
                    .map(|s| json!({"network": n["network"], "of": s}))
                    .collect()
            };
            entries(details, "networks").flat_map(of_network).collect()
        }
        "real" => entries(details, "real").map(real).collect(),
        list => entries(details, list).cloned().collect(),
    }
}

fn method(row: &MethodRow, figures: &MethodFigures, setting: &str) -> Value {
    let mut cells = json!(figures);
    cells["title"] = json!(row.title);
    cells["paper"] = json!(row.paper_figures(setting));
    if let Some(parts) = row.ablation {
        let [ml, uc] = parts.map(|on| if on { "✓" } else { "" });
        (cells["ml"], cells["uc"]) = (json!(ml), json!(uc));
    }
    let labels = figures.mean("unknown_labels").unwrap_or(0.0);
    let taken = figures.mean("a_ose");
    let taken = taken.map(|n| format!("{n:.0} of {labels:.0}"));
    cells["taken_for_known"] = json!(taken.unwrap_or_default());
    cells["spread_over"] = match figures.spread {
        SpreadKind::Bootstrap => json!("test frames"),
        SpreadKind::Seeds => json!(format!("{} seeds", figures.seeds.len())),
    };
    cells
}

fn real(row: &Value) -> Value {
    let classes = row["ap_all"].as_object().into_iter().flatten();
    let classes = classes.map(|(class, ap)| {
        let (ap, labels) = (ap.as_f64().unwrap_or(f64::NAN), &row["labels"][class]);
        format!("{class} {ap:.1} ({labels})")
    });
    let mut cells = row.clone();
    cells["classes"] = json!(classes.collect::<Vec<_>>().join(", "));
    cells
}

/// Replaces each `{path}` or `{path:form}` of a line by that value of a row, see [`cell`].
fn fill(line: &str, row: &Value) -> String {
    let mut pieces = line.split('{');
    let mut text = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let (name, rest) = piece.split_once('}').unwrap_or((piece, ""));
        let (path, form) = name.split_once(':').unwrap_or((name, ""));
        let value = row.pointer(&format!("/{path}"));
        text += &cell(value.unwrap_or(&Value::Null), form);
        text += rest;
    }
    text
}

/// A value as it is; of form `1` with one decimal (of a mean with its spread, the mean), `±` with its spread, `%` a share as percent;
/// `keys` of a map its names. A map's values are cells of their own; what is missing is a dash.
fn cell(value: &Value, form: &str) -> String {
    let number = |at: usize| value.get(at).unwrap_or(value).as_f64().unwrap_or(f64::NAN);
    match (value, form) {
        (Value::Null, _) => "-".to_owned(),
        (Value::Object(map), "keys") => map.keys().cloned().collect::<Vec<_>>().join(" | "),
        (Value::Object(map), _) => {
            let cells = map.values().map(|value| cell(value, form));
            cells.collect::<Vec<_>>().join(" | ")
        }
        (_, "1") => format!("{:.1}", number(0)),
        (_, "±") => format!("{:.1} ± {:.1}", number(0), number(1)),
        (_, "%") => format!("{:.1}", 100.0 * number(0)),
        (Value::String(text), _) => text.clone(),
        (value, _) => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COMMITTED: &str = include_str!("../../../../docs/results/reproduce/report.json");

    /// Every figure and every word of the committed page follows from the committed JSON.
    #[test]
    fn the_committed_report_is_written_from_its_json() {
        let json: Value = serde_json::from_str(COMMITTED).expect("JSON");
        let report: ReproductionReport = serde_json::from_str(COMMITTED).expect("a report");
        let row = &json["sim-udi"]["paper-corrected"];
        let read = &report.settings["sim-udi"]["paper-corrected"];
        assert_eq!(json!(read), *row);
        let committed = include_str!("../../../../docs/results/reproduce/README.md");
        let (tables, pictures) = committed.split_once("\n## Pictures\n").expect("pictures");
        let pictures: Vec<(String, String)> = pictures
            .lines()
            .filter_map(|line| line.strip_prefix("![")?.strip_suffix(')')?.split_once("]("))
            .map(|(what, file)| (file.to_owned(), what.to_owned()))
            .collect();
        assert_eq!(pictures.len(), 6);
        let written = page(&report, &pictures);
        for (ours, theirs) in written.lines().zip(tables.lines()) {
            assert_eq!(ours, theirs);
        }
        assert_eq!(written, committed);
    }

    #[test]
    fn tables_without_rows_are_left_out() {
        let mut report: ReproductionReport = serde_json::from_str(COMMITTED).expect("a report");
        report.details.clear();
        report.settings.retain(|setting, _| setting == "sim-udi");
        for rows in report.settings.values_mut() {
            rows.retain(|key, _| key == "closed-set");
        }
        let text = page(&report, &[]);
        assert!(text.contains("## sim-udi") && text.contains("| Closed set | 78.9 |"));
        for absent in ["Table 1", "step by step", "Fair:", "**Networks**"] {
            assert!(!text.contains(absent), "{absent}");
        }
    }
}
