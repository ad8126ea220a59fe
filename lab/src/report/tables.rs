//! The tables, as Markdown.

use super::data::{MeanSpread, MethodFigures, Report};
use super::paper::{METHODS, MethodRow, PaperFigures, paper_figures};
use std::collections::BTreeMap;
use std::fmt::Write as _;

type Rows = BTreeMap<String, MethodFigures>;

/// `12.3 ± 0.4`; a dash where there is nothing.
pub(super) fn with_spread(figure: Option<MeanSpread>) -> String {
    figure.map_or_else(
        || "-".to_owned(),
        |[mean, spread]| format!("{mean:.1} ± {spread:.1}"),
    )
}

fn plain(figure: Option<MeanSpread>) -> String {
    figure.map_or_else(|| "-".to_owned(), |[mean, _]| format!("{mean:.1}"))
}

fn paper(figures: Option<PaperFigures>) -> [String; 3] {
    figures.map_or_else(
        || ["-"; 3].map(str::to_owned),
        |figures| figures.map(|f| format!("{f:.1}")),
    )
}

/// Table 1: what metric learning and clustering bring, beside the paper's.
pub(super) fn table1(setting: &str, rows: &Rows) -> String {
    let mut text = String::from(
        "| ML | UC | row | paper: mAP known | AP unknown | harmonic | ours: mAP known | AP unknown | harmonic |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    let sign = |on: bool| if on { "✓" } else { "" };
    for row in METHODS {
        let (Some([ml, uc]), Some(figures)) = (row.ablation, rows.get(row.key)) else {
            continue;
        };
        let [a, b, c] = paper(paper_figures(&row, setting));
        let [x, y, z] =
            ["map_known", "ap_unknown", "map_harm"].map(|name| with_spread(figures.get(name)));
        let (ml, uc, title) = (sign(ml), sign(uc), row.title);
        // Writing to a String does not fail.
        let _ = writeln!(
            text,
            "| {ml} | {uc} | {title} | {a} | {b} | {c} | {x} | {y} | {z} |"
        );
    }
    text
}

/// Table 2: the methods, beside the paper's.
pub(super) fn table2(setting: &str, rows: &Rows) -> String {
    let mut text = String::from(
        "| method | paper: mAP known | AP unknown | harmonic | ours: mAP known | AP unknown | harmonic | R11: mAP known | AP unknown | \
         harmonic | recall unknown | taken for known | spread over |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (row, figures) in present(rows) {
        let [a, b, c] = paper(paper_figures(row, setting));
        let [x, y, z] =
            ["map_known", "ap_unknown", "map_harm"].map(|name| with_spread(figures.get(name)));
        let [r, s, t, u] = [
            "map_known_r11",
            "ap_unknown_r11",
            "map_harm_r11",
            "recall_unknown",
        ]
        .map(|name| plain(figures.get(name)));
        let error = figures.get("a_ose").map_or_else(String::new, |[n, _]| {
            let labels = figures.get("unknown_labels").map_or(0.0, |l| l[0]);
            format!("{n:.0} of {labels:.0}")
        });
        let spread = spread_words(figures);
        let _ = writeln!(
            text,
            "| {} | {a} | {b} | {c} | {x} | **{y}** | **{z}** | {r} | {s} | {t} | {u} | {error} | {spread} |",
            row.title
        );
    }
    text
}

fn spread_words(figures: &MethodFigures) -> String {
    match figures.spread {
        super::SpreadKind::Bootstrap => "test frames".to_owned(),
        super::SpreadKind::Seeds => format!("{} seeds", figures.seeds.len()),
    }
}

/// Oracle and honest thresholds side by side.
pub(super) fn protocols(rows: &Rows) -> String {
    let mut text = String::from(
        "| method | oracle: mAP known | AP unknown | harmonic | honest: mAP known | AP unknown | harmonic |\n|---|---|---|---|---|---|---|\n",
    );
    for (row, figures) in present(rows) {
        let names = ["map_known", "ap_unknown", "map_harm"];
        let [a, b, c] = names.map(|name| plain(figures.get(name)));
        let [x, y, z] = names.map(|name| plain(figures.honest.get(name).copied()));
        let _ = writeln!(
            text,
            "| {} | {a} | {b} | {c} | {x} | {y} | {z} |",
            row.title
        );
    }
    text
}

/// How well the unknown boxes fit: overlap 0.1, 0.25, 0.5, each three ways.
pub(super) fn overlaps(rows: &Rows) -> String {
    let mut text = String::from(
        "| method | IoU 0.1: R40 | R11 | all | IoU 0.25: R40 | R11 | all | IoU 0.5: R40 | R11 | all |\n|---|---|---|---|---|---|---|---|---|---|\n",
    );
    for (row, figures) in present(rows) {
        let _ = write!(text, "| {} ", row.title);
        for stem in ["ap_unknown", "ap_unknown_iou25", "ap_unknown_iou50"] {
            for end in ["", "_r11", "_all"] {
                let _ = write!(text, "| {} ", plain(figures.get(&format!("{stem}{end}"))));
            }
        }
        let _ = writeln!(text, "|");
    }
    text
}

/// What counts a van found as a car wrong, beside the benchmark's rule, which ignores it.
pub(super) fn strict(setting: &str, rows: &Rows) -> String {
    if !setting.ends_with("kitti") {
        return String::new();
    }
    let mut text = String::from(
        "| method | official: mAP known | harmonic | strict: mAP known | R11 | harmonic |\n|---|---|---|---|---|---|\n",
    );
    for (row, figures) in present(rows) {
        let names = [
            "map_known",
            "map_harm",
            "map_known_strict",
            "map_known_strict_r11",
            "map_harm_strict",
        ];
        let cells = names.map(|name| plain(figures.get(name)));
        let _ = writeln!(text, "| {} | {} |", row.title, cells.join(" | "));
    }
    text
}

/// AP of each known class.
pub(super) fn classes(rows: &Rows) -> String {
    let mut names: Vec<&String> = rows.values().flat_map(|row| row.classes.keys()).collect();
    names.sort();
    names.dedup();
    let mut text = String::from("| method |");
    names.iter().for_each(|name| text += &format!(" {name} |"));
    text += "\n|---|";
    text += &"---|".repeat(names.len());
    text.push('\n');
    for (row, figures) in present(rows) {
        let _ = write!(text, "| {} |", row.title);
        for name in &names {
            let _ = write!(text, " {} |", plain(figures.classes.get(*name).copied()));
        }
        text.push('\n');
    }
    text
}

/// How well each score of each network tells unknown from known, and from background.
pub(super) fn separation(report: &Report, setting: &str) -> String {
    let mut text = String::from(
        "| network | score | AUROC, % | FPR at 95 % TPR, % | AUROC, unknown against background, % | boxes on known, unknown, background |\n|---|---|---|---|---|---|\n",
    );
    let percent =
        |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{:.1}", 100.0 * v));
    let networks = report.details.get(setting).map(|d| d.networks.as_slice());
    for network in networks.unwrap_or_default() {
        for score in &network.separation {
            let [auroc, fpr95, background] =
                [score.auroc, score.fpr95, score.auroc_background].map(percent);
            let boxes = [score.known, score.unknown, score.background].map(|n| n.to_string());
            let _ = writeln!(
                text,
                "| {} | {} | {auroc} | {fpr95} | {background} | {} |",
                network.network,
                score.score,
                boxes.join(", ")
            );
        }
    }
    text
}

/// The rows that the report has, in the order of the tables.
pub(super) fn present(rows: &Rows) -> impl Iterator<Item = (&'static MethodRow, &MethodFigures)> {
    METHODS
        .iter()
        .filter_map(|row| Some((row, rows.get(row.key)?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn our_figures_stand_beside_the_papers() {
        let figures = [
            ("map_known", 80.04),
            ("ap_unknown", 20.5),
            ("map_harm", 32.6),
        ];
        let row = MethodFigures {
            figures: figures.map(|(name, v)| (name.to_owned(), [v, 0.31])).into(),
            ..MethodFigures::default()
        };
        let rows: Rows = [("mluc-corrected".to_owned(), row)].into();
        let expected = "| ✓ | ✓ | MLUC, corrected | 79.4 | 13.2 | 22.6 | 80.0 ± 0.3 | 20.5 ± 0.3 | 32.6 ± 0.3 |";
        assert!(table1("sim-udi", &rows).contains(expected));
        assert!(table1("sim-kitti", &rows).contains("| 66.8 | 9.7 | 16.9 |"));
        assert!(table2("sim-udi", &rows).contains("**20.5 ± 0.3**"));
        assert_eq!(table2("sim-udi", &rows).lines().count(), 3);
    }
}
