//! One subcommand per file.

mod adapt;
mod evaluate;
mod export;
mod import;
mod quantize;
mod render;
mod reproduce;
mod score_clusters;
mod sensor;
mod simulate;
pub(crate) mod terminal;
mod train;

use clap::Subcommand;

#[derive(Subcommand)]
pub(crate) enum Command {
    Adapt(adapt::AdaptArguments),
    /// Judge detections against labels.
    #[command(subcommand)]
    Evaluate(evaluate::What),
    Export(export::ExportArguments),
    Import(import::ImportArguments),
    Quantize(quantize::QuantizeArguments),
    Render(render::RenderArguments),
    Reproduce(reproduce::ReproduceArguments),
    ScoreClusters(score_clusters::ScoreClustersArguments),
    Sensor(sensor::SensorArguments),
    Simulate(simulate::SimulateArguments),
    Train(train::Train),
}

pub(crate) fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Adapt(arguments) => adapt::run(arguments),
        Command::Evaluate(arguments) => evaluate::run(arguments),
        Command::Export(arguments) => export::run(arguments),
        Command::Import(arguments) => import::run(arguments),
        Command::Quantize(arguments) => quantize::run(arguments),
        Command::Render(arguments) => render::run(arguments),
        Command::Reproduce(arguments) => reproduce::run_command(arguments),
        Command::ScoreClusters(arguments) => score_clusters::run(arguments),
        Command::Sensor(arguments) => sensor::run(arguments),
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Train(arguments) => train::run(arguments),
    }
}
