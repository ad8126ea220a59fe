//! The program `mluc-view`, which `mluc view` and `mluc record` start: a running pipeline in a browser, or in a file.
//!
//! It observes like any consumer: it takes the newest frame, and nothing in the pipeline waits for it.

mod record;
mod server;

use clap::{Parser, Subcommand};
use mluc_runtime::{Instance, log_to_stderr};
use mluc_view::Follower;
use std::{path::PathBuf, process::ExitCode};

/// Look at a running pipeline, or record it.
#[derive(Parser)]
#[command(name = "mluc", bin_name = "mluc", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Name of the pipeline, which may be started later [default: MLUC_INSTANCE, else `default`].
    #[arg(long, global = true, value_parser = Instance::new)]
    instance: Option<Instance>,
}

#[derive(Subcommand)]
enum Command {
    /// Show points and objects in a browser, or in a viewer that speaks the Foxglove WebSocket protocol.
    View {
        /// Port on 127.0.0.1; 0: any.
        #[arg(long, default_value_t = 8765)]
        port: u16,
    },
    /// Write points, objects and states to an MCAP file (ROS 2 messages) until Ctrl-C.
    Record {
        /// A file that does not exist yet; `mluc up` and `replay` read it where its name ends in .mcap.
        #[arg(long)]
        out: PathBuf,
        /// Also record the features and detections of each frame, so that `mluc replay --from` can begin at a later stage: with any-open up to 15 MB per frame.
        #[arg(long)]
        stages: bool,
    },
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    log_to_stderr("view", "info");
    run(cli).unwrap_or_else(|error| {
        tracing::error!("{error:#}");
        ExitCode::FAILURE
    })
}

fn run(cli: Cli) -> anyhow::Result<ExitCode> {
    let follower = Follower::open(cli.instance)?;
    match &cli.command {
        Command::View { port } => server::view(follower, *port),
        Command::Record { out, stages } => record::record(follower, out, *stages),
    }
}
