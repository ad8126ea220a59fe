//! This build: one pipeline and its report.

use std::process::ExitCode;

use anyhow::Result;
use mluc::EXIT_WARNINGS;
use mluc::terminal::print_out;

use super::baselines::baselines;
use super::folder;
use super::measured::Measured;
use super::plan::Plan;
use super::quiet::Quiet;
use crate::report::table;

pub(crate) fn measure(plan: &Plan) -> Result<ExitCode> {
    let out = &plan.args.out;
    folder::make(out)?;
    let progress = super::progress();
    let (mut quiet, mut measured) = (Quiet::new(), Measured::default());
    for round in 0..plan.rounds {
        measured.add_round(plan, round, &mut quiet, &progress)?;
        if measured.is_interrupted {
            break;
        }
    }
    let mut report = measured.report(plan, &quiet);
    let messages = if measured.is_interrupted {
        0
    } else {
        plan.baseline_rounds
    };
    let (baselines, warning) = baselines(measured.payload_bytes, messages, &progress);
    for (topic, own) in baselines.as_object().into_iter().flatten() {
        for (key, value) in own.as_object().into_iter().flatten() {
            report["hops"][topic][key] = value.clone();
        }
    }
    if let (Some(warnings), Some(text)) = (report["warnings"].as_array_mut(), warning) {
        warnings.push(text.into());
    }
    drop(progress);
    folder::write(out, &report, &measured.frames, &measured.samples)?;
    print_out(table(&report)?.trim_end())?;
    let page = out.join("report.html");
    print_out(format_args!("report: {}", page.display()))?;
    let is_flawed = measured.is_flawed(&report);
    Ok(ExitCode::from(if is_flawed { EXIT_WARNINGS } else { 0 }))
}
