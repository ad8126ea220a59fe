//! The parts of the program `mluc`: the process around each stage, the supervisor that keeps the stages running, and the
//! configuration of a run. Programs that start pipelines of their own (`mluc-bench`, `mluc-contract`) use them too.
//!
//! Results go to stdout, everything else to stderr. Exit codes: 0 fine, 1 failure, 2 usage, 3 finished, but a frame was
//! lost or a stage had to be restarted (docs/output.md).

#![warn(clippy::print_stdout, clippy::print_stderr)]

pub mod bundled;
mod cli;
mod commands;
mod control;
pub mod document;
pub mod external;
pub mod model;
mod piped;
pub mod placement;
pub mod resolve;
pub mod settings;
pub mod stages;
mod supervisor;
pub mod terminal;

use clap::Parser;
use cli::{Cli, Command};
pub use cli::{DoctorArgs, StageArgs};
pub use commands::doctor;
use mluc_runtime::choose_log_format;
use std::process::ExitCode;
use terminal::{print_at, print_err};
use tracing::Level;

/// Finished, but a frame was lost or a stage had to be restarted.
pub const EXIT_WARNINGS: u8 = 3;
/// The command line or the configuration is wrong.
pub const EXIT_USAGE: u8 = 2;
/// Any other error that stops a program.
pub const EXIT_FAILURE: u8 = 1;

/// An error in the command line or the configuration: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(pub String);

/// The exit code of a command; an error is printed first, after `program`'s name.
pub fn exit_code(program: &str, result: anyhow::Result<ExitCode>) -> ExitCode {
    mluc_runtime::tell_repeats(true);
    result.unwrap_or_else(|error| {
        print_at(Level::ERROR, format_args!("{program}: {error:#}"));
        let is_usage = error.downcast_ref::<UsageError>().is_some();
        ExitCode::from(if is_usage { EXIT_USAGE } else { EXIT_FAILURE })
    })
}

/// The program `mluc`; `has_stdout`: whether standard output was open when it was started.
pub fn main(has_stdout: bool) -> ExitCode {
    let cli = Cli::parse();
    mluc_runtime::prepare_signals();
    if let Some(format) = &cli.log_format {
        choose_log_format(format);
    }
    // These commands write nothing to standard output.
    use Command::{Clean, Exec, Stage};
    let is_silent = matches!(cli.command, Stage(_) | Clean { .. } | Exec { .. });
    if !has_stdout && !is_silent {
        print_err("mluc: standard output is closed: results would be lost");
        return ExitCode::from(EXIT_FAILURE);
    }
    let result = match cli.command {
        Command::Up(args) => commands::up(args),
        Command::Demo { picture, pipeline } => commands::demo(&picture, pipeline),
        Command::Replay { from, pipeline } => commands::replay(pipeline, from),
        Command::Stage(args) => stages::run(args, None).map(|()| ExitCode::SUCCESS),
        Command::Config { print, pipeline } => commands::config(print, pipeline),
        Command::Status { instance, json } => commands::status(instance.as_deref(), json),
        Command::Top { instance, once } => commands::top(instance.as_deref(), once),
        Command::Monitor { instance, listen } => commands::monitor(instance.as_deref(), listen),
        Command::Reload { instance } => commands::reload(instance.as_deref()),
        Command::Doctor(args) => commands::doctor(&args, None),
        Command::View(_) => external::external("mluc-view", &["view"]),
        Command::Record(_) => external::external("mluc-view", &["record"]),
        Command::Publish(_) => external::external("mluc-ros2", &["publish"]),
        Command::Zenoh(_) => external::external("mluc-zenoh", &[]),
        Command::Bench(_) => external::external("mluc-bench", &[]),
        Command::RefinerTest(_) => external::external("mluc-contract", &["refiner"]),
        Command::Clean { instance } => commands::clean(&instance),
        Command::Exec { supervised_by, cpus, command } => {
            commands::exec(supervised_by, cpus, &command)
        }
    };
    exit_code("mluc", result)
}
