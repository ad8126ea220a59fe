//! The current state of the pipeline: whether "no objects" means that nothing is there.

use crate::error::{Result, check_version, require};
use crate::{ContractError, REASON_MAX, Stage, Text, text::words};
use bytemuck::{Contiguous, Pod, Zeroable};
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;
use std::f32::consts::TAU;

/// The states. Only in [`StatusState::Running`] and [`StatusState::Degraded`], a missing object means that nothing is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Contiguous)]
#[repr(u32)]
pub enum StatusState {
    /// No result of this run came yet.
    Starting = 0,
    /// Results come in time.
    Running = 1,
    /// Results come in time, with a complaint; the reason says which.
    Degraded = 2,
    /// Results come, but the sensor sees nothing, or little.
    Blind = 3,
    /// The newest result is older than the budget and a period of the sensor allow.
    Late = 4,
    /// Results came before, but no more results come.
    Stopped = 5,
}

words!(StatusState: "starting" "running" "degraded" "blind" "late" "stopped");

impl StatusState {
    /// Whether a missing object means that nothing is there.
    pub fn sees(self) -> bool {
        [StatusState::Running, StatusState::Degraded].contains(&self)
    }
}

/// The message of the topic `status`. Its one writer is the supervisor, with each result, on every change and every half second. The topic
/// keeps the newest message for late readers. A reader calls [`Status::at`], which detects a supervisor that is gone.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend), type_name("mluc.Status"))]
#[repr(C)]
pub struct Status {
    /// [`crate::WIRE_VERSION`].
    pub wire_version: u32,
    /// [`StatusState`].
    pub state: u32,
    /// [`crate::RunDescription::run_id`].
    pub run_id: u64,
    /// When it was judged: CLOCK_MONOTONIC, ns.
    pub judged_ns: u64,
    /// Sequence of the newest result; [`Status::NONE`]: none yet.
    pub sequence: u64,
    /// From the arrival of that result's scan to `judged_ns`; [`Status::NONE`]: none yet.
    pub age_ns: u64,
    /// Frames that ingest has sent in the run.
    pub frames_in: u64,
    /// Frames whose objects came out.
    pub frames_out: u64,
    /// Frames that were overtaken or lost; the rest of `frames_in` is in work.
    pub frames_dropped: u64,
    /// Of `frames_out`, those that left after their budget.
    pub frames_late: u64,
    /// Frames that each stage has published in the run, over its restarts. A frame that the stage before has published and the
    /// stage has not was dropped in the stage, or is in work.
    pub stages_out: [u64; 4],
    /// Of `frames_out`, those for which the stage needed longer than its budget, waiting included.
    pub stages_late: [u64; 4],
    /// Bit n: no returns between n x 10 and (n + 1) x 10 degrees of azimuth, counter-clockwise from +x, where there should be some.
    pub blind_sectors: u64,
    /// Share of points that are not finite in the newest scan, 0 to 1.
    pub not_finite_share: f32,
    /// 1: the ground was there in this run and is not found any more; else 0.
    pub is_ground_lost: u32,
    /// The reason of the state, UTF-8, NUL-padded.
    pub reason: [u8; REASON_MAX],
}

const _: () = assert!(size_of::<Status>() == 152 + REASON_MAX);

impl Default for Status {
    fn default() -> Status {
        Status::zeroed()
    }
}

impl Status {
    /// Means that there is no number.
    pub const NONE: u64 = u64::MAX;
    /// Sectors of azimuth.
    pub const SECTORS: usize = 36;
    /// A status that is older means that its writer hangs or is gone.
    pub const AGE_MAX_NS: u64 = 2_000_000_000;

    /// The sector of a direction.
    pub fn sector_of(x_m: f32, y_m: f32) -> usize {
        let turns = y_m.atan2(x_m) / TAU;
        let sector = (turns + f32::from(u8::from(turns < 0.0))) * Status::SECTORS as f32;
        (sector as usize).min(Status::SECTORS - 1)
    }

