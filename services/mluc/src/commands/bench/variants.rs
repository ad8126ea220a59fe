//! Two variants on the same frames in alternation: A, B, B, A, each time from a fresh start, so that a machine that slowly
//! changes treats both alike.

use std::fs;
use std::process::ExitCode;

use anyhow::Context;
use mluc_report::{CompareOptions, Report, compare};
use serde_json::{Value, json};

use super::arguments::Instrumentation;
use super::folder;
use super::plan::{Plan, Variant};
use super::progress::Progress;
use super::quality::{Quality, judge};
use super::quiet::Quiet;
use super::round::run_round;
use super::run::{Measured, SpansFolder, exit_code, finish};
use crate::model::class_names;
use crate::terminal::answer;

/// Folders of the two reports.
const FOLDERS: [&str; 2] = ["a", "b"];

pub(super) fn alternate(plan: &Plan) -> anyhow::Result<ExitCode> {
    folder::make(&plan.out)?;
    let (variants, _spans) = variants(plan)?;
    let mut quiet = Quiet::new();
    let mut progress = Progress::new();
    let mut measured = [Measured::default(), Measured::default()];
    for number in 0..2 * plan.rounds {
        let turn = usize::from(matches!(number % 4, 1 | 2));
        let round = run_round(
            plan,
            &variants[turn],
            [number, number / 2],
            &mut quiet,
            &mut progress,
        )?;
        let is_interrupted = round.is_interrupted;
        measured[turn].add(round);
        if is_interrupted {
            break;
        }
    }
    let mut reports = [0, 1].map(|turn| measured[turn].report(plan, &variants[turn], &quiet));
    let [first, second] = &mut reports;
    finish(plan, &measured[0], first, &mut progress);
    // The floors are the machine's and not a variant's.
    second.hops.points = with_floors_of(&first.hops.points, &second.hops.points);
    second.hops.features = with_floors_of(&first.hops.features, &second.hops.features);
    drop(progress);
    for turn in 0..2 {
        let folder = plan.out.join(FOLDERS[turn]);
        folder::write(
            &folder,
            &reports[turn],
            &measured[turn].frames,
            &measured[turn].samples,
        )?;
    }
    let known = class_names(&plan.model);
    let quality = [
        judge(&measured[0].boxes, &plan.labels, &known)?,
        judge(&measured[1].boxes, &plan.labels, &known)?,
    ];
    let names = [variants[0].name.as_str(), variants[1].name.as_str()];
    let options = CompareOptions {
        end_to_end_only: plan.instrumentation == Instrumentation::Compare,
        ..CompareOptions::default()
    };
    let comparison = compare(&measured[0].frames, &measured[1].frames, &options)?;
    let text = format!(
        "{}\n{}",
        side_by_side(names, &reports, &quality, options.end_to_end_only),
        comparison.table(names)
    );
    let mut value = serde_json::to_value(&comparison)?;
    value["sentence"] = json!(comparison.sentence());
    value["names"] = json!(names);
    value["quality"] = json!(quality);
    write(plan, &text, &value)?;
    answer(text.trim_end())?;
    answer(format_args!(
        "reports: {0}/a/report.html, {0}/b/report.html",
        plan.out.display()
    ))?;
    let [a, b] = &reports;
    Ok(match exit_code(a, &measured[0]) == ExitCode::SUCCESS {
        true => exit_code(b, &measured[1]),
        false => exit_code(a, &measured[0]),
    })
}

/// The instrumented one writes spans as well.
fn variants(plan: &Plan) -> anyhow::Result<(Vec<Variant>, Option<SpansFolder>)> {
    let spans = match plan.instrumentation {
        Instrumentation::Compare => Some(SpansFolder::make(&plan.out)?),
        _ => None,
    };
    let each = plan.variants.iter().enumerate().map(|(turn, variant)| {
        let mut settings = variant.settings.clone();
        if turn == 0 {
            settings
                .environment
                .extend(spans.as_ref().map(SpansFolder::variable));
        }
        Variant {
            name: variant.name.clone(),
            settings,
        }
    });
    Ok((each.collect(), spans))
}

fn with_floors_of(floors: &mluc_report::Hop, own: &mluc_report::Hop) -> mluc_report::Hop {
    mluc_report::Hop {
        frames: own.frames,
        p50_us: own.p50_us,
        p99_us: own.p99_us,
        ..floors.clone()
    }
}

fn write(plan: &Plan, text: &str, value: &Value) -> anyhow::Result<()> {
    let json = serde_json::to_string_pretty(value)?;
    for (name, content) in [("comparison.txt", text), ("comparison.json", json.as_str())] {
        let path = plan.out.join(name);
        fs::write(&path, content).with_context(|| format!("writing {}", path.display()))?;
    }
    Ok(())
}

/// Latency and box quality in one table.
fn side_by_side(
    names: [&str; 2],
    reports: &[Report; 2],
    quality: &[Option<Quality>; 2],
    end_to_end_only: bool,
) -> String {
    let mut text = format!(
        "{:44}{:>16}{:>16}\n",
        "",
        shortened(names[0]),
        shortened(names[1])
    );
    let mut row = |name: &str, values: [String; 2]| {
        text += &format!("{name:44}{:>16}{:>16}\n", values[0], values[1]);
    };
    let ms = |of: &dyn Fn(&Report) -> f64| {
        [0, 1].map(|turn| format!("{:.2}", of(&reports[turn]) / 1000.0))
    };
    row("end to end p50, ms", ms(&|r| r.end_to_end_us.p50));
    row("end to end p99, ms", ms(&|r| r.end_to_end_us.p99));
    if !end_to_end_only {
        row("refiner run p50, ms", ms(&|r| r.stages.refiner.run_us.p50));
        row("refiner run p99, ms", ms(&|r| r.stages.refiner.run_us.p99));
    }
    row(
        "frames dropped",
        [0, 1].map(|turn| reports[turn].frames.dropped.to_string()),
    );
    let [Some(a), Some(b)] = quality else {
        return text + "box quality: the scans have no labels\n";
    };
    let of = |value: &dyn Fn(&Quality) -> String| [value(a), value(b)];
    row("labelled frames", of(&|q| q.frames.to_string()));
    row(
        "labels of unknown classes: found / all",
        of(&|q| format!("{} / {}", q.found, q.labels_unknown)),
    );
    row(
        "  3-D overlap of the found ones, mean",
        of(&|q| format!("{:.3}", q.mean_iou_found)),
    );
    row(
        "  share of all above 0.3",
        of(&|q| format!("{:.2}", q.share_above_0_3)),
    );
    row(
        "  share of all above 0.5",
        of(&|q| format!("{:.2}", q.share_above_0_5)),
    );
    row(
        "all labels: 3-D overlap of the best box, mean",
        of(&|q| format!("{:.3}", q.mean_iou_all)),
    );
    row(
        "unknown objects a frame",
        of(&|q| format!("{:.1}", q.unknown_per_frame)),
    );
    text
}

/// A command's first letters.
fn shortened(name: &str) -> String {
    name.chars().take(15).collect()
}
