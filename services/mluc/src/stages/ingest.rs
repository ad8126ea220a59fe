//! Brings scans from the input into shared memory, at the sensor's pace or one after the other.

mod pace;
mod sender;

use super::begin_or_join_run;
use crate::{UsageError, settings::Pace, settings::Settings};
use anyhow::Context;
use mluc_ipc_types::{Health, HealthState, Stage};
use mluc_model::Model;
use mluc_runtime::{Shell, monotonic_ns};
use mluc_sources::Open;
use sender::Sender;

/// `start_sequence`: given by the supervisor; `None`: the supervisor did not start this process.
pub(crate) fn run(
    shell: &mut Shell,
    settings: &Settings,
    model: &Model,
    start_sequence: Option<u64>,
    open: Open,
) -> anyhow::Result<()> {
    let source = settings.source(open)?;
    let mut source = source.ok_or_else(|| UsageError("ingest needs --input".to_string()))?;
    if begin_or_join_run(shell, settings, model)?.is_none() {
        return Ok(shell.state(HealthState::Stopping, Health::ASKED_TO_END)?);
    }
    let first = match start_sequence {
        None if !shell.describes_run() => next_sequence(shell)?,
        given => given.unwrap_or(0),
    };
    if first > 0 {
        source.go_on()?;
    }
    let sensor = match settings.sensor.load() {
        // It was read at the start of the run, and may be edited or gone since.
        Err(error) if first > 0 => {
            tracing::warn!("{error:#}: scans are compared with the model only");
            None
        }
        loaded => loaded?,
    };
    // A process that the supervisor did not start counts only its own scans.
    let counted = start_sequence.unwrap_or(0);
    let sender = Sender::new(shell, source, model, sensor, counted);
    let mut sender = sender.context("opening the topics")?;
    if first == 0 {
        sender.wait_until_ready()?;
    } else {
        // After a restart a sensor does not wait: a stage that is restarted too takes the next scan. A capture is read on to that
        // scan, which may take longer than a start may. So this state ends the start, and only the limit for heartbeats applies.
        let reason = format!("waiting for scan {first}");
        sender.shell.state(HealthState::WaitingInput, &reason)?;
    }
    let done = match settings.pace {
        Pace::Sensor => pace::sensor(&mut sender, settings, first),
        Pace::Complete => pace::complete(&mut sender, settings, first),
    };
    let reason = match &done {
        _ if sender.shell.is_stopping() => Health::ASKED_TO_END.to_string(),
        // The input is at its end, and so is the run.
        Ok(()) => String::new(),
        Err(error) => format!("{error:#}"),
    };
    sender.shell.state(HealthState::Stopping, &reason)?;
    done.with_context(|| Stage::Ingest.name())
}

/// The first sequence in the run of a supervisor: it follows the scans that an earlier ingest has sent, as the supervisor has counted them.
fn next_sequence(shell: &mut Shell) -> anyhow::Result<u64> {
    let begun_ns = monotonic_ns();
    let mut statuses = shell.status_watch()?;
    shell.state(HealthState::WaitingInput, "waiting for the supervisor")?;
    while !shell.is_stopping() {
        if let Some(status) = statuses.last()?
            && shell.run().is_some_and(|run| run.run_id == status.run_id)
            && status.judged_ns >= begun_ns
        {
            return Ok(status.frames_in);
        }
        shell.tick()?;
        std::thread::sleep(pace::POLL_INTERVAL);
    }
    Ok(0)
}
