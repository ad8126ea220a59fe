//! What a stage says of itself, for the supervisor.

use bytemuck::{Pod, Zeroable};

use crate::{REASON_MAX, Text};

/// The state words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    /// All, by number.
    pub const ALL: [HealthState; 6] = [
        HealthState::Starting,
        HealthState::WaitingInput,
        HealthState::Running,
        HealthState::Degraded,
        HealthState::Failed,
        HealthState::Stopping,
    ];

    /// The word.
    pub fn name(self) -> &'static str {
        [
            "starting",
            "waiting_input",
            "running",
            "degraded",
            "failed",
            "stopping",
        ][self as usize]
    }
}

/// One stage's heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
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
    /// Why, UTF-8, NUL-padded.
    pub reason: [u8; REASON_MAX],
}

const _: () = assert!(size_of::<Health>() == 72 + REASON_MAX);

impl Health {
    /// The reason; empty when there is none.
    pub fn reason(&self) -> &str {
        Text::unpack(&self.reason).unwrap_or("?")
    }
}
