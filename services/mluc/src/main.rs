//! The program `mluc`: a thin process around each stage, and the supervisor that keeps them running.
//!
//! Results go to stdout, everything else to stderr. Exit codes: 0 fine, 1 failure, 2 usage, 3 finished, but a frame was
//! lost or a stage had to be restarted.

#![warn(clippy::print_stdout, clippy::print_stderr)]

mod bundled;
mod cli;
mod commands;
mod config;
mod embedded;
mod model;
mod nearest;
mod place;
mod settings;
mod source;
mod stages;
mod supervisor;
mod terminal;

use std::process::ExitCode;

use clap::Parser;

use cli::{Cli, Command};
use terminal::tell;

/// Finished, but not all went well.
const EXIT_WARNINGS: u8 = 3;
/// The command line or the configuration is wrong.
const EXIT_USAGE: u8 = 2;
const EXIT_FAILURE: u8 = 1;

/// An error of the user's making: exit code 2.
#[derive(Debug)]
struct UsageError(String);

impl std::fmt::Display for UsageError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for UsageError {}

fn main() -> ExitCode {
    // The other side of a measurement of hand-over: this program, started by itself (`mluc bench`).
    match mluc_transport::serve_peer() {
        Ok(true) => return ExitCode::SUCCESS,
        Ok(false) => (),
        Err(error) => {
            tell(format_args!("mluc: {error}"));
            return ExitCode::from(EXIT_FAILURE);
        }
    }
    let cli = Cli::parse();
    let result = match cli.command {
        Command::Up(args) => commands::up(args),
        Command::Demo(args) => commands::demo(args),
        Command::Stage(args) => stages::run(args).map(|()| ExitCode::SUCCESS),
        Command::Status(args) => commands::status(args),
        Command::Doctor(args) => commands::doctor(args),
        Command::Bench(args) => commands::bench(args),
        Command::RefinerTest(args) => commands::refiner_test(args),
        Command::Exec(args) => commands::exec(args),
        Command::Neighbour(args) => commands::neighbour(args),
    };
    match result {
        Ok(code) => code,
        Err(error) => {
            tell(format_args!("mluc: {error:#}"));
            let usage = error.downcast_ref::<UsageError>().is_some();
            ExitCode::from(if usage { EXIT_USAGE } else { EXIT_FAILURE })
        }
    }
}
