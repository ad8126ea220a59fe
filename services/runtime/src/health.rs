//! The heartbeats of the stages: publishing them and reading them.

use crate::{
    Input, Output, RuntimeError, error::Result, monotonic_ns, node::IpcNode, run::RunWatch,
};
use hdrhistogram::Histogram;
use mluc_ipc_types::{FrameHeader, Health, HealthState, Stage, Topic};

/// Time between two heartbeats while nothing changes, ns.
const PERIOD_NS: u64 = 100_000_000;
/// Upper bound of the histogram, us: a minute. Longer times are recorded as this one.
const RUN_MAX_US: u64 = 60_000_000;

/// The service's name: each stage has one of its own, so that each has one producer.
fn topic_name(stage: Stage) -> String {
    format!("{}/{}", Topic::HEALTH.name, stage.name())
}

/// Frames that the times of a heartbeat are of, at most.
const RUNS_MAX: u64 = 6_000;

/// Publishes the heartbeats of one stage.
pub(crate) struct Heartbeat {
    output: Output<Health>,
    stage: Stage,
    run_us: Histogram<u64>,
    count: u64,
    last_ns: u64,
}

impl Heartbeat {
    pub(crate) fn open(node: &IpcNode, stage: Stage) -> Result<Heartbeat> {
        let run_us = Histogram::new_with_bounds(1, RUN_MAX_US, 3)
            .map_err(|e| RuntimeError::instance(node.instance.name(), e))?;
        Ok(Heartbeat {
            output: Output::open(node, &Topic::HEALTH, &topic_name(stage), 1)?,
            stage,
            run_us,
            count: 0,
            last_ns: 0,
        })
    }

    pub(crate) fn record_run(&mut self, run_ns: u64) {
        if self.run_us.len() >= RUNS_MAX {
            self.run_us.reset();
        }
        let run_us = (run_ns / 1000).clamp(1, RUN_MAX_US);
        self.run_us.saturating_record(run_us);
    }

    /// Publishes a heartbeat if the last one is older than the period.
    pub(crate) fn keep_up(&mut self, health: &Health) -> Result<()> {
        if monotonic_ns() - self.last_ns < PERIOD_NS {
            return Ok(());
        }
        self.publish(health)
    }

    pub(crate) fn publish(&mut self, health: &Health) -> Result<()> {
        let health = Health {
            stage: self.stage as u32,
            run_p50_us: self.run_us.value_at_quantile(0.50) as u32,
            run_p99_us: self.run_us.value_at_quantile(0.99) as u32,
            run_max_us: self.run_us.max() as u32,
            ..*health
        };
        let mut header = FrameHeader::new(self.count, self.stage.name());
        header.run_id = health.run_id;
        self.output.send(&header, &[health])?;
        self.count += 1;
        self.last_ns = monotonic_ns();
        Ok(())
    }
}

/// The reader's side: the last heartbeat of every stage in the run.
pub struct HealthWatch {
    run: RunWatch,
    inputs: [Input<Health>; 4],
    last: [Option<Health>; 4],
    heard_ns: [u64; 4],
    begun_ns: u64,
}

impl HealthWatch {
    pub(crate) fn open(node: &IpcNode) -> Result<HealthWatch> {
        let open = |stage| Input::open(node, &Topic::HEALTH, &topic_name(stage), false);
        let [ingest, backbone, head, refiner] = Stage::ALL.map(open);
        let mut watch = HealthWatch {
            run: RunWatch::open(node)?,
            inputs: [ingest?, backbone?, head?, refiner?],
            last: [None; 4],
            heard_ns: [0; 4],
            begun_ns: 0,
        };
        // The queues may still contain the last heartbeat of a stage that is gone.
        watch.update()?;
        watch.begun_ns = monotonic_ns();
        Ok(watch)
    }

    /// Takes the heartbeats that arrived. Ignores heartbeats that break the contract, name another stage than their topic, or belong
    /// to another run. While no run is known, it accepts heartbeats of any run.
    pub fn update(&mut self) -> Result<&[Option<Health>; 4]> {
        if self.run.update()? {
            self.last = [None; 4];
        }
        let run_id = self.run.id();
        for (stage, input) in Stage::ALL.into_iter().zip(&mut self.inputs) {
            if let Some(message) = input.newest()?
                && let [health] = message.elements()
                && health.checked().is_ok_and(|(found, _)| found == stage)
                && (run_id == 0 || [0, run_id].contains(&health.run_id))
            {
                self.last[stage as usize] = Some(*health);
                self.heard_ns[stage as usize] = message.received_ns;
            }
        }
        Ok(&self.last)
    }

    /// The last heartbeat of a stage.
    pub fn of(&self, stage: Stage) -> Option<&Health> {
        self.last[stage as usize].as_ref()
    }

    /// When the last heartbeat of a stage was taken, CLOCK_MONOTONIC; 0: never.
    pub fn heard_ns(&self, stage: Stage) -> u64 {
        self.heard_ns[stage as usize]
    }

    /// The last heartbeats, without those of stages that are silent or were not heard since the watch began.
    pub fn heard(&self) -> [Option<Health>; 4] {
        let silent_ns = monotonic_ns().saturating_sub(Topic::SILENCE_MAX.as_nanos() as u64);
        let is_heard = |stage: Stage| self.heard_ns(stage) > self.begun_ns.max(silent_ns);
        Stage::ALL.map(|stage| self.of(stage).filter(|_| is_heard(stage)).copied())
    }

    /// Whether the stage reported the end of the run's input.
    pub fn has_finished(&self, stage: Stage) -> bool {
        self.of(stage).is_some_and(|health| {
            let state = health.checked().map(|(_, state)| state);
            let is_ending = state.is_ok_and(|state| state == HealthState::Stopping);
            is_ending && health.reason().is_empty() && health.run_id == self.run.id()
        })
    }

    /// Whether the stage reported that it takes frames of the run, and is not silent.
    pub fn is_ready(&self, stage: Stage) -> bool {
        use HealthState::{Degraded, Running, WaitingInput};
        let takes_frames = |state| [WaitingInput, Running, Degraded].contains(&state);
        self.heard()[stage as usize].is_some_and(|health| {
            health.run_id != 0
                && health.run_id == self.run.id()
                && health.checked().is_ok_and(|(_, state)| takes_frames(state))
        })
    }
}
