//! The report as one Markdown page, with its figures beside it.

use super::data::{Details, Report};
use super::tables;
use std::fmt::Write as _;

/// Writes the page. `pictures` are files beside it with what they show, in the order to be shown.
pub fn document(report: &Report, pictures: &[(String, String)]) -> String {
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
        let details = report.details.get(setting);
        let _ = writeln!(text, "\n## {setting}\n");
        if let Some(details) = details {
            write_labels(&mut text, details);
        }
        section(
            &mut text,
            "Table 1: metric learning (ML) and unsupervised clustering (UC)",
            &tables::table1(setting, rows),
        );
        section(
            &mut text,
            "Table 2: methods",
            &tables::table2(setting, rows),
        );
        text += "\nThresholds are chosen as the paper chooses: on the test frames themselves, the best harmonic mean that keeps nine \
                 tenths of the closed set's mAP. \"Taken for known\": unknown objects that a known detection lies on.\n";
        section(
            &mut text,
            "The same with thresholds chosen on one half of the test frames and judged on the other (even and odd frames, and swapped)",
            &tables::protocols(rows),
        );
        section(
            &mut text,
            "How well the unknown boxes fit",
            &tables::overlaps(rows),
        );
        section(
            &mut text,
            "A van found as a car: ignored (the benchmark's rule) or wrong (strict)",
            &tables::strict(setting, rows),
        );
        section(
            &mut text,
            "Known classes at the chosen threshold",
            &tables::classes(rows),
        );
        section(
            &mut text,
            "Unknown from known and from background, by score",
            &tables::separation(report, setting),
        );
        if let Some(details) = details {
            write_details(&mut text, details);
        }
    }
    text += "\n## Pictures\n";
    for (file, what) in pictures {
        let _ = writeln!(text, "\n{what}\n\n![{what}]({file})");
    }
    text
}

fn section(text: &mut String, title: &str, table: &str) {
    // A table of a head alone says nothing.
    if table.lines().count() > 2 {
        let _ = writeln!(text, "\n**{title}**\n\n{}", table.trim_end());
    }
}

fn write_labels(text: &mut String, details: &Details) {
    let known: Vec<String> = details
        .known_labels
        .iter()
        .map(|(class, count)| format!("{count} {class}"))
        .collect();
    let frames = details
        .data
        .iter()
        .find(|data| data.split == "test")
        .map_or(0, |data| data.frames);
    let _ = writeln!(
        text,
        "{frames} test frames with {} unknown objects and {} that count at moderate.",
        details.unknown_labels,
        known.join(", ")
    );
}

fn write_details(text: &mut String, details: &Details) {
    let mut rows = String::from(
        "| step | mAP known | AP unknown | harmonic | recall unknown |\n|---|---|---|---|---|\n",
    );
    for row in &details.ablation {
        let cells = ["map_known", "ap_unknown", "map_harm", "recall_unknown"]
            .map(|name| tables::with_spread(row.figures.get(name)));
        let _ = writeln!(rows, "| {} | {} |", row.step, cells.join(" | "));
    }
    section(text, "The improved method, step by step", &rows);
    let mut rows = String::from(
        "| method | scans | frames | class: AP all points (labels) | unknown, fair | recall unknown |\n|---|---|---|---|---|---|\n",
    );
    for row in &details.real {
        let classes: Vec<String> = row
            .ap_all
            .iter()
            .map(|(class, ap)| {
                format!(
                    "{class} {ap:.1} ({})",
                    row.labels.get(class).copied().unwrap_or(0)
                )
            })
            .collect();
        let fair = row
            .ap_unknown_fair
            .map_or("-".to_owned(), |ap| format!("{ap:.1}"));
        let _ = writeln!(
            rows,
            "| {} | {} | {} | {} | {} | {:.1} |",
            row.method,
            row.data,
            row.frames,
            classes.join(", "),
            fair,
            row.recall_unknown
        );
    }
    if !details.real.is_empty() {
        rows += "\nFair: trams, Misc, sitting persons, and what lies in regions without labels (DontCare) are neither right nor wrong.\n";
    }
    section(
        text,
        "Recorded scans; networks and thresholds from simulated scans alone",
        &rows,
    );
    let mut rows = String::from(
        "| network | seed | steps x frames | commit | model | trained by |\n|---|---|---|---|---|---|\n",
    );
    for n in &details.networks {
        let _ = writeln!(
            rows,
            "| {} | {} | {} x {} | {} | `{}` | `{}` |",
            n.network, n.seed, n.steps, n.batch, n.commit, n.fingerprint, n.command
        );
    }
    section(text, "Networks", &rows);
    let mut rows = String::from("| data | frames | hash | made by |\n|---|---|---|---|\n");
    for data in &details.data {
        let _ = writeln!(
            rows,
            "| {} | {} | `{}` | `{}` |",
            data.split, data.frames, data.hash, data.command
        );
    }
    section(text, "Data", &rows);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::MethodFigures;

    #[test]
    fn tables_without_rows_are_left_out() {
        let row = MethodFigures {
            figures: [("map_known".to_owned(), [70.0, 1.0])].into(),
            ..MethodFigures::default()
        };
        let report = Report {
            settings: [(
                "sim-udi".to_owned(),
                [("closed-set".to_owned(), row)].into(),
            )]
            .into(),
            ..Report::default()
        };
        let text = document(&report, &[("figure5.svg".into(), "Figure 5".into())]);
        assert!(text.contains("## sim-udi") && text.contains("| Closed set | 78.9 |"));
        assert!(!text.contains("Table 1") && !text.contains("step by step"));
        assert!(text.contains("![Figure 5](figure5.svg)"));
    }
}
