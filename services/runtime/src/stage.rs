//! A stage's process without its algorithm: take, check, count, stamp, publish.

use crate::{Frames, Next, Payload, RuntimeError, Scans, Shell, monotonic_ns};
use mluc_ipc_types::{ContractError, FrameHeader, HealthState, Point, Stage, Topic};
use std::time::Duration;

/// Why a stage has no result for a frame.
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// The message breaks the contract: refused, counted, and the next one is taken.
    #[error(transparent)]
    Refused(#[from] ContractError),
    /// Shared memory failed: the stage ends.
    #[error(transparent)]
    Runtime(#[from] RuntimeError),
    /// The algorithm failed: the stage ends.
    #[error(transparent)]
    Failed(Box<dyn std::error::Error + Send + Sync>),
}

impl StageError {
    /// Wraps an algorithm's own error, for `map_err`.
    pub fn failed(error: impl std::error::Error + Send + Sync + 'static) -> StageError {
        StageError::Failed(Box::new(error))
    }
}

/// The algorithm of a stage, separate from its process.
pub trait Algorithm {
    /// The stage that this algorithm belongs to.
    const STAGE: Stage;
    /// Element of the input messages.
    type Input: Payload;
    /// Element of the output messages.
    type Output: Payload;

    /// Checks and computes a frame, and flags in the header what was out of the ordinary. Returns the result's number of elements.
    /// `elements`: the message's elements in shared memory. `points`: the frame's points, for the refiner; `None`: they are gone.
    fn run(
        &mut self,
        header: &mut FrameHeader,
        elements: &[Self::Input],
        points: Option<&[Point]>,
    ) -> Result<usize, StageError>;

    /// Early work on the points of a frame whose input is still to come, if the stage keeps points. They are unchecked; the frame may never come.
    fn read_ahead(&mut self, _header: &FrameHeader, _points: &[Point]) {}

    /// Writes the result to shared memory.
    fn write(&mut self, output: &mut [Self::Output]) -> Result<(), StageError>;

    /// Publishes messages that must precede the result; returns their bytes.
    fn publish_aside(&mut self, _header: &FrameHeader) -> Result<usize, RuntimeError> {
        Ok(0)
    }

    /// Adds to the stage's counters.
    fn count(&self, _shell: &mut Shell) {}
}

/// Runs a stage after ingest until it is asked to end. `elements_max`: number of elements of its largest result.
pub fn run_stage<A: Algorithm>(
    shell: &mut Shell,
    elements_max: usize,
    mut algorithm: A,
) -> Result<(), StageError> {
    let stage = A::STAGE;
    // Input topic, output topic, and whether scans are kept as well; `None`: the scans are the input.
    let (from, to, holds) = match stage {
        Stage::Ingest | Stage::Backbone => (&Topic::POINTS, &Topic::FEATURES, None),
        Stage::Head => (&Topic::FEATURES, &Topic::DETECTIONS, Some(false)),
        Stage::Refiner => (&Topic::DETECTIONS, &Topic::OBJECTS, Some(true)),
    };
    let mut output = shell.output::<A::Output>(to, elements_max)?;
    let scans = holds.map(|holds| Scans::open(shell, holds)).transpose()?;
    let mut frames = Frames::<A::Input>::new(shell, from, scans)?;
    let waiting = format!("waiting for {}", frames.name());
    shell.state(HealthState::WaitingInput, &waiting)?;
    loop {
        let ahead = |header: &FrameHeader, points: &[Point]| algorithm.read_ahead(header, points);
        let message = match frames.next_within(shell, ahead, Duration::MAX)? {
            Next::Message(message) => message,
            Next::Stopping => break,
            Next::Timeout => continue,
        };
        let mut header = *message.header();
        let stamps = header.stamps_mut(stage);
        (stamps.received_ns, stamps.started_ns) = (message.received_ns, monotonic_ns());
        shell.note_frame(Some(header.sequence));
        let (elements, points) = (message.elements(), frames.points(header.sequence));
        let bytes_read = size_of_val(elements) + points.map_or(0, size_of_val);
        let count = match algorithm.run(&mut header, elements, points) {
            Ok(count) => count,
            Err(StageError::Refused(error)) => {
                shell.note_frame(None);
                shell.refuse(&error.to_string())?;
                frames.release();
                continue;
            }
            Err(error) => return Err(error),
        };
        let bytes_aside = algorithm.publish_aside(&header)?;
        let mut loan = output.loan(&header, count)?;
        algorithm.write(loan.elements_mut())?;
        stamp_published(stage, loan.header_mut());
        loan.publish()?;
        frames.release();
        algorithm.count(shell);
        shell.health.frames_in += 1;
        shell.health.bytes_read = bytes_read as u64;
        shell.health.bytes_written = (bytes_aside + count * size_of::<A::Output>()) as u32;
        shell.health.mappings_verified = frames.mappings_verified();
        finish(shell, stage, &header)?;
    }
    Ok(shell.state(HealthState::Stopping, "")?)
}

/// The last stamp, right before the message is handed over.
pub fn stamp_published(stage: Stage, header: &mut FrameHeader) {
    header.stamps_mut(stage).published_ns = monotonic_ns();
}

/// Counts a published frame, records its computing time, and ends its note for the supervisor.
pub fn count_frame(shell: &mut Shell, stage: Stage, header: &FrameHeader) {
    let stamps = header.stages[stage as usize];
    if let Some(heartbeat) = &mut shell.heartbeat {
        heartbeat.record_run(monotonic_ns().saturating_sub(stamps.started_ns));
    }
    shell.health.frames_out += 1;
    shell.note_frame(None);
}

/// Calls [`count_frame`] and sets the state to running, for a stage without a complaint.
pub fn finish(shell: &mut Shell, stage: Stage, header: &FrameHeader) -> Result<(), RuntimeError> {
    count_frame(shell, stage, header);
    shell.state(HealthState::Running, "")?;
    shell.tick()
}
