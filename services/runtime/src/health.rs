//! What a stage tells of itself, and how others read it.

use hdrhistogram::Histogram;
use iceoryx2::node::Node;
use mluc_ipc_types::{
    CandidateCounts, FrameHeader, Health, HealthState, Stage, Text, Topic, WIRE_VERSION,
};

use crate::input::{Input, InputOptions};
use crate::run::RunWatch;
use crate::{Instance, Ipc, Output, RuntimeError, monotonic_ns};

/// The service's name: each stage has one of its own, so that each has one producer.
fn topic_name(stage: Stage) -> String {
    format!("{}/{}", Topic::HEALTH.name, stage.name())
}

/// What a stage counts; the program adds to it, [`crate::Shell`] publishes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames taken in.
    pub frames_in: u64,
    /// Frames published.
    pub frames_out: u64,
    /// Frames missed, by sequence gap.
    pub frames_dropped: u64,
    /// Messages refused: wrong version, length, index.
    pub messages_refused: u64,
    /// Payload bytes written to shared memory for the last frame.
    pub bytes_written: u64,
    /// Payload bytes read from shared memory for the last frame.
    pub bytes_read: u64,
    /// Payloads found inside a mapped segment, when asked to look.
    pub mappings_verified: u64,
    /// What became of the candidates; the refiner's alone.
    pub candidates: CandidateCounts,
}

/// The stage's side.
pub(crate) struct Heartbeat {
    output: Output<Health>,
    stage: Stage,
    state: HealthState,
    reason: String,
    run_id: u64,
    run_us: Histogram<u64>,
    count: u64,
    last_ns: u64,
}

/// Between two heartbeats when nothing changes.
const PERIOD_NS: u64 = 100_000_000;
/// Longest time that the histogram tells apart, us: a minute.
const RUN_MAX_US: u64 = 60_000_000;

impl Heartbeat {
    pub(crate) fn open(
        node: &Node<Ipc>,
        instance: &Instance,
        stage: Stage,
    ) -> Result<Heartbeat, RuntimeError> {
        let run_us =
            Histogram::new_with_bounds(1, RUN_MAX_US, 3).map_err(|e| RuntimeError::Node {
                instance: instance.name().to_string(),
                cause: e.to_string(),
            })?;
        Ok(Heartbeat {
            output: Output::open(node, instance, &Topic::HEALTH, &topic_name(stage), 1)?,
            stage,
            state: HealthState::Starting,
            reason: String::new(),
            run_id: 0,
            run_us,
            count: 0,
            last_ns: 0,
        })
    }

    pub(crate) fn record_run(&mut self, run_ns: u64) {
        self.run_us
            .saturating_record((run_ns / 1000).clamp(1, RUN_MAX_US));
    }

    pub(crate) fn is_due(&self) -> bool {
        monotonic_ns() - self.last_ns >= PERIOD_NS
    }

    /// Whether this is another run than before.
    pub(crate) fn set_run(&mut self, run_id: u64) -> bool {
        let is_new = self.run_id != run_id;
        self.run_id = run_id;
        is_new
    }

    /// Whether this changes anything.
    pub(crate) fn set(&mut self, state: HealthState, reason: &str) -> bool {
        if self.state == state && self.reason == reason {
            return false;
        }
        self.state = state;
        self.reason = reason.to_string();
        true
    }

    pub(crate) fn publish(&mut self, counters: &Counters) -> Result<(), RuntimeError> {
        let health = Health {
            wire_version: WIRE_VERSION,
            stage: self.stage as u32,
            state: self.state as u32,
            pid: std::process::id(),
            run_id: self.run_id,
            frames_in: counters.frames_in,
            frames_out: counters.frames_out,
            frames_dropped: counters.frames_dropped,
            messages_refused: counters.messages_refused,
            run_p50_us: self.run_us.value_at_quantile(0.50) as u32,
            run_p99_us: self.run_us.value_at_quantile(0.99) as u32,
            run_max_us: self.run_us.max() as u32,
            bytes_written: counters.bytes_written as u32,
            bytes_read: counters.bytes_read,
            mappings_verified: counters.mappings_verified,
            candidates: counters.candidates,
            reason: Text::pack(&self.reason),
        };
        let mut header = FrameHeader::new(self.count, self.stage.name());
        header.run_id = self.run_id;
        let mut loan = self.output.loan(&header, 1)?;
        loan.elements_mut().fill(health);
        loan.publish()?;
        self.count += 1;
        self.last_ns = monotonic_ns();
        Ok(())
    }
}

/// The reader's side: the last heartbeat of every stage in the run.
pub struct HealthWatch {
    run: RunWatch,
    inputs: Vec<Input<Health>>,
    last: [Option<Health>; 4],
    heard_ns: [u64; 4],
}

impl HealthWatch {
    pub(crate) fn open(node: &Node<Ipc>, instance: &Instance) -> Result<HealthWatch, RuntimeError> {
        let options = InputOptions::default();
        let inputs = Stage::ALL
            .iter()
            .map(|&stage| Input::open(node, instance, &Topic::HEALTH, &topic_name(stage), options))
            .collect::<Result<_, _>>()?;
        Ok(HealthWatch {
            run: RunWatch::open(node, instance)?,
            inputs,
            last: [None; 4],
            heard_ns: [0; 4],
        })
    }

    /// Takes what arrived. Left out are heartbeats that break the contract, of another stage than their topic's, and of
    /// another run; where no run is known, those of any.
    pub fn update(&mut self) -> Result<&[Option<Health>; 4], RuntimeError> {
        if self.run.update()? {
            self.last = [None; 4];
        }
        let run_id = self.run.id();
        let kept = self.last.iter_mut().zip(&mut self.heard_ns);
        for ((input, stage), (last, heard_ns)) in self.inputs.iter_mut().zip(Stage::ALL).zip(kept) {
            let Some(message) = input.newest()? else {
                continue;
            };
            if let [health] = message.elements()
                && health.checked().is_ok_and(|(found, _)| found == stage)
                && (run_id == 0 || [0, run_id].contains(&health.run_id))
            {
                *last = Some(*health);
                *heard_ns = message.received_ns;
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

    /// Whether the stage said that it takes frames of the run.
    pub fn is_ready(&self, stage: Stage) -> bool {
        let health = self.of(stage);
        let takes_part = |health: &&Health| health.run_id == self.run.id() && health.run_id != 0;
        matches!(
            health
                .filter(takes_part)
                .and_then(|health| health.checked().ok()),
            Some((
                _,
                HealthState::WaitingInput | HealthState::Running | HealthState::Degraded
            ))
        )
    }
}
