//! The tables, as Markdown.

use super::data::{Details, MeanSpread, MethodFigures, SpreadKind};
use crate::methods::{METHODS, MethodRow, PaperFigures};
use std::collections::BTreeMap;

/// The rows of a setting by key.
pub(super) type Rows = BTreeMap<String, MethodFigures>;

/// The three figures that the paper reports.
const MAIN: [&str; 3] = ["map_known", "ap_unknown", "map_harm"];

/// Markdown of a head (`a | b`) and rows of cells; empty without rows.
pub(super) fn table(head: &str, rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let rows: String = rows
        .into_iter()
        .map(|cells| format!("| {} |\n", cells.join(" | ")))
        .collect();
    if rows.is_empty() {
        return rows;
    }
    let rule = "---|".repeat(head.split(" | ").count());
    format!("| {head} |\n|{rule}\n{rows}")
}

/// `12.3 ± 0.4`; a dash where there is nothing.
fn with_spread(figure: Option<MeanSpread>) -> String {
    figure.map_or_else(
        || "-".to_owned(),
        |[mean, spread]| format!("{mean:.1} ± {spread:.1}"),
    )
}

pub(super) fn plain(figure: Option<f64>) -> String {
    figure.map_or_else(|| "-".to_owned(), |v| format!("{v:.1}"))
}

fn mean_of(figures: &BTreeMap<String, MeanSpread>, name: &str) -> String {
    plain(figures.get(name).map(|figure| figure[0]))
}

fn paper(figures: Option<PaperFigures>) -> [String; 3] {
    figures
        .map_or_else(|| [None; 3], |f| f.map(Some))
        .map(plain)
}

/// The rows that the report has, in the order of the tables.
pub(super) fn present(rows: &Rows) -> impl Iterator<Item = (&'static MethodRow, &MethodFigures)> {
    let all = METHODS.iter();
    all.filter_map(|row| Some((row, rows.get(&row.key)?)))
}

/// A line a present row: its title, then what `cells` gives.
fn by_method(head: &str, rows: &Rows, cells: impl Fn(&MethodFigures) -> Vec<String>) -> String {
    let line = |(row, figures): (&MethodRow, &MethodFigures)| {
        let mut line = vec![row.title.clone()];
        line.extend(cells(figures));
        line
    };
    table(&format!("method | {head}"), present(rows).map(line))
}

/// Table 1: what metric learning and clustering bring, beside the paper's.
pub(super) fn table1(setting: &str, rows: &Rows) -> String {
    let sign = |on: bool| (if on { "✓" } else { "" }).to_owned();
    let head = "ML | UC | row | paper: mAP known | AP unknown | harmonic | ours: mAP known | AP unknown | harmonic";
    let lines = present(rows).filter_map(|(row, figures)| {
        let [ml, uc] = row.ablation?;
        let mut line = vec![sign(ml), sign(uc), row.title.clone()];
        line.extend(paper(row.paper_figures(setting)));
        line.extend(MAIN.map(|name| with_spread(figures.get(name))));
        Some(line)
    });
    table(head, lines)
}

/// Table 2: the methods, beside the paper's.
pub(super) fn table2(setting: &str, rows: &Rows) -> String {
    let head = "method | paper: mAP known | AP unknown | harmonic | ours: mAP known | AP unknown | harmonic | R11: mAP known | \
                AP unknown | harmonic | recall unknown | taken for known | spread over";
    let lines = present(rows).map(|(row, figures)| {
        let mut line = vec![row.title.clone()];
        line.extend(paper(row.paper_figures(setting)));
        let [known, unknown, harm] = MAIN.map(|name| with_spread(figures.get(name)));
        line.extend([known, format!("**{unknown}**"), format!("**{harm}**")]);
        let names = [
            "map_known_r11",
            "ap_unknown_r11",
            "map_harm_r11",
            "recall_unknown",
        ];
        line.extend(names.map(|name| mean_of(&figures.figures, name)));
        line.push(figures.get("a_ose").map_or_else(String::new, |[n, _]| {
            let labels = figures.get("unknown_labels").map_or(0.0, |l| l[0]);
            format!("{n:.0} of {labels:.0}")
        }));
        line.push(match figures.spread {
            SpreadKind::Bootstrap => "test frames".to_owned(),
            SpreadKind::Seeds => format!("{} seeds", figures.seeds.len()),
        });
        line
    });
    table(head, lines)
}

