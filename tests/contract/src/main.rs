//! The program `mluc-contract`: plays the stages around a program and judges whether it keeps the contract
//! (`docs/CONTRACT.md`). There is one suite per place: source, refiner (`mluc refiner-test` starts `mluc-contract refiner`), consumer.
//!
//! Reports go to stdout, everything else to stderr. Exit codes: 0 all cases passed, 1 a case failed or the suite could not run, 2 usage.

#![warn(clippy::print_stdout, clippy::print_stderr)]

mod consumer;
mod program;
mod refiner;
mod report;
mod source;
mod suite;

use clap::{Parser, Subcommand};
use mluc::exit_code;
use std::process::ExitCode;
use suite::{SuiteArgs, run_command};

/// Judges programs that stand in a stage's place.
#[derive(Debug, Parser)]
#[command(name = "mluc-contract", version)]
struct Cli {
    #[command(subcommand)]
    suite: Which,
}

#[derive(Debug, Subcommand)]
enum Which {
    /// Test any program against the refiner's contract; without one, our own refiner in all variants.
    Refiner(refiner::RefinerArgs),
    /// Test any program that publishes scans in ingest's place: its input should hold 20 scans or more.
    Source(SuiteArgs),
    /// Test any program that only reads. It must write a line of JSON with the key `sequence` to stdout for each frame that it takes.
    /// If a line has `objects`, they must be the published ones; if an object has `points`, it must be their number.
    Consumer(SuiteArgs),
}

fn main() -> ExitCode {
    let result = match Cli::parse().suite {
        Which::Refiner(args) => refiner::run(args),
        Which::Source(args) => run_command::<source::Player>(&args),
        Which::Consumer(args) => run_command::<Option<consumer::Player>>(&args),
    };
    exit_code("mluc-contract", result)
}
