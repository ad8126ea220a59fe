//! `mluc bench`: the real processes on a scenario, measured from outside and by their own stamps, written as a report.
//!
//! Open loop: frames are due at a fixed rate whatever the pipeline does, and every latency counts from due. What is
//! computed of the records is `mluc-report`'s; here is what touches the machine.

mod arguments;
mod compare;
mod floors;
mod folder;
mod labels;
mod machine;
mod neighbour;
mod plan;
mod processes;
mod progress;
mod quality;
mod quiet;
mod recorder;
mod round;
mod run;
mod scenario;
mod summary;
mod trace;
mod variants;

use std::process::ExitCode;

use mluc_runtime::log_to_stderr;

pub(crate) use arguments::{BenchArgs, NeighbourArgs};
pub(crate) use neighbour::neighbour;
pub(crate) use scenario::BenchTable;

use arguments::BenchCommand;
use plan::Plan;

/// `mluc bench`.
pub(crate) fn bench(args: Box<BenchArgs>) -> anyhow::Result<ExitCode> {
    // What the pipeline loses stands in the report.
    log_to_stderr("bench", "error");
    match args.command {
        Some(BenchCommand::Compare(args)) => compare::compare_folders(&args),
        None => {
            let plan = Plan::resolve(args.run)?;
            match plan.variants.len() {
                1 => run::single(&plan),
                _ => variants::alternate(&plan),
            }
        }
    }
}
