//! The subcommands; those of a few lines stand here.

mod demo;
mod doctor;
mod metrics;
mod monitor;
mod observe;
mod status;
mod top;
mod up;

use std::os::unix::process::CommandExt;
use std::process::ExitCode;

use anyhow::Context;
use mluc_runtime::{Instance, Shell, log_to_stderr};

use crate::cli::PipelineArgs;
use crate::placement::pin;
use crate::resolve::Resolved;
use crate::stages::end_with;
use crate::terminal::print_out;

pub(crate) use demo::demo;
pub(crate) use doctor::doctor;
pub(crate) use monitor::{loopback, monitor};
pub(crate) use status::status;
pub(crate) use top::top;
pub(crate) use up::up;

/// `mluc config`: the settings of a run, without the run.
pub(crate) fn config(prints: bool, pipeline: PipelineArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr("config", "warn");
    let mut resolved = Resolved::of(pipeline, false)?;
    resolved.load_model()?;
    if prints {
        print_out(resolved.print()?.trim_end())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// `mluc clean`: iceoryx2's own cleaning, once.
pub(crate) fn clean(instance: &str) -> anyhow::Result<ExitCode> {
    log_to_stderr("clean", "warn");
    Shell::remove_dead(&Instance::new(instance)?)?;
    Ok(ExitCode::SUCCESS)
}

/// `mluc exec`: ties this process to the supervisor and becomes another program.
pub(crate) fn exec(
    parent: u32,
    cpus: Option<Vec<usize>>,
    command: &[String],
) -> anyhow::Result<ExitCode> {
    end_with(parent)?;
    cpus.map_or(Ok(()), |cpus| pin(&cpus))?;
    let (program, arguments) = command.split_first().context("no program given")?;
    // Only returns when it fails.
    let error = std::process::Command::new(program).args(arguments).exec();
    Err(error).with_context(|| format!("starting {program}"))
}
