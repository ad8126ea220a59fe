//! This build: one pipeline and its report, or two variants on the same frames, interleaved: A, B, B, A, each time from a
//! fresh start, so that a machine that slowly changes treats both alike.

use std::process::ExitCode;

use anyhow::Result;
use indicatif::ProgressBar;
use mluc::EXIT_WARNINGS;
use mluc::terminal::print_out;
use serde_json::{Value, json};

use super::arguments::Instrumentation;
use super::baselines::baselines;
use super::folder::{self, FOLDERS};
use super::measured::Measured;
use super::plan::{Plan, Variant};
use super::quality::shown;
use super::quiet::Quiet;
use super::trace::SpansFolder;
use crate::report::{CompareOptions, compare, number, table};

/// Whose turn it is: A, B, B, A, and again.
pub(crate) fn turn(number: u32) -> usize {
    usize::from(matches!(number % 4, 1 | 2))
}

pub(crate) fn measure(plan: &Plan) -> Result<ExitCode> {
    let out = &plan.args.out;
    folder::make(out)?;
    let mut variants = plan.variants.clone();
    let is_bare_compared = plan.args.instrumentation == Instrumentation::Compare;
    let has_spans = is_bare_compared || plan.args.trace.is_some();
    let spans = has_spans.then(|| SpansFolder::make(out)).transpose()?;
    // Of two the instrumented one writes them.
    let variable = spans.as_ref().map(SpansFolder::variable);
    variants[0].environment.extend(variable);
    let progress = super::progress();
    let (measured, mut reports) = rounds(plan, &variants, &progress)?;
    let is_bare = plan.args.instrumentation == Instrumentation::Off;
    let has_baselines = !measured[0].is_interrupted && !is_bare;
    let messages = if has_baselines {
        plan.baseline_rounds
    } else {
        0
    };
    let (baselines, warning) = baselines(measured[0].payload_bytes, messages, &progress);
    for report in &mut reports {
        // They are the machine's and not a variant's.
        for (topic, own) in baselines.as_object().into_iter().flatten() {
            for (key, value) in own.as_object().into_iter().flatten() {
                report["hops"][topic][key] = value.clone();
            }
        }
    }
    if let (Some(warnings), Some(text)) = (reports[0]["warnings"].as_array_mut(), warning) {
        warnings.push(text.into());
    }
    drop(progress);
    let mut pairs = measured.iter().zip(&reports);
    let is_flawed = pairs.any(|(measured, report)| measured.is_flawed(report));
    match &measured[..] {
        [a, b] => {
            let quality = [a.quality(plan)?, b.quality(plan)?];
            for ((name, measured), report) in FOLDERS.iter().zip(&measured).zip(&reports) {
                folder::write(&out.join(name), report, &measured.frames, &measured.samples)?;
            }
            let options = CompareOptions {
                end_to_end_only: is_bare_compared,
                ..CompareOptions::default()
            };
            let comparison = compare([&a.frames, &b.frames], &options)?;
            let names = [0, 1].map(|turn| variants[turn].name.as_str());
            let pair = [&reports[0], &reports[1]];
            let table = side_by_side(names, pair, &quality, is_bare_compared);
            let mut value = serde_json::to_value(&comparison)?;
            value["quality"] = json!(quality);
            folder::write_comparison(out, names, &comparison, &table, value)?;
        }
        _ => {
            let (own, report) = (&measured[0], &reports[0]);
            folder::write(out, report, &own.frames, &own.samples)?;
            print_out(table(report).trim_end())?;
            let page = out.join("report.html");
            print_out(format_args!("report: {}", page.display()))?;
            if let (Some(file), Some(spans)) = (&plan.args.trace, &spans) {
                let trace = spans.write_trace(file, plan.args.trace_frame, &own.frames)?;
                print_out(format_args!("trace of {trace}"))?;
            }
        }
    }
    Ok(ExitCode::from(if is_flawed { EXIT_WARNINGS } else { 0 }))
}

fn rounds(
    plan: &Plan,
    variants: &[Variant],
    progress: &ProgressBar,
) -> Result<(Vec<Measured>, Vec<Value>)> {
    let mut quiet = Quiet::new();
    let mut measured: Vec<Measured> = variants.iter().map(|_| Measured::default()).collect();
    let count = variants.len() as u32;
    for number in 0..count * plan.rounds {
        let turn = if count > 1 { turn(number) } else { 0 };
        let (own, numbers) = (&mut measured[turn], [number, number / count]);
        own.add_round(plan, &variants[turn], numbers, &mut quiet, progress)?;
        if own.is_interrupted {
            break;
        }
    }
    let pairs = variants.iter().zip(&measured);
    let reports = pairs.map(|(variant, own)| own.report(plan, variant, &quiet));
    let reports = reports.collect();
    Ok((measured, reports))
}

fn side_by_side(
    names: [&str; 2],
    reports: [&Value; 2],
    quality: &[Option<Value>; 2],
    end_to_end_only: bool,
) -> String {
    let mut text = String::new();
    let mut row = |name: &str, [a, b]: [String; 2]| text += &format!("{name:48}{a:>16}{b:>16}\n");
    row("", names.map(|name| name.chars().take(15).collect()));
    let ms = |pointer: &str| {
        let us = reports.map(|report| number(report, pointer).unwrap_or(0.0));
        us.map(|us| format!("{:.2}", us / 1000.0))
    };
    row("end to end p50, ms", ms("/end_to_end_us/p50"));
    row("end to end p99, ms", ms("/end_to_end_us/p99"));
    if !end_to_end_only {
        row("refiner run p50, ms", ms("/stages/refiner/run_us/p50"));
        row("refiner run p99, ms", ms("/stages/refiner/run_us/p99"));
    }
    let dropped = reports.map(|report| report["frames"]["dropped"].to_string());
    row("frames dropped", dropped);
    let [Some(a), Some(b)] = quality else {
        return text + "box quality: the scans have no labels\n";
    };
    for ((name, of_a), (_, of_b)) in shown(a).into_iter().zip(shown(b)) {
        row(name, [of_a, of_b]);
    }
    text
}
