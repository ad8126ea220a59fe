//! `mluc status`: what the stages of a running pipeline say of themselves.

use std::process::ExitCode;
use std::time::Duration;

use anyhow::bail;
use mluc_ipc_types::{Health, Stage};
use mluc_runtime::{Instance, Shell, ShellOptions, Shutdown, log_to_stderr};

use crate::UsageError;
use crate::cli::StatusArgs;

/// Three heartbeats.
const LISTEN: Duration = Duration::from_millis(350);

pub(crate) fn status(args: StatusArgs) -> anyhow::Result<ExitCode> {
    log_to_stderr("status", "warn");
    let instance = Instance::new(&args.instance).map_err(|e| UsageError(e.to_string()))?;
    if !instance.root().exists() {
        bail!("no pipeline runs under the name '{}'", instance.name());
    }
    let shell = Shell::observer(ShellOptions::new(instance), None, Shutdown::on_signals()?)?;
    let mut watch = shell.health_watch()?;
    // What waits in the queues may be the last word of a stage that is gone.
    watch.update()?;
    std::thread::sleep(LISTEN);
    let stages = *watch.update()?;
    println!(
        "{:9} {:8} {:14} {:>8} {:>8} {:>8} {:>8} {:>9} {:>9}  reason",
        "stage", "process", "state", "in", "out", "dropped", "refused", "p50 ms", "p99 ms"
    );
    for (stage, health) in Stage::ALL.iter().zip(&stages) {
        match health {
            Some(health) => println!("{}", row(*stage, health)),
            None => println!("{:9} {:8} {:14}", stage.name(), "-", "silent"),
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn row(stage: Stage, health: &Health) -> String {
    let state = health.checked().map_or("?", |(_, state)| state.name());
    format!(
        "{:9} {:<8} {:14} {:8} {:8} {:8} {:8} {:9.2} {:9.2}  {}",
        stage.name(),
        health.pid,
        state,
        health.frames_in,
        health.frames_out,
        health.frames_dropped,
        health.messages_refused,
        f64::from(health.run_p50_us) / 1000.0,
        f64::from(health.run_p99_us) / 1000.0,
        health.reason()
    )
}
