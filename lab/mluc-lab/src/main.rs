//! `mluc-lab`: the tools for use outside the vehicle.
#![warn(clippy::print_stdout, clippy::print_stderr)]

mod commands;

use clap::Parser;

/// The laboratory of mluc: simulate scans, train the network, evaluate detections, draw pictures.
#[derive(Parser)]
#[command(name = "mluc-lab", version)]
struct Arguments {
    #[command(subcommand)]
    command: commands::Command,
}

fn main() -> std::process::ExitCode {
    match commands::run(Arguments::parse().command) {
        Ok(()) => std::process::ExitCode::SUCCESS,
        Err(error) => {
            commands::terminal::print_err(format_args!("mluc-lab: {error:#}"));
            std::process::ExitCode::FAILURE
        }
    }
}
