//! Two variants on the same frames, interleaved: A, B, B, A, each time from a fresh start, so that a machine that slowly
//! changes treats both alike.

use std::process::ExitCode;

use mluc::EXIT_WARNINGS;
use serde_json::json;

use super::arguments::Instrumentation;
use super::folder;
use super::measured::Measured;
use super::plan::{Plan, Variant};
use super::progress::Progress;
use super::quality::Quality;
use super::quiet::Quiet;
use super::single::finish;
use super::trace::SpansFolder;
use crate::report::{CompareOptions, HandOver, LatencyReport, compare};

/// Folders of the two reports.
pub(crate) const FOLDERS: [&str; 2] = ["a", "b"];

/// Whose turn it is: A, B, B, A, and again.
pub(crate) fn turn(number: u32) -> usize {
    usize::from(matches!(number % 4, 1 | 2))
}

pub(crate) fn interleave(plan: &Plan) -> anyhow::Result<ExitCode> {
    folder::make(&plan.args.out)?;
    let mut variants: [Variant; 2] = [0, 1].map(|turn| plan.variants[turn].clone());
    let is_bare_compared = plan.args.instrumentation == Instrumentation::Compare;
    let spans = is_bare_compared.then(|| SpansFolder::make(&plan.args.out));
    let spans = spans.transpose()?;
    // The instrumented one writes spans as well.
    let variable = spans.as_ref().map(SpansFolder::variable);
    variants[0].environment.extend(variable);
    let mut quiet = Quiet::new();
    let mut progress = Progress::new();
    let mut measured = [Measured::default(), Measured::default()];
    for number in 0..2 * plan.rounds {
        let turn = turn(number);
        let (own, numbers) = (&mut measured[turn], [number, number / 2]);
        own.add_round(plan, &variants[turn], numbers, &mut quiet, &mut progress)?;
        if own.is_interrupted {
            break;
        }
    }
    let mut reports = [0, 1].map(|turn| measured[turn].report(plan, &variants[turn], &quiet));
    let [first, second] = &mut reports;
    finish(plan, &measured[0], first, &mut progress);
    // The baselines are the machine's and not a variant's.
    for (measured, own) in first.hops.iter().zip(&mut second.hops) {
        *own = HandOver {
            frames: own.frames,
            p50_us: own.p50_us,
            p99_us: own.p99_us,
            ..measured.clone()
        };
    }
    drop(progress);
    for (turn, name) in FOLDERS.iter().enumerate() {
        let Measured {
            frames, samples, ..
        } = &measured[turn];
        folder::write(&plan.args.out.join(name), &reports[turn], frames, samples)?;
    }
    let quality = [measured[0].quality(plan)?, measured[1].quality(plan)?];
    let names = variants.each_ref().map(|variant| variant.name.as_str());
    let options = CompareOptions {
        end_to_end_only: is_bare_compared,
        ..CompareOptions::default()
    };
    let comparison = compare(&measured[0].frames, &measured[1].frames, &options)?;
    let table = side_by_side(names, &reports, &quality, is_bare_compared);
    let mut value = serde_json::to_value(&comparison)?;
    value["quality"] = json!(quality);
    folder::write_comparison(&plan.args.out, names, &comparison, &table, value)?;
    let is_flawed = [0, 1].map(|turn| measured[turn].is_flawed(&reports[turn]));
    Ok(ExitCode::from(if is_flawed.contains(&true) {
        EXIT_WARNINGS
    } else {
        0
    }))
}

/// Latency and box quality in one table.
fn side_by_side(
    names: [&str; 2],
    reports: &[LatencyReport; 2],
    quality: &[Option<Quality>; 2],
    end_to_end_only: bool,
) -> String {
    let shortened = names.map(|name| name.chars().take(15).collect::<String>());
    let mut text = String::new();
    let mut row = |name: &str, [a, b]: [String; 2]| text += &format!("{name:48}{a:>16}{b:>16}\n");
    row("", shortened);
    let ms = |of: fn(&LatencyReport) -> f64| {
        reports
            .each_ref()
            .map(|report| format!("{:.2}", of(report) / 1000.0))
    };
    row("end to end p50, ms", ms(|r| r.end_to_end_us.p50));
    row("end to end p99, ms", ms(|r| r.end_to_end_us.p99));
    if !end_to_end_only {
        row("refiner run p50, ms", ms(|r| r.stages[3].run_us.p50));
        row("refiner run p99, ms", ms(|r| r.stages[3].run_us.p99));
    }
    let dropped = reports.each_ref().map(|r| r.frames.dropped.to_string());
    row("frames dropped", dropped);
    let [Some(a), Some(b)] = quality else {
        return text + "box quality: the scans have no labels\n";
    };
    for ((name, of_a), (_, of_b)) in a.rows().into_iter().zip(b.rows()) {
        row(name, [of_a, of_b]);
    }
    text
}
