//! The heartbeat of a stage, for the supervisor.

use crate::error::{Result, check_version, require};
use crate::{ContractError, Disposition, Object, ObjectKind, REASON_MAX, Stage, Text, text::words};
use bytemuck::{Contiguous, Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;

/// The states of a stage.
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
    /// It has given up; the reason says why.
    Failed = 4,
    /// Ending.
    Stopping = 5,
}

words!(HealthState: "starting" "waiting_input" "running" "degraded" "failed" "stopping");

/// Unknown objects that a refiner published or suppressed since its process began. Zeros for other stages and for a refiner that does not count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend))]
#[cfg_attr(feature = "iceoryx2", type_name("mluc.CandidateCounts"))]
#[repr(C)]
pub struct CandidateCounts {
    /// Counts by [`Disposition`].
    pub by_disposition: [u64; Disposition::NAMES.len()],
    /// Objects with [`Object::UNREFINED`].
    pub unrefined: u64,
    /// Objects with [`Object::SPLIT`].
    pub split: u64,
    /// Objects with [`Object::THINNED`].
    pub thinned: u64,
}

impl CandidateCounts {
    /// Adds the unknown objects of a frame.
    pub fn add(&mut self, objects: &[Object]) {
        let is_unknown = |object: &&Object| object.kind == ObjectKind::Unknown as u32;
        for object in objects.iter().filter(is_unknown) {
            if let Some(count) = self.by_disposition.get_mut(object.disposition as usize) {
                *count += 1;
            }
            let has = |flag: u32| u64::from(object.flags & flag != 0);
            self.unrefined += has(Object::UNREFINED);
            self.split += has(Object::SPLIT);
            self.thinned += has(Object::THINNED);
        }
    }

    /// All candidates.
    pub fn total(&self) -> u64 {
        self.by_disposition.iter().sum()
    }

    /// Each count with its word, in the order of the fields.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, u64)> {
        let flags = [self.unrefined, self.split, self.thinned];
        let by_flag = Object::FLAG_NAMES.into_iter().zip(flags);
        Disposition::NAMES.into_iter().zip(self.by_disposition).chain(by_flag)
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
    /// Process id.
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
    /// Median of the time to compute a frame, us.
    pub run_p50_us: u32,
    /// 99th percentile of the time to compute a frame, us.
    pub run_p99_us: u32,
    /// Longest time to compute a frame, us.
    pub run_max_us: u32,
    /// Bytes written to shared memory for the last frame (payload only).
    pub bytes_written: u32,
    /// Bytes read from shared memory for the last frame (payload only).
    pub bytes_read: u64,
    /// Payloads that were found inside a mapped shared segment, if the stage was asked to check.
    pub mappings_verified: u64,
    /// What happened to the candidates; only the refiner has these counts.
    pub candidates: CandidateCounts,
    /// The reason of the state, UTF-8, NUL-padded.
    pub reason: [u8; REASON_MAX],
}

const _: () = assert!(size_of::<Health>() == 184 + REASON_MAX);

impl Health {
    /// Reason of an ingest that is `stopping` before its input ends; if the reason is empty instead, the run ends.
    pub const ASKED_TO_END: &str = "asked to end";

    /// Checks a heartbeat: version, stage, state, process, and whether counts and times are possible.
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

    #[test]
    fn unknown_objects_are_counted_by_disposition_and_flag() {
        let object =
            |kind, disposition, flags| Object { kind, disposition, flags, ..Object::zeroed() };
        let objects = [
            object(1, 0, Object::SPLIT | Object::THINNED),
            object(1, 0, Object::UNREFINED),
            object(1, Disposition::TooFewPoints as u32, 0),
            // A known object.
            object(0, 0, Object::SPLIT),
            // An object of another program: there is no such disposition.
            object(1, 77, Object::SPLIT),
        ];
        let mut counts = CandidateCounts::default();
        counts.add(&objects);
        counts.add(&objects[..1]);
        let named: Vec<_> = counts.named().filter(|(_, count)| *count > 0).collect();
        let by_disposition = [("published", 3), ("too_few_points", 1)];
        let by_flag = [("unrefined", 1), ("split", 3), ("thinned", 2)];
        assert_eq!(named, [&by_disposition[..], &by_flag].concat());
        assert_eq!(counts.total(), 4);
        assert_eq!(counts.named().count(), Disposition::NAMES.len() + 3);
    }
}
