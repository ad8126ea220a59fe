//! The suite of the refiner: plays ingest, backbone and head over the same shared memory as the real stages, and looks at what comes back.

mod answer;
mod cases;
mod player;
mod scene;
mod session;

use std::process::ExitCode;

use clap::Args;
use mluc_refiner::Variant;

use crate::suite::{self, SuiteArgs, run_command, supervised};
use player::Player;

#[derive(Args, Clone, Debug)]
pub(crate) struct RefinerArgs {
    /// Only this mode of our own refiner.
    #[arg(long, value_name = "MODE", conflicts_with = "command")]
    refiner_mode: Option<String>,
    #[command(flatten)]
    suite: SuiteArgs,
}

pub(crate) fn run(args: RefinerArgs) -> anyhow::Result<ExitCode> {
    let programs = match &args.refiner_mode {
        _ if !args.suite.command.is_empty() => return run_command::<Player>(&args.suite),
        Some(mode) => vec![own(&args, mode)],
        None => Variant::ALL.map(|mode| own(&args, mode.name())).into(),
    };
    suite::run::<Player>(&args.suite, programs)
}

/// Title and command of our own refiner in a mode, as `mluc up` starts it.
fn own(args: &RefinerArgs, mode: &str) -> (String, Vec<String>) {
    let model = ["--model", &args.suite.model];
    let words = [["stage", "refiner"], model, ["--refiner-mode", mode]];
    let title = format!("mluc stage refiner, mode {mode}");
    (title, supervised(words.as_flattened(), &[]))
}
