//! `mluc status`: prints the state of a running pipeline once.

use super::observe::{Observer, Snapshot, counted, running, state};
use crate::terminal::print_out;
use mluc_ipc_types::{CandidateCounts, Health, Stage, Topic};
use mluc_runtime::log_to_stderr;
use std::{process::ExitCode, time::Duration, time::Instant};

/// How long to listen: three heartbeats.
pub(super) const LISTEN: Duration = Duration::from_millis(350);

pub(crate) fn status(name: Option<&str>, is_json: bool) -> anyhow::Result<ExitCode> {
    log_to_stderr("status", "warn");
    let mut observer = Observer::open(&running(name)?)?;
    std::thread::sleep(LISTEN);
    let (mut snapshot, begun) = (observer.look()?, Instant::now());
    // A stage that computes a frame sends no heartbeat.
    while snapshot.stages.iter().any(Option::is_none) && begun.elapsed() < Topic::SILENCE_MAX {
        std::thread::sleep(LISTEN);
        snapshot = observer.look()?;
    }
    if is_json {
        print_out(snapshot.as_json())?;
    } else {
        print(&snapshot)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn print(snapshot: &Snapshot) -> anyhow::Result<()> {
    print_out(snapshot.headline())?;
    print_out(format_args!("{HEAD}  reason"))?;
    for (stage, health) in Stage::ALL.into_iter().zip(&snapshot.stages) {
        let reason = health.as_ref().map_or("", Health::reason);
        print_out(format_args!("{}  {reason}", row(stage, health.as_ref())))?;
    }
    for health in snapshot.stages.iter().flatten() {
        if health.candidates.total() > 0 {
            print_out(candidates(&health.candidates))?;
        }
    }
    Ok(())
}

/// Heads of the columns of [`row`].
pub(super) const HEAD: &str =
    "stage     process  state                in      out  dropped  refused    p50 ms    p99 ms";

pub(super) fn row(stage: Stage, health: Option<&Health>) -> String {
    let Some(health) = health else {
        return format!("{:9} {:8} {:14}", stage.name(), "-", "silent");
    };
    format!(
        "{:9} {:<8} {:14} {:8} {:8} {:8} {:8} {:9.2} {:9.2}",
        stage.name(),
        health.pid,
        state(health),
        health.frames_in,
        health.frames_out,
        health.frames_dropped,
        health.messages_refused,
        f64::from(health.run_p50_us) / 1000.0,
        f64::from(health.run_p99_us) / 1000.0,
    )
}

fn candidates(counts: &CandidateCounts) -> String {
    let words = counted(counts).map(|(name, count)| format!("{name} {count}"));
    let (total, words) = (counts.total(), words.collect::<Vec<_>>().join(", "));
    format!("candidates since the refiner began: {total} ({words})")
}
