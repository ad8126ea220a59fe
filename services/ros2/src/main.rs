//! The program `mluc-ros2`: a pipeline between ROS 2 topics, without a ROS installation. `mluc up --input ros2:/TOPIC` starts it as the
//! stage ingest, `mluc publish` as a consumer.

mod dds;
mod publish;
mod source;

use clap::Parser;
use mluc::{DoctorArgs, StageArgs, doctor, exit_code, stages};
use mluc_runtime::{Instance, log_to_stderr};
use std::process::ExitCode;

/// rustdds is silenced: it logs errors for packets that it drops, and during its own shutdown.
const LOG: &str = "info,rustdds=off";

/// Scans from a ROS 2 topic, objects to ROS 2 topics.
#[derive(Parser)]
#[command(name = "mluc", bin_name = "mluc", version)]
enum Command {
    /// Run the stage ingest, as `mluc stage ingest` does (`mluc up --input ros2:/TOPIC` starts it).
    Stage(Box<StageArgs>),
    /// Look at the clouds of a topic, as `mluc doctor` does (`mluc doctor --input ros2:/TOPIC` starts it).
    Doctor(DoctorArgs),
    /// Publish points, objects and states of a running pipeline until Ctrl-C. ROS_DOMAIN_ID selects the domain.
    Publish {
        /// Name of the pipeline, which may be started later [default: MLUC_INSTANCE, else `default`].
        #[arg(long, value_parser = Instance::new)]
        instance: Option<Instance>,
    },
}

fn main() -> ExitCode {
    let done = match Command::parse() {
        Command::Stage(args) => {
            log_to_stderr("ingest", LOG);
            stages::run(*args, Some(source::open)).map(|()| ExitCode::SUCCESS)
        }
        Command::Doctor(args) => {
            log_to_stderr("doctor", LOG);
            doctor(&args, Some(source::open))
        }
        Command::Publish { instance } => {
            log_to_stderr("publish", LOG);
            publish::publish(instance).map(|()| ExitCode::SUCCESS)
        }
    };
    exit_code("mluc-ros2", done)
}
