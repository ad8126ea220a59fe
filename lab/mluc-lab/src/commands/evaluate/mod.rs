//! `mluc-lab evaluate`: judging detections against labels.

mod ap;
mod method;
mod model;
mod report;
mod shared;

use clap::{Args, Subcommand};

/// Judge detections against labels.
#[derive(Args)]
pub(crate) struct EvaluateArguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Ap(ap::ApArguments),
    Model(model::ModelArguments),
    Method(method::MethodArguments),
}

/// Runs the subcommand.
pub(crate) fn run(arguments: EvaluateArguments) -> anyhow::Result<()> {
    match arguments.what {
        What::Ap(arguments) => ap::run(arguments),
        What::Model(arguments) => model::run(arguments),
        What::Method(arguments) => method::run(arguments),
    }
}
