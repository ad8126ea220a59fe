//! The program `mluc-contract`: plays the stages around a program and judges whether it keeps the contract
//! (`docs/CONTRACT.md`). A suite for each place in the pipeline; `mluc refiner-test` starts `mluc-contract refiner`.
//!
//! Reports go to stdout, everything else to stderr. Exit codes: 0 all cases passed, 1 a case failed or the suite could
//! not run, 2 usage.

#![warn(clippy::print_stdout, clippy::print_stderr)]

mod program;
mod refiner;
mod report;

use std::os::unix::process::CommandExt;
use std::process::{Command, ExitCode};

use anyhow::Context;
use clap::{Args, Parser, Subcommand};
use mluc::exit_code;
use mluc::stages::end_with;

/// Judges programs that stand in a stage's place.
#[derive(Debug, Parser)]
#[command(name = "mluc-contract", version)]
struct Cli {
    #[command(subcommand)]
    suite: Suite,
}

#[derive(Debug, Subcommand)]
enum Suite {
    /// Test any program against the refiner's contract; without one, our own refiner in all modes.
    Refiner(refiner::RefinerArgs),
    /// Start a program that ends with this one.
    #[command(hide = true)]
    Exec(ExecArgs),
}

#[derive(Args, Debug)]
struct ExecArgs {
    /// Process to end with.
    #[arg(long)]
    supervised_by: u32,
    /// The program and its arguments.
    #[arg(last = true, required = true)]
    command: Vec<String>,
}

fn main() -> ExitCode {
    let result = match Cli::parse().suite {
        Suite::Refiner(args) => refiner::run(args),
        Suite::Exec(args) => exec(&args),
    };
    exit_code("mluc-contract", result)
}

fn exec(args: &ExecArgs) -> anyhow::Result<ExitCode> {
    end_with(args.supervised_by)?;
    // Only returns when it fails.
    let error = Command::new(&args.command[0])
        .args(&args.command[1..])
        .exec();
    Err(error).with_context(|| format!("starting {}", args.command[0]))
}
