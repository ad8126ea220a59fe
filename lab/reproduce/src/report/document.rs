//! The report as one Markdown page, with its figures beside it.

use super::data::{Details, ReproductionReport};
use super::tables;

const FAIR: &str = "\nFair: trams, Misc, sitting persons, and what lies in regions without labels (DontCare) are neither right nor wrong.\n";
const THRESHOLDS: &str = "\nThresholds are chosen as the paper chooses: on the test frames themselves, the best harmonic mean that keeps nine \
     tenths of the closed set's mAP. \"Taken for known\": unknown objects that a known detection lies on.\n";

/// Writes the page. `pictures` are files beside it with what they show, in the order to be shown.
pub fn document(report: &ReproductionReport, pictures: &[(String, String)]) -> String {
    let p = &report.provenance;
    let mut text = format!(
        "# Reproduction of the paper's tables\n\nMade by `{}` (commit {}, plan `{}`, {} threads). {}\n\n\
         All figures are percent; AP is 3-D, moderate, R40 (40 recall positions) unless a column says R11 (11 positions) or all (exact area). \
         The paper does not say which it uses and reports its own, private data (UDI) and KITTI; ours are simulated scans, so the columns \
         stand beside each other for order, not for equality. `±` is a standard deviation: over {} draws of the test frames \
         (bootstrap, seed {}), or over networks of several seeds where a row says so.\n",
        p.command, p.commit, p.size, p.threads, p.training, p.bootstrap[0], p.bootstrap[1]
    );
    // The paper's order: the industrial park first.
    for (setting, rows) in report.settings.iter().rev() {
        text += &format!("\n## {setting}\n\n");
        let none = Details::default();
        let details = report.details.get(setting).unwrap_or(&none);
        text += &labels(details);
        let tables = [
            (
                "Table 1: metric learning (ML) and unsupervised clustering (UC)",
                tables::table1(setting, rows),
            ),
            (
                "Table 2: methods",
                tables::table2(setting, rows) + THRESHOLDS,
            ),
            (
                "The same with thresholds chosen on one half of the test frames and judged on the other (even and odd frames, and swapped)",
                tables::protocols(rows),
            ),
            ("How well the unknown boxes fit", tables::overlaps(rows)),
            (
                "A van found as a car: ignored (the benchmark's rule) or wrong (strict)",
                tables::strict(setting, rows),
            ),
            (
                "Known classes at the chosen threshold",
                tables::classes(rows),
            ),
            (
                "Unknown from known and from background, by score",
                tables::separation(details),
            ),
            ("Our method, step by step", tables::ablation(details)),
            (
                "Recorded scans; networks and thresholds from simulated scans alone",
                tables::real(details) + FAIR,
            ),
            ("Networks", tables::networks(details)),
            ("Data", tables::data(details)),
        ];
        for (title, table) in tables.iter().filter(|(_, table)| table.starts_with('|')) {
            text += &format!("\n**{title}**\n\n{}\n", table.trim_end());
        }
    }
    text += "\n## Pictures\n";
    for (file, what) in pictures {
        text += &format!("\n{what}\n\n![{what}]({file})\n");
    }
    text
}

fn labels(details: &Details) -> String {
    let known = details.known_labels.iter();
    let known: Vec<String> = known
        .map(|(class, count)| format!("{count} {class}"))
        .collect();
    let test = details.data.iter().find(|data| data.split == "test");
    format!(
        "{} test frames with {} unknown objects and {} that count at moderate.\n",
        test.map_or(0, |data| data.frames),
        details.unknown_labels,
        known.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::MethodFigures;

    /// Every figure and every word of the committed page follows from the committed JSON.
    #[test]
    fn the_committed_report_is_written_from_its_json() {
        let report = include_str!("../../../../docs/results/reproduce/report.json");
        let report: ReproductionReport = serde_json::from_str(report).expect("a report");
        let page = include_str!("../../../../docs/results/reproduce/README.md");
        let (tables, pictures) = page.split_once("\n## Pictures\n").expect("pictures");
        let pictures: Vec<(String, String)> = pictures
            .lines()
            .filter_map(|line| line.strip_prefix("![")?.strip_suffix(')')?.split_once("]("))
            .map(|(what, file)| (file.to_owned(), what.to_owned()))
            .collect();
        assert_eq!(pictures.len(), 6);
        let written = document(&report, &pictures);
        for (ours, committed) in written.lines().zip(tables.lines()) {
            assert_eq!(ours, committed);
        }
        assert_eq!(written, page);
    }

    #[test]
    fn tables_without_rows_are_left_out() {
        let row = MethodFigures {
            figures: [("map_known".to_owned(), [70.0, 1.0])].into(),
            ..MethodFigures::default()
        };
        let report = ReproductionReport {
            settings: [(
                "sim-udi".to_owned(),
                [("closed-set".to_owned(), row)].into(),
            )]
            .into(),
            ..ReproductionReport::default()
        };
        let text = document(&report, &[("figure5.svg".into(), "Figure 5".into())]);
        assert!(text.contains("## sim-udi") && text.contains("| Closed set | 78.9 |"));
        for absent in ["Table 1", "step by step", "Fair:", "**Networks**"] {
            assert!(!text.contains(absent), "{absent}");
        }
        assert!(text.contains("![Figure 5](figure5.svg)"));
    }
}
