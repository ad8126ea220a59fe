//! A pipeline as its consumers see it: what `status`, `top` and `monitor` show.

use crate::{UsageError, control::Control, control::ControlWatch};
use anyhow::ensure;
pub(super) use mluc_gateway::lines::{counted, health_state as state};
use mluc_gateway::lines::{stage_words, status_words};
use mluc_ipc_types::{Health, Stage, Status, StatusState};
use mluc_runtime::{HealthWatch, Instance, Shell, Shutdown, StatusWatch};
use serde_json::{Value, json};

/// Observes an instance. It takes no frame, and no other process waits for it.
pub(super) struct Observer {
    // The ports are dropped before the shell.
    health: HealthWatch,
    status: StatusWatch,
    control: ControlWatch,
    pub(super) shell: Shell,
}

/// What was seen at one moment.
#[derive(Clone, Default)]
pub(super) struct Snapshot {
    pub(super) instance: String,
    /// `None`: the stage is silent.
    pub(super) stages: [Option<Health>; 4],
    /// `None`: there is no supervisor.
    pub(super) status: Option<Status>,
    /// Further counts of the supervisor.
    pub(super) control: Control,
}

pub(super) fn instance(name: Option<&str>) -> Result<Instance, UsageError> {
    let instance = name.map_or_else(Instance::from_environment, Instance::new);
    instance.map_err(|error| UsageError(error.to_string()))
}

/// Refuses a name under which nothing runs.
pub(super) fn running(name: Option<&str>) -> anyhow::Result<Instance> {
    let instance = instance(name)?;
    let (root, name) = (instance.root(), instance.name());
    ensure!(root.exists(), "no pipeline of yours is named '{name}'");
    Ok(instance)
}

impl Observer {
    pub(super) fn open(instance: &Instance) -> anyhow::Result<Observer> {
        let shell = Shell::observer(instance, None, Shutdown::on_signals()?)?;
        Ok(Observer {
            health: shell.health_watch()?,
            status: shell.status_watch()?,
            control: ControlWatch::new(instance),
            shell,
        })
    }

    pub(super) fn look(&mut self) -> anyhow::Result<Snapshot> {
        self.health.update()?;
        Ok(Snapshot {
            instance: self.shell.instance().name().to_string(),
            stages: self.health.heard(),
            status: self.status.update()?,
            control: self.control.look().clone(),
        })
    }
}

impl Snapshot {
    /// The pipeline's state; `None` without a supervisor.
    pub(super) fn state(&self) -> Option<StatusState> {
        self.status.and_then(|status| status.checked().ok())
    }

    /// The state in one line.
    pub(super) fn headline(&self) -> String {
        let Some(status) = &self.status else {
            return "state: unknown, no supervisor publishes one".to_string();
        };
        let state = self.state().map_or("?", StatusState::name);
        let colon = if status.reason().is_empty() { "" } else { ": " };
        let newest = match status.age_ns {
            Status::NONE => "no result yet".to_string(),
            age_ns => format!("newest result {} ms old", age_ns / 1_000_000),
        };
        format!(
            "state: {state}{colon}{}; {newest}; frames {} in, {} out, {} dropped, {} late",
            status.reason(),
            status.frames_in,
            status.frames_out,
            status.frames_dropped,
            status.frames_late
        )
    }

    pub(super) fn as_json(&self) -> Value {
        let stages = Stage::ALL.iter().zip(&self.stages);
        let stages = stages.map(|(stage, health)| stage_words(*stage, health.as_ref()));
        let status = self.status.as_ref().map(status_words);
        json!({"instance": self.instance, "status": status, "stages": stages.collect::<Vec<_>>()})
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use mluc_ipc_types::{HealthState, Text, WIRE_VERSION};

    /// A pipeline of which only the refiner sends heartbeats.
    pub(in crate::commands) fn snapshot(state: StatusState) -> Snapshot {
        let mut health = Health {
            wire_version: WIRE_VERSION,
            stage: Stage::Refiner as u32,
            state: HealthState::Running as u32,
            pid: 7,
            frames_in: 9,
            frames_out: 9,
            run_p50_us: 5_000,
            run_p99_us: 20_000,
            run_max_us: 20_000,
            reason: Text::pack("why"),
            ..Health::zeroed()
        };
        health.candidates.by_disposition[..2].copy_from_slice(&[12, 3]);
        health.candidates.split = 2;
        let status = Status {
            wire_version: WIRE_VERSION,
            state: state as u32,
            run_id: 1,
            sequence: 41,
            age_ns: 120_000_000,
            frames_in: 44,
            frames_out: 42,
            frames_dropped: 1,
            stages_out: [44, 43, 43, 42],
            stages_late: [0, 2, 0, 0],
            blind_sectors: 0b110,
            reason: Text::pack("a cover"),
            ..Status::default()
        };
        Snapshot {
            instance: "demo".to_string(),
            stages: [None, None, None, Some(health)],
            status: Some(status),
            control: Control {
                set_aside: [5, 8].into(),
                restarts: [0, 3, 0, 0],
                ..Control::default()
            },
        }
    }

    #[test]
    fn words_and_json_tell_what_was_seen() {
        let snapshot = snapshot(StatusState::Blind);
        let headline = "state: blind: a cover; newest result 120 ms old; frames 44 in, 42 out, 1 dropped, 0 late";
        assert_eq!(snapshot.headline(), headline);
        let told = snapshot.as_json();
        let silent = json!({"stage": "ingest", "state": "silent"});
        assert_eq!(told["stages"][0], silent);
        let refiner = json!({
            "stage": "refiner", "process": 7, "state": "running", "frames_in": 9, "frames_out": 9,
            "frames_dropped": 0, "messages_refused": 0, "run_p50_us": 5000, "run_p99_us": 20000, "run_max_us": 20000,
            "candidates": {"published": 12, "overlaps_known": 3, "split": 2}, "reason": "why",
        });
        assert_eq!(told["stages"][3], refiner);
        assert_eq!(told["status"]["blind_deg"], json!([[10, 30]]));
    }
}
