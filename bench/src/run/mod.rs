//! The program `mluc-bench`: runs the real processes on a scenario, measures them from outside and by their own stamps, writes a report.
//!
//! `report` computes figures from the records; this module does what touches the machine. Exit codes are the same as for `mluc`.

mod arguments;
mod compare;
mod folder;
mod interleaved;
mod measured;
mod pipeline;
mod plan;
mod processes;
mod quiet;
mod round;

use arguments::{Cli, Command};
use clap::Parser;
use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};
use mluc_runtime::log_to_stderr;
use plan::Plan;
use std::process::ExitCode;

pub(crate) fn program() -> ExitCode {
    mluc::exit_code("mluc-bench", run(Cli::parse()))
}

fn run(cli: Cli) -> anyhow::Result<ExitCode> {
    // The report shows what the pipeline loses.
    log_to_stderr("bench", "error");
    match cli.command {
        Some(Command::Compare(args)) => compare::compare_folders(&args),
        None => {
            let plan = Plan::resolve(cli.run)?;
            if plan.args.compares() {
                interleaved::interleaved(&plan)
            } else {
                measured::measure(&plan)
            }
        }
    }
}

/// A line on stderr that shows how far the measurement is; only on a terminal.
fn progress() -> ProgressBar {
    let style = ProgressStyle::with_template("[{bar:30}] {msg}");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(100).with_finish(ProgressFinish::AndClear).with_style(style)
}

/// Shows the progress: `share` of the work is done, 0 to 1.
fn show(progress: &ProgressBar, share: f64, what: String) {
    progress.set_position((100.0 * share) as u64);
    progress.set_message(what);
}
