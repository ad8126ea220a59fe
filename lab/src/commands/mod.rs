//! One subcommand a file.

use clap::Subcommand;

/// What `mluc-lab` can do.
#[derive(Subcommand)]
pub(crate) enum Command {}

/// Runs one subcommand.
pub(crate) fn run(command: Command) -> anyhow::Result<()> {
    match command {}
}
