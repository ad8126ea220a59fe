//! One subcommand a file.

mod evaluate;
mod evaluate_model;
mod render;
mod simulate;
mod stats;
mod train;

use clap::Subcommand;

/// What `mluc-lab` can do.
#[derive(Subcommand)]
pub(crate) enum Command {
    Evaluate(evaluate::EvaluateArguments),
    Render(render::RenderArguments),
    Simulate(simulate::SimulateArguments),
    Stats(stats::StatsArguments),
    Train(train::Train),
}

/// Runs one subcommand.
pub(crate) fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Evaluate(arguments) => evaluate::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Stats(arguments) => stats::run(arguments),
        Command::Train(arguments) => train::run(arguments),
    }
}
