//! One pipeline, one report.

use std::process::ExitCode;

use mluc::EXIT_WARNINGS;
use mluc::terminal::print_out;

use super::arguments::Instrumentation;
use super::baselines::add_baselines;
use super::folder;
use super::measured::Measured;
use super::plan::Plan;
use super::progress::Progress;
use super::quiet::Quiet;
use super::trace::SpansFolder;
use crate::report::LatencyReport;

pub(crate) fn single(plan: &Plan) -> anyhow::Result<ExitCode> {
    folder::make(&plan.args.out)?;
    let mut variant = plan.variants[0].clone();
    let spans = plan
        .args
        .trace
        .as_ref()
        .map(|_| SpansFolder::make(&plan.args.out));
    let spans = spans.transpose()?;
    variant
        .environment
        .extend(spans.as_ref().map(SpansFolder::variable));
    let mut quiet = Quiet::new();
    let mut progress = Progress::new();
    let mut measured = Measured::default();
    for round in 0..plan.rounds {
        measured.add_round(plan, &variant, [round, round], &mut quiet, &mut progress)?;
        if measured.is_interrupted {
            break;
        }
    }
    let mut report = measured.report(plan, &variant, &quiet);
    finish(plan, &measured, &mut report, &mut progress);
    drop(progress);
    folder::write(&plan.args.out, &report, &measured.frames, &measured.samples)?;
    print_out(report.table().trim_end())?;
    let page = plan.args.out.join("report.html");
    print_out(format_args!("report: {}", page.display()))?;
    if let (Some(file), Some(spans)) = (&plan.args.trace, &spans) {
        let trace = spans.write_trace(file, plan.args.trace_frame, &measured.frames)?;
        print_out(format_args!("trace of {trace}"))?;
    }
    let is_flawed = measured.is_flawed(&report);
    Ok(ExitCode::from(if is_flawed { EXIT_WARNINGS } else { 0 }))
}

/// The baselines, unless somebody is in a hurry.
pub(crate) fn finish(
    plan: &Plan,
    measured: &Measured,
    report: &mut LatencyReport,
    progress: &mut Progress,
) {
    let is_bare = plan.args.instrumentation == Instrumentation::Off;
    let rounds = if measured.is_interrupted || is_bare {
        0
    } else {
        plan.baseline_rounds
    };
    let warning = add_baselines(&mut report.hops, measured.payload_bytes, rounds, progress);
    report.warnings.extend(warning);
}
