//! The program `mluc-contract`: plays the stages around a program and judges whether it keeps the contract
//! (`docs/CONTRACT.md`). A suite for each place in the pipeline; `mluc refiner-test` starts `mluc-contract refiner`.
//!
//! Reports go to stdout, everything else to stderr. Exit codes: 0 all cases passed, 1 a case failed or the suite could
//! not run, 2 usage.

#![warn(clippy::print_stdout, clippy::print_stderr)]

mod program;
mod refiner;
mod report;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use mluc::exit_code;

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
}

fn main() -> ExitCode {
    let Suite::Refiner(args) = Cli::parse().suite;
    exit_code("mluc-contract", refiner::run(args))
}
