//! The program `mluc-bench`: the real processes on a scenario, measured from outside and by their own stamps, written as a
//! report.
//!
//! Open loop: frames are due at a fixed rate whatever the pipeline does, and every latency counts from due. `report`
//! computes figures from the records; here is what touches the machine. Exit codes are those of `mluc`.

mod against;
mod arguments;
mod baselines;
mod compare;
mod folder;
mod measured;
mod neighbour;
mod pipeline;
mod plan;
mod processes;
mod progress;
mod quality;
mod quiet;
mod round;
mod single;
mod trace;
mod variants;

use std::process::ExitCode;

use clap::Parser;
use mluc_runtime::log_to_stderr;

use arguments::{Cli, Command};
use plan::Plan;

/// The whole program.
pub fn program() -> ExitCode {
    let result = match crate::transport::serve_peer() {
        Ok(true) => return ExitCode::SUCCESS,
        Ok(false) => run(Cli::parse()),
        Err(error) => Err(error),
    };
    mluc::exit_code("mluc-bench", result)
}

fn run(cli: Cli) -> anyhow::Result<ExitCode> {
    // What the pipeline loses stands in the report.
    log_to_stderr("bench", "error");
    match cli.command {
        Some(Command::Compare(args)) => compare::compare_folders(&args),
        Some(Command::Neighbour(args)) => neighbour::neighbour(args),
        None => {
            let plan = Plan::resolve(cli.run)?;
            if let Some(other) = &plan.args.against {
                against::against(&plan, other)
            } else if plan.variants.len() == 1 {
                single::single(&plan)
            } else {
                variants::interleave(&plan)
            }
        }
    }
}
