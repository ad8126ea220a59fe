//! One subcommand a file.

mod evaluate;
mod simulate;

use clap::Subcommand;

/// What `mluc-lab` can do.
#[derive(Subcommand)]
pub(crate) enum Command {
    Evaluate(evaluate::EvaluateArguments),
    Simulate(simulate::SimulateArguments),
}

/// Runs one subcommand.
pub(crate) fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Evaluate(arguments) => evaluate::run(arguments),
        Command::Simulate(arguments) => simulate::run(arguments),
    }
}
