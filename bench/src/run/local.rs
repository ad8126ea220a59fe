//! This build: one pipeline and its report.

use std::process::ExitCode;

use anyhow::Result;
use mluc::{EXIT_WARNINGS, terminal::print_out};

use super::{folder, measured::Measured, plan::Plan, quiet::Quiet};
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
    let report = measured.report(plan, &quiet)?;
    drop(progress);
    folder::write(out, &report, &measured.frames)?;
    print_out(table(&report)?.trim_end())?;
    let page = out.join("report.html");
    print_out(format_args!("report: {}", page.display()))?;
    let is_flawed = measured.is_flawed(&report);
    Ok(ExitCode::from(if is_flawed { EXIT_WARNINGS } else { 0 }))
}
