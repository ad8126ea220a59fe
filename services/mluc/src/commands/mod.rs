//! The subcommands; the short ones are in this file.

mod demo;
mod doctor;
mod metrics;
mod monitor;
mod observe;
mod replay;
mod status;
mod top;
mod up;

use crate::{cli::PipelineArgs, control::ControlWatch, placement::pin, resolve::Resolved};
use crate::{stages::end_with, terminal::print_out};
use anyhow::{Context, Result, bail, ensure};
use mluc_runtime::{ClaimNote, Instance, Shell, log_to_stderr};
use rustix::process::{Pid, Signal, kill_process};
use std::{os::unix::process::CommandExt, process::ExitCode};

pub(crate) use demo::demo;
pub use doctor::doctor;
pub(crate) use monitor::{loopback, monitor};
pub(crate) use replay::replay;
pub(crate) use status::status;
pub(crate) use top::top;
pub(crate) use up::up;

/// `mluc config`: the settings of a run, without the run.
pub(crate) fn config(prints: bool, pipeline: PipelineArgs) -> Result<ExitCode> {
    log_to_stderr("config", "warn");
    let mut resolved = Resolved::of(pipeline, false)?;
    resolved.load_model()?;
    if prints {
        print_out(resolved.print()?.trim_end())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// `mluc reload`: requests the supervisor to read its settings again, and prints the result.
pub(crate) fn reload(name: Option<&str>) -> Result<ExitCode> {
    let instance = observe::instance(name)?;
    let supervisor = ClaimNote::of_living(&instance, "pipeline");
    let asked = supervisor.as_ref().map_or(0, |note| note.pid);
    let supervisor = Pid::from_raw(asked as i32);
    let about = || format!("no `mluc up` runs as '{}'", instance.name());
    let supervisor = supervisor.with_context(about)?;
    let mut control = ControlWatch::new(&instance);
    let before = control.look().answer.0;
    kill_process(supervisor, Signal::HUP).context("asking the supervisor")?;
    // Stages may take 60 s to make a model ready.
    for _ in 0..7000 {
        std::thread::sleep(std::time::Duration::from_millis(10));
        match control.look().answer.clone() {
            (count, ..) if count <= before => {
                let living = ClaimNote::of_living(&instance, "pipeline").map(|note| note.pid);
                ensure!(living == Some(asked), "the pipeline ended before it answered");
            }
            (_, true, text) => return Err(crate::UsageError(text).into()),
            (_, false, text) => return print_out(text).map(|()| ExitCode::SUCCESS),
        }
    }
    bail!("no answer within 70 s: the first frame of an earlier reload has not come yet")
}

/// `mluc clean`: iceoryx2's own cleaning, once.
pub(crate) fn clean(instance: &str) -> Result<ExitCode> {
    log_to_stderr("clean", "warn");
    Shell::remove_dead(&Instance::new(instance)?)?;
    Ok(ExitCode::SUCCESS)
}

/// `mluc exec`: ties this process to the supervisor and replaces it with another program.
pub(crate) fn exec(parent: u32, cpus: Option<Vec<usize>>, command: &[String]) -> Result<ExitCode> {
    log_to_stderr("exec", "warn");
    end_with(parent)?;
    cpus.map_or(Ok(()), |cpus| pin(&cpus))?;
    let (program, arguments) = command.split_first().context("no program given")?;
    // `exec` only returns when it fails.
    let error = std::process::Command::new(program).args(arguments).exec();
    Err(error).with_context(|| format!("starting {program}"))
}
