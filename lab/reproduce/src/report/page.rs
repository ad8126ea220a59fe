//! The report as one Markdown page, with its figures in the same folder: `page.md` is the template, and explains its tables.

use super::data::{ReproductionReport, Rows, present};
use serde_json::json;

/// Writes the page. `pictures` are files in its folder with their descriptions, in the order to be shown.
pub(crate) fn page(report: &ReproductionReport, pictures: &[(String, String)]) -> String {
    // The order of the paper: industrial park first.
    let settings = report.settings.iter().rev();
    let settings = settings.map(|(name, rows)| (name, cells(name, rows), report.details.get(name)));
    let values = json!({
        "provenance": report.provenance,
        "settings": settings.collect::<Vec<_>>(),
        "pictures": pictures,
    });
    mluc_evaluate::render(include_str!("page.md"), values)
}

/// The values of each row of a setting.
fn cells(setting: &str, rows: &Rows) -> Vec<serde_json::Value> {
    // Index of the corresponding setting in the paper (`sim-udi`; `sim-kitti` and `kitti`).
    let papers = usize::from(setting.ends_with("kitti"));
    let cells = present(rows).map(|(row, figures)| {
        let mut cells = json!(figures);
        cells["title"] = json!(row.title);
        cells["ablation"] = json!(row.ablation);
        cells["paper"] = json!(row.paper[papers]);
        cells
    });
    cells.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const COMMITTED: &str = include_str!("../../../../docs/results/reproduce/report.json");

    /// Every figure and every word of the committed page follows from the committed JSON.
    #[test]
    fn the_committed_report_is_written_from_its_json() {
        let json: serde_json::Value = serde_json::from_str(COMMITTED).expect("JSON");
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
        assert_eq!(pictures.len(), 2);
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
