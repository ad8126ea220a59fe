//! What a stage says of itself, for the supervisor.

use bytemuck::{Contiguous, Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

use crate::error::{Result, check_version, require};
use crate::{CandidateCounts, ContractError, REASON_MAX, Stage, Text};

/// The state words.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Contiguous)]
#[repr(u32)]
pub enum HealthState {
    /// Loading.
    Starting = 0,
    /// Ready; nothing to do.
    WaitingInput = 1,
    /// At work.
    Running = 2,
    /// At work with a complaint; the reason says which.
    Degraded = 3,
    /// Given up; the reason says why.
    Failed = 4,
    /// On its way out.
    Stopping = 5,
}

impl HealthState {
    /// The words in the JSON lines and the contract, by number.
    pub const NAMES: [&str; 6] = [
        "starting",
        "waiting_input",
        "running",
        "degraded",
        "failed",
        "stopping",
    ];

    /// The word.
    pub fn name(self) -> &'static str {
        HealthState::NAMES[self as usize]
    }
}

/// One stage's heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend), type_name("mluc.Health"))]
#[repr(C)]
pub struct Health {
    /// [`crate::WIRE_VERSION`].
    pub wire_version: u32,
    /// [`crate::Stage`].
    pub stage: u32,
    /// [`HealthState`].
    pub state: u32,
    /// Process.
    pub pid: u32,
    /// [`crate::RunDescription::run_id`] of the run that the stage takes part in; 0 before it knows one. A heartbeat of
    /// another run says nothing about this one.
    pub run_id: u64,
    /// Frames taken in.
    pub frames_in: u64,
    /// Frames published.
    pub frames_out: u64,
    /// Frames missed, by sequence gap.
    pub frames_dropped: u64,
    /// Messages refused: wrong version, length, index.
    pub messages_refused: u64,
    /// Time of computing a frame, us: median.
    pub run_p50_us: u32,
    /// 99th percentile.
    pub run_p99_us: u32,
    /// Largest.
    pub run_max_us: u32,
    /// Bytes written to shared memory for the last frame (payload only).
    pub bytes_written: u32,
    /// Bytes read from shared memory for the last frame (payload only).
    pub bytes_read: u64,
    /// Payloads that were found inside a mapped shared segment, when the stage was asked to look.
    pub mappings_verified: u64,
    /// What became of the candidates; the refiner's alone.
    pub candidates: CandidateCounts,
    /// Why, UTF-8, NUL-padded.
    pub reason: [u8; REASON_MAX],
}

const _: () = assert!(size_of::<Health>() == 176 + REASON_MAX);

impl Health {
    /// Checks a heartbeat: version, stage, state, process, and counts and times that can be.
    pub fn checked(&self) -> Result<(Stage, HealthState)> {
        check_version(self.wire_version)?;
        let bad = |what, found| ContractError::Value { what, found };
        let stage = Stage::ALL.get(self.stage as usize);
        let stage = *stage.ok_or(bad("stage of a heartbeat", self.stage))?;
        let state = HealthState::from_integer(self.state);
        let state = state.ok_or(bad("state of a heartbeat", self.state))?;
        let can_be = self.pid != 0
            && self.frames_out <= self.frames_in
            && self.run_p50_us <= self.run_p99_us
            && self.run_p99_us <= self.run_max_us;
        let (what, index) = ("process, counts and times of a heartbeat", stage as usize);
        require(can_be, ContractError::Inconsistent { what, index })?;
        Ok((stage, state))
    }

    /// The reason; empty when there is none.
    pub fn reason(&self) -> &str {
        Text::unpack(&self.reason).unwrap_or("?")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WIRE_VERSION;

    /// A change, and how the error about it begins.
    type Change = (fn(&mut Health), &'static str);

    #[test]
    fn a_heartbeat_is_checked() {
        let mut health = Health {
            wire_version: WIRE_VERSION,
            stage: Stage::Head as u32,
            state: HealthState::Degraded as u32,
            pid: 5,
            frames_in: 1,
            reason: Text::pack("slow"),
            ..Health::zeroed()
        };
        assert_eq!(health.checked(), Ok((Stage::Head, HealthState::Degraded)));
        assert_eq!(health.reason(), "slow");
        let changes: [Change; 7] = [
            (|h| h.pid = 0, "process, counts and times"),
            (|h| h.frames_out = 2, "process, counts and times"),
            (|h| h.run_p50_us = 1, "process, counts and times"),
            (|h| h.run_p99_us = u32::MAX, "process, counts and times"),
            (|h| h.state = 6, "state of a heartbeat: 6 is"),
            (|h| h.stage = 4, "stage of a heartbeat: 4 is"),
            (|h| h.wire_version = 9, "wire version 9"),
        ];
        for (change, expected) in changes {
            let mut health = health;
            change(&mut health);
            let error = health.checked().unwrap_err().to_string();
            assert!(error.starts_with(expected), "{error}");
        }
        health.reason = [0xff; REASON_MAX];
        assert_eq!(health.reason(), "?");
    }
}
