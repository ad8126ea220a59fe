//! `mluc-lab`: what happens off the vehicle.

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
            eprintln!("mluc-lab: {error:#}");
            std::process::ExitCode::FAILURE
        }
    }
}
