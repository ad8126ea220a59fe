//! Scans from files into shared memory, at the sensor's pace or one after the other.

mod pace;
mod sender;

use anyhow::Context;
use mluc_ipc_types::{Health, HealthState, Stage};
use mluc_model::Model;
use mluc_runtime::Shell;

use super::begin_or_join_run;
use crate::UsageError;
use crate::settings::{Pace, Settings};
use mluc_sources::Open;
use sender::Sender;

pub(crate) fn run(
    shell: &mut Shell,
    settings: &Settings,
    model: &Model,
    start_sequence: u64,
    open: Open,
) -> anyhow::Result<()> {
    let source = settings.source(open)?;
    let source = source.ok_or_else(|| UsageError("ingest needs --input".to_string()))?;
    if begin_or_join_run(shell, settings, model)?.is_none() {
        return Ok(());
    }
    let sensor = settings.sensor.load()?;
    let sender = Sender::new(shell, source, model, sensor, start_sequence);
    let mut sender = sender.context("opening the topics")?;
    // A sensor that comes back does not wait: a stage that is restarted too takes the next scan.
    if start_sequence == 0 {
        sender.wait_until_ready()?;
    }
    let done = match settings.pace {
        Pace::Sensor => pace::sensor(&mut sender, settings, start_sequence),
        Pace::Complete => pace::complete(&mut sender, settings, start_sequence),
    };
    let was_asked = sender.shell.is_stopping();
    let reason = if was_asked { Health::ASKED_TO_END } else { "" };
    sender.shell.state(HealthState::Stopping, reason)?;
    sender.shell.beat()?;
    done.with_context(|| Stage::Ingest.name())
}
