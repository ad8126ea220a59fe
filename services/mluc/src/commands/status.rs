//! `mluc status`: what the stages of a running pipeline say of themselves.

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::bail;
use mluc_ipc_types::{CandidateCounts, Health, Stage};
use mluc_runtime::{Instance, Shell, Shutdown, log_to_stderr};
use serde_json::{Value, json};

use crate::UsageError;
use crate::terminal::print_out;

/// Three heartbeats.
const LISTEN: Duration = Duration::from_millis(350);

pub(crate) fn status(name: &str, is_json: bool) -> anyhow::Result<ExitCode> {
    log_to_stderr("status", "warn");
    let instance = Instance::new(name).map_err(|e| UsageError(e.to_string()))?;
    if !instance.root().exists() {
        bail!("no pipeline runs under the name '{name}'");
    }
    let shell = Shell::observer(&instance, None, Shutdown::on_signals()?)?;
    let mut watch = shell.health_watch()?;
    // What waits in the queues may be the last word of a stage that is gone.
    watch.update()?;
    std::thread::sleep(LISTEN);
    let stages = *watch.update()?;
    if is_json {
        print_out(as_json(name, &stages))?;
    } else {
        print(&stages)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn print(stages: &[Option<Health>; 4]) -> anyhow::Result<()> {
    print_out(format_args!(
        "{:9} {:8} {:14} {:>8} {:>8} {:>8} {:>8} {:>9} {:>9}  reason",
        "stage", "process", "state", "in", "out", "dropped", "refused", "p50 ms", "p99 ms"
    ))?;
    for (stage, health) in Stage::ALL.iter().zip(stages) {
        match health {
            Some(health) => print_out(row(*stage, health))?,
            None => print_out(format_args!("{:9} {:8} {:14}", stage.name(), "-", "silent"))?,
        }
    }
    for health in stages.iter().flatten() {
        if health.candidates.total() > 0 {
            print_out(candidates(&health.candidates))?;
        }
    }
    Ok(())
}

fn row(stage: Stage, health: &Health) -> String {
    format!(
        "{:9} {:<8} {:14} {:8} {:8} {:8} {:8} {:9.2} {:9.2}  {}",
        stage.name(),
        health.pid,
        state(health),
        health.frames_in,
        health.frames_out,
        health.frames_dropped,
        health.messages_refused,
        f64::from(health.run_p50_us) / 1000.0,
        f64::from(health.run_p99_us) / 1000.0,
        health.reason()
    )
}

fn state(health: &Health) -> &'static str {
    health.checked().map_or("?", |(_, state)| state.name())
}

/// What is not zero.
fn counted(counts: &CandidateCounts) -> impl Iterator<Item = (&'static str, u64)> {
    counts.named().filter(|(_, count)| *count > 0)
}

fn candidates(counts: &CandidateCounts) -> String {
    let words = counted(counts).map(|(name, count)| format!("{name} {count}"));
    let (total, words) = (counts.total(), words.collect::<Vec<_>>().join(", "));
    format!("candidates since the refiner began: {total} ({words})")
}

fn as_json(instance: &str, stages: &[Option<Health>; 4]) -> Value {
    let stages = Stage::ALL.iter().zip(stages).map(|(stage, health)| {
        let Some(health) = health else {
            return json!({"stage": stage.name(), "state": "silent"});
        };
        json!({
            "stage": stage.name(),
            "process": health.pid,
            "state": state(health),
            "frames_in": health.frames_in,
            "frames_out": health.frames_out,
            "frames_dropped": health.frames_dropped,
            "messages_refused": health.messages_refused,
            "run_p50_us": health.run_p50_us,
            "run_p99_us": health.run_p99_us,
            "run_max_us": health.run_max_us,
            "candidates": counted(&health.candidates).collect::<BTreeMap<_, _>>(),
            "reason": health.reason(),
        })
    });
    json!({"instance": instance, "stages": stages.collect::<Vec<_>>()})
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use mluc_ipc_types::{Disposition, HealthState, Text, WIRE_VERSION};

    fn refiner() -> Health {
        let mut health = Health {
            wire_version: WIRE_VERSION,
            stage: Stage::Refiner as u32,
            state: HealthState::Running as u32,
            pid: 7,
            frames_in: 9,
            frames_out: 9,
            reason: Text::pack("why"),
            ..Health::zeroed()
        };
        health.candidates.by_disposition[Disposition::Published as usize] = 12;
        health.candidates.by_disposition[Disposition::OverlapsKnown as usize] = 3;
        health.candidates.split = 2;
        health
    }

    #[test]
    fn words_and_json_tell_what_the_stages_said() {
        let words = candidates(&refiner().candidates);
        let counts = "15 (published 12, overlaps_known 3, split 2)";
        assert_eq!(
            words,
            format!("candidates since the refiner began: {counts}")
        );
        let told = as_json("demo", &[None, None, None, Some(refiner())]);
        assert_eq!(told["instance"], "demo");
        let silent = json!({"stage": "ingest", "state": "silent"});
        assert_eq!(told["stages"][0], silent);
        let refiner = json!({
            "stage": "refiner", "process": 7, "state": "running", "frames_in": 9, "frames_out": 9,
            "frames_dropped": 0, "messages_refused": 0, "run_p50_us": 0, "run_p99_us": 0, "run_max_us": 0,
            "candidates": {"published": 12, "overlaps_known": 3, "split": 2}, "reason": "why",
        });
        assert_eq!(told["stages"][3], refiner);
    }
}