    /// Checks version, state, numbers and text.
    pub fn checked(&self) -> Result<StatusState> {
        check_version(self.wire_version)?;
        let (what, found) = ("state of the pipeline", self.state);
        let state = StatusState::from_integer(found);
        let state = state.ok_or(ContractError::Value { what, found })?;
        let can_be = self.run_id != 0
            && (0.0..=1.0).contains(&self.not_finite_share)
            && self.is_ground_lost <= 1
            && self.blind_sectors >> Status::SECTORS == 0
            && Text::unpack(&self.reason).is_some();
        let (what, index) = ("numbers and text of the status", 0);
        require(can_be, ContractError::Inconsistent { what, index })?;
        Ok(state)
    }

    /// The reason; empty when there is none.
    pub fn reason(&self) -> &str {
        Text::unpack(&self.reason).unwrap_or("?")
    }

    /// Age of the newest result, s; NaN where there is none.
    pub fn age_s(&self) -> f64 {
        let is_known = self.age_ns != Status::NONE;
        let age_ns = self.age_ns as f64;
        if is_known { age_ns / 1e9 } else { f64::NAN }
    }

    /// Numbers of frames that were sent to a stage, that it has published, and that it was late with.
    pub fn hop(&self, stage: Stage) -> [u64; 3] {
        let number = stage as usize;
        let before = number.checked_sub(1).map(|before| self.stages_out[before]);
        let sent = before.unwrap_or(self.frames_in);
        [sent, self.stages_out[number], self.stages_late[number]]
    }

    /// The status at a later time: the result is older, and after a long silence of its writer the state is `stopped`.
    pub fn at(&self, now_ns: u64) -> Status {
        let since_ns = now_ns.saturating_sub(self.judged_ns);
        let mut status = *self;
        status.judged_ns = now_ns.max(self.judged_ns);
        if self.age_ns != Status::NONE {
            status.age_ns = self.age_ns.saturating_add(since_ns);
        }
        if since_ns > Status::AGE_MAX_NS && self.state != StatusState::Stopped as u32 {
            status.state = StatusState::Stopped as u32;
            status.reason = Text::pack("the supervisor hangs or is gone");
        }
        status
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WIRE_VERSION;

    fn status() -> Status {
        Status {
            wire_version: WIRE_VERSION,
            state: StatusState::Blind as u32,
            run_id: 7,
            judged_ns: 1_000,
            age_ns: 500,
            reason: Text::pack("empty scans"),
            ..Status::zeroed()
        }
    }

    #[test]
    fn a_status_is_checked() {
        assert_eq!(status().checked(), Ok(StatusState::Blind));
        let changes: [fn(&mut Status); 7] = [
            |s| s.wire_version = 9,
            |s| s.state = 6,
            |s| s.run_id = 0,
            |s| s.not_finite_share = f32::NAN,
            |s| s.is_ground_lost = 2,
            |s| s.blind_sectors = 1 << 36,
            |s| s.reason = [0xff; REASON_MAX],
        ];
        for (number, change) in changes.into_iter().enumerate() {
            let mut status = status();
            change(&mut status);
            assert!(status.checked().is_err(), "change {number}");
        }
    }

    #[test]
    fn a_status_grows_old_and_a_silent_writer_is_told() {
        let later = [2_000_001_000, 2_000_001_001].map(|now_ns| status().at(now_ns));
        let states = later.map(|status| status.checked());
        assert_eq!(states, [Ok(StatusState::Blind), Ok(StatusState::Stopped)]);
        assert_eq!(later[0].age_ns, 2_000_000_500);
        assert_eq!(later[1].reason(), "the supervisor hangs or is gone");
    }

    #[test]
    fn sectors_go_counter_clockwise_from_ahead() {
        let at = |deg: f32| Status::sector_of(deg.to_radians().cos(), deg.to_radians().sin());
        let sectors = [5.0, 15.0, 95.0, 175.0, -175.0, -5.0].map(at);
        assert_eq!(sectors, [0, 1, 9, 17, 18, 35]);
        let edges = [(1.0, -0.0), (1.0, -1e-30), (0.0, 0.0), (f32::NAN, 1.0)];
        assert!(edges.into_iter().all(|(x, y)| Status::sector_of(x, y) < 36));
    }
}