/// Oracle and honest thresholds side by side.
pub(super) fn protocols(rows: &Rows) -> String {
    let head =
        "oracle: mAP known | AP unknown | harmonic | honest: mAP known | AP unknown | harmonic";
    by_method(head, rows, |row| {
        let both = [&row.figures, &row.honest];
        let of = |figures| MAIN.map(|name| mean_of(figures, name));
        both.map(of).concat()
    })
}

/// How well the unknown boxes fit: overlap 0.1, 0.25, 0.5, each three ways.
pub(super) fn overlaps(rows: &Rows) -> String {
    let head = "IoU 0.1: R40 | R11 | all | IoU 0.25: R40 | R11 | all | IoU 0.5: R40 | R11 | all";
    by_method(head, rows, |row| {
        let stems = ["ap_unknown", "ap_unknown_iou25", "ap_unknown_iou50"];
        let three =
            |stem| ["", "_r11", "_all"].map(|end| mean_of(&row.figures, &format!("{stem}{end}")));
        stems.map(three).concat()
    })
}

/// What counts a van found as a car wrong, beside the benchmark's rule, which ignores it.
pub(super) fn strict(setting: &str, rows: &Rows) -> String {
    if !setting.ends_with("kitti") {
        return String::new();
    }
    let head = "official: mAP known | harmonic | strict: mAP known | R11 | harmonic";
    let names = [
        "map_known",
        "map_harm",
        "map_known_strict",
        "map_known_strict_r11",
        "map_harm_strict",
    ];
    by_method(head, rows, |row| {
        names.map(|name| mean_of(&row.figures, name)).into()
    })
}

/// AP of each known class.
pub(super) fn classes(rows: &Rows) -> String {
    let mut names: Vec<&str> = rows
        .values()
        .flat_map(|row| row.classes.keys())
        .map(|n| &**n)
        .collect();
    names.sort_unstable();
    names.dedup();
    by_method(&names.join(" | "), rows, |row| {
        names
            .iter()
            .map(|name| mean_of(&row.classes, name))
            .collect()
    })
}

/// How well each score of each network tells unknown from known, and from background.
pub(super) fn separation(details: &Details) -> String {
    let head = "network | score | AUROC, % | FPR at 95 % TPR, % | AUROC, unknown against background, % | boxes on known, unknown, background";
    let lines = details.networks.iter().flat_map(|network| {
        network.separation.iter().map(|s| {
            let mut line = vec![network.network.clone(), s.score.clone()];
            let figures = [s.auroc, s.fpr95, s.auroc_background];
            line.extend(figures.map(|figure| plain(figure.map(|v| 100.0 * v))));
            line.push(format!("{}, {}, {}", s.known, s.unknown, s.background));
            line
        })
    });
    table(head, lines)
}

/// Our method, step by step.
pub(super) fn ablation(details: &Details) -> String {
    let head = "step | mAP known | AP unknown | harmonic | recall unknown";
    let names = ["map_known", "ap_unknown", "map_harm", "recall_unknown"];
    let lines = details.ablation.iter().map(|row| {
        let mut line = vec![row.step.clone()];
        line.extend(names.map(|name| with_spread(row.figures.get(name))));
        line
    });
    table(head, lines)
}

/// Rows on recorded scans.
pub(super) fn real(details: &Details) -> String {
    let head =
        "method | scans | frames | class: AP all points (labels) | unknown, fair | recall unknown";
    let lines = details.real.iter().map(|row| {
        let label_count = |class| row.labels.get(class).copied().unwrap_or(0);
        let classes = row.ap_all.iter();
        let classes: Vec<String> = classes
            .map(|(class, ap)| format!("{class} {ap:.1} ({})", label_count(class)))
            .collect();
        vec![
            row.method.clone(),
            row.data.clone(),
            row.frames.to_string(),
            classes.join(", "),
            plain(row.ap_unknown_fair),
            plain(Some(row.recall_unknown)),
        ]
    });
    table(head, lines)
}

/// Where the networks come from.
pub(super) fn networks(details: &Details) -> String {
    let lines = details.networks.iter().map(|n| {
        vec![
            n.network.clone(),
            n.seed.to_string(),
            format!("{} x {}", n.steps, n.batch),
            n.commit.clone(),
            format!("`{}`", n.fingerprint),
            format!("`{}`", n.command),
        ]
    });
    table(
        "network | seed | steps x frames | commit | model | trained by",
        lines,
    )
}

/// Where the scans come from.
pub(super) fn data(details: &Details) -> String {
    let lines = details.data.iter().map(|d| {
        let [hash, command] = [&d.hash, &d.command].map(|text| format!("`{text}`"));
        vec![d.split.clone(), d.frames.to_string(), hash, command]
    });
    table("data | frames | hash | made by", lines)
}
